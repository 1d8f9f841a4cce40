"""The noise-aware inverse: least squares in ADC steps, force >= 0, and a prior.

    minimise  1/2 sum ((reading - u(x)) / noise)^2 + prior(x),   x = log g between its bounds

by projected Gauss-Newton. The Jacobian is analytic, d u_a / d x_b = u_a^2 / R_ref * t_ab^2 g_b
(docs/derivation.md).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas, lapack

from ..physics import laplacian
from ..physics.conjugate_gradients import conjugate_gradients
from ..physics.quadratic import inverse_diagonal, solve_in_box
from . import prior as prior_terms
from . import series, suspect
from .aside import without_bad_contacts
from .estimate import Estimate
from .fixed_point import fill, first_guess, is_level, iterate, last_guess
from .reading import ROUNDING_NOISE, Reading, noise_at_rest

STEPS = 12
START_STEPS = 10  # of the fixed point: a step costs a twentieth of a Gauss-Newton step
WARM_STEPS = 12  # the same from the last frame: a touch that moved misfits by far at its rim
_NEAR = 1.2  # residual, in units of the noise, at which the fixed point has done its part
_SETTLED = 4.0  # stop when a step gains less than this, in units of 1/2 chi^2
_CAUSE = 6.0  # chi^2 that a cell at rest must gain alone to become an unknown
_JOIN = 0.03  # share of the best cell's gain from which a cell at rest becomes an unknown
_MEMORY = 4  # costs that a step may rise to: a bound met on the way costs height at first
_DENSE = 600  # unknowns up to which a Cholesky factor beats conjugate gradients
_CG_STEPS = 100
_SAME = 2.2  # standard deviations of chi^2 up to which a frame is like the last one
_NEAR_REST = 1.5  # times the conductance at rest: a starting cell below it starts at rest
_WIDEN = 1.12  # the prior's majorant is wider in curvature than the prior: measured coverage
_HARD = 0.5  # of the series resistance: with less rho an r_par 10 % off moves every cell
_UNEVEN = 0.25  # spread of log g from which on a load is more than a flat one on a fabric's scatter
_ALIKE = 0.5  # neighbours' squared difference over that of any two cells: 1 at random, 0 for a palm
# Noise that is measured in the frame: fits that may be made, factor within which two agree,
# standard deviations beyond which a reading is off.
_TRIES, _AGREE, _FAR = 6, 1.15, 3.0
_USUAL_NOISE = 3.0, 0.6  # readings that it counts for, and ADC steps RMS
_BROAD = 0.1  # share of cells at rest below which the whole skin counts as loaded


def map_estimate(reading: Reading, start: Estimate | None = None, prior=None) -> Estimate:
    """Most probable force, from `start` or from a few steps of the fixed point.

    A start may lead into a corner, and the estimate then be suspect: who keeps a stream's last
    frame lets go of it, and the next frame starts anew. Only then is a suspect frame asked for
    another r_par, which takes a few times as long: a touch that comes or goes is suspect, too.

    Args:
        prior: (mean, std), two (rows, cols) arrays or numbers [N], joined to the built-in prior as
            independent knowledge of each cell.
    """
    warm = start is not None
    g = last_guess(reading, start) if warm else first_guess(reading)
    if warm and prior is None and (held := _held(reading, start, g)) is not None:
        return held

    def fit(reading, g, warm=True):
        return _fit(reading, g, prior, warm)

    if warm and start.r_par is not None:
        found = series.follow(reading, fit, g, start.r_par)
        if found is not None and found.status == "ok":
            return series.named(found, reading)
    estimate = fit(reading, g, warm)
    if warm and estimate.status != "ok" and not reading.late():
        again = fit(reading, first_guess(reading), False)  # the start may lead into a corner
        estimate = estimate if again.status == "failed" else again
    if not reading.given:
        reading = replace(reading, noise=estimate.noise)
    if estimate.status == "suspect" and not reading.late():
        found = without_bad_contacts(reading, fit, estimate)
        if found is not None:
            return found
    if warm and estimate.status != "ok":
        return estimate
    return series.seek(reading, fit, estimate)


def _held(reading: Reading, start: Estimate, g: np.ndarray) -> Estimate | None:
    """The last frame's estimate if it explains this one as well: nothing has moved.

    Of readings that nothing changed, the misfit to the last fit is noise, and a little more for
    what that fit had taken of its own noise.
    """
    if start.method != "map" or start.status != "ok" or not reading.noise:
        return None
    noise = reading.noise if reading.given else start.noise
    residual = reading.residual(reading.circuit.ratio(laplacian.solve(g).rho))
    if residual**2 > noise**2 * (1.0 + _SAME * (2.0 / reading.told) ** 0.5):
        return None
    return replace(start, residual=residual, iterations=0)


def _fit(
    reading: Reading, g: np.ndarray, prior, warm: bool = False, tries: int = _TRIES
) -> Estimate:
    """Args:
    warm: g is next to the answer; a step that went as foretold is then the last one.
    tries: fits that may be made to find the noise, where it was not given.
    """
    circuit, begin, most = reading.circuit, g, WARM_STEPS if warm else START_STEPS
    g, steps = iterate(reading, g, most, _NEAR * reading.fitted_noise)
    g = fill(reading, g)
    if not reading.given and tries == _TRIES:
        reading = _with_noise_at_rest(reading, g)
    low = reading.bounds[0]
    at_rest = circuit.populated & (g < _NEAR_REST * low)
    broad = np.count_nonzero(at_rest) < _BROAD * np.count_nonzero(circuit.populated)
    broad = broad and is_level(reading, g)
    g = np.where(at_rest, low, g)
    point = _Point.at(reading, g, broad, prior)
    costs = [point.cost]
    iterations, settled = 0, False
    while iterations < STEPS:
        iterations += 1
        step = _gauss_newton(reading, point)
        if not step.solved:
            break
        point = _descend(reading, point, step, broad, prior, max(costs[-_MEMORY:]))
        costs.append(point.cost)
        # What is left to gain is what the quadratic got wrong of this step. A load on the whole
        # skin is judged by its cost, and so is fitted to the end.
        left = 2.0 * abs(costs[-2] - costs[-1] - step.gain)
        settled = step.gain < _SETTLED or (warm and not broad and left < _SETTLED)
        if settled or reading.late():
            break
    converged = step.solved and (settled or iterations == STEPS)
    if not reading.given and tries and converged and not reading.late():
        noise = _noise_left(reading, point, step)
        if noise is not None and not 1.0 / _AGREE < noise / reading.noise < _AGREE:
            again = reading.with_noise(noise)
            if again.noise != reading.noise:
                found = _fit(again, begin, prior, warm, tries - 1)
                return replace(found, iterations=found.iterations + steps + iterations)
    with np.errstate(divide="ignore"):
        force = reading.curve.force(1.0 / point.g) * circuit.populated
    std = _spread(reading, point, step, force)
    residual = reading.residual(point.adc)
    message = suspect.by_reading(reading)
    message = message or suspect.by_residual(reading, point.adc, ROUNDING_NOISE)
    if not message and step.jacobian is not None:
        # The fit may stop short of the minimum; the tests are for the minimum.
        rest = _downhill(point).flat[step.inside]
        ahead = lapack.spotrs(step.factor.T, rest, lower=1)[0]
        message = _by_score(reading, point, step, rest, ahead, broad, prior)
    status = "suspect" if message else "ok"
    if not converged:
        why = "no time to converge" if step.solved else "single precision holds no step"
        status, message = "failed", f"{why}: stopped after {iterations} steps"
    return Estimate(
        force, std, residual, status, message, "map", steps + iterations, noise=reading.noise
    )


def _with_noise_at_rest(reading: Reading, g: np.ndarray) -> Reading:
    """The reading with the noise of those cells that the first guess g [S] has at rest."""
    low = reading.bounds[0]
    at_rest = reading.known & reading.circuit.populated & (g < _NEAR_REST * low)
    adc = reading.circuit.ratio(laplacian.solve(np.where(at_rest, low, g)).rho)
    noise = noise_at_rest(reading.misfit(adc)[at_rest])
    return reading.with_noise(_USUAL_NOISE[1] if noise is None else noise)


def _noise_left(reading: Reading, point: _Point, step: _Step) -> float | None:
    """RMS noise [ADC steps] by what a fit leaves, of which it took a share for its unknowns.

    None: the fit cannot tell. A few readings that are far off do not count by how far, and where
    the unknowns take nearly all readings the noise is what boards usually have.
    """
    taken = 0.0
    if step.jacobian is not None and step.inside.size:
        if step.factor is None:
            return None
        taken = np.square(lapack.strtrs(step.factor, step.jacobian.T, trans=1)[0]).sum()
    left = reading.told - taken
    square = np.minimum(np.square(point.misfit), _FAR**2).sum() * reading.fitted_noise**2
    weight, usual = _USUAL_NOISE
    return float(((square + weight * usual**2) / (left + weight)) ** 0.5)


def _by_score(reading: Reading, point, step, rest, ahead, broad: bool, prior) -> str:
    """What the tests of the whole frame say, at the fit's minimum; empty if nothing.

    Args:
        rest: - d cost / d x of the unknowns; ahead: their step to the minimum.
    """
    rough = broad and _rough(reading, point)
    if rough and prior is None and reading.given:  # the cost is one of known noise
        message = suspect.by_cost(reading, point.cost - 0.5 * rest @ ahead)
        if message:
            return message
    found = suspect.by_score(
        reading,
        point.network.k,
        point.weight,
        point.misfit,
        step.told,
        step.jacobian,
        step.factor,
        ahead,
        point.g.flat[step.inside],
        broad,
    )
    right = (text for text, r_par in found if rough or series.confirmed(reading, point.g, r_par))
    return next(right, "")


def _rough(reading: Reading, point: _Point) -> bool:
    """Whether the whole skin is loaded hard, and each cell by chance, as the level prior says.

    Only then does what that prior does not explain speak against the circuit: a palm is smooth.
    """
    cells = reading.circuit.populated
    if np.median(point.network.rho[cells]) >= _HARD * series.series_scale(reading.circuit):
        return False
    x = np.where(cells, np.log(np.where(cells, point.g, 1.0)), np.nan)
    apart = [np.square(np.diff(x, axis=axis)).ravel() for axis in (0, 1)]
    spread = np.nanvar(x)
    return bool(spread > _UNEVEN**2 and np.nanmean(np.concatenate(apart)) > _ALIKE * 2.0 * spread)


class _Point(NamedTuple):
    """All that follows from one g; pictures are (rows, cols)."""

    g: np.ndarray  # S, the cells' conductance
    gx: np.ndarray  # S, d g / d x: of it what follows the curve
    network: laplacian.Network
    adc: np.ndarray  # ratio
    misfit: np.ndarray  # reading - model, in standard deviations
    weight: np.ndarray  # d misfit / d rho [1/ohm]; 0 for readings that say nothing here
    prior: prior_terms.Quadratic
    cost: float

    @classmethod
    def at(cls, reading: Reading, g: np.ndarray, broad: bool, extra) -> _Point:
        circuit, curve = reading.circuit, reading.curve
        noise = reading.spread
        network = laplacian.solve(g)
        adc = circuit.ratio(network.rho)
        misfit = reading.misfit(adc)
        misfit /= noise
        weight = adc * adc
        weight *= circuit.full_scale / (circuit.r_ref * noise)
        if not reading.plain:
            weight *= reading.known | (misfit < 0)
        cells = circuit.populated
        gx = g if curve.offset is None else g - curve.offset * cells
        at_rest = 1.0 / curve.points[0][1]
        x = np.log(gx if circuit.mask is None else np.where(cells, gx, at_rest))
        if broad or extra is not None:
            force = np.where(cells, curve.force(1.0 / np.where(cells, g, 1.0)), 0.0)
            slope = -curve.slope(force)
        if broad:
            terms = prior_terms.level(force, slope, cells)
        else:
            between = prior_terms.differences(circuit)
            terms = prior_terms.touches(x, np.log(at_rest), between)
        if extra is not None:
            terms = prior_terms.add(terms, prior_terms.known(force, slope, *extra, cells))
        flat = misfit.ravel()
        cost = 0.5 * (flat @ flat) + terms.value
        return cls(g, gx, network, adc, misfit, weight, terms, float(cost))

    @property
    def curvature(self) -> np.ndarray:
        """(rows, cols) of the cost over each cell's x, from its own reading and prior alone."""
        own = self.network.rho**2
        own *= self.weight
        own *= self.gx
        own *= own
        own += self.prior.diagonal
        return own


class _Step(NamedTuple):
    free: np.ndarray  # (n,) flat indices of the unknowns
    dx: np.ndarray  # (n,) change of log g
    gain: float  # predicted, in units of 1/2 chi^2
    factor: np.ndarray | None  # U of U^T U = precision over `inside`; None: it was done without
    inside: np.ndarray  # flat indices of the unknowns that met no bound
    told: np.ndarray | None  # flat indices of the readings that speak
    jacobian: np.ndarray | None  # (told, inside), in standard deviations
    solved: bool = True  # False: the numbers are beyond what its equations can hold


def _downhill(point: _Point) -> np.ndarray:
    """- d cost / d x (rows, cols), for all cells at once in O(lines^3)."""
    pull = laplacian.hessian_product(point.network.k, point.weight * point.misfit)
    pull *= point.gx
    pull -= point.prior.gradient
    return pull


def _gauss_newton(reading: Reading, point: _Point) -> _Step:
    low, high = reading.bounds
    g, gx, circuit = point.g, point.gx, reading.circuit
    slope = _downhill(point)
    # A cell at rest joins if alone it would gain something, next to what the best would gain: a
    # moved touch leaves misfit along its lines in cells that the next step finds at rest.
    alone = slope * np.abs(slope)  # with the slope's sign
    alone /= point.curvature + 1e-9
    if circuit.mask is not None:
        alone *= circuit.mask
    gain = max(_CAUSE, _JOIN * max(alone.max(), -alone.min()))
    moves = np.where(g <= low, alone >= gain, (g < high) | (slope < 0))
    free = np.flatnonzero(moves if circuit.mask is None else moves & circuit.mask)
    if not free.size:
        return _Step(free, np.zeros(0), 0.0, None, free, None, None)
    b = slope.flat[free]
    if free.size > _DENSE:
        dx = _conjugate_gradients(point, prior_terms.differences(circuit), free, b)
        solved = bool(np.isfinite(dx).all())
        return _Step(free, dx, 0.5 * b @ dx, None, free, None, None, solved)
    told = np.arange(g.size) if reading.plain else np.flatnonzero(point.weight)
    told = told.astype(np.int32)
    row, col = np.divmod(free.astype(np.int32), np.int32(circuit.cols))
    col += circuit.rows
    jacobian = laplacian.sensitivity(point.network.k, point.weight, told, row, col)
    jacobian *= gx.ravel()[free].astype(np.float32)
    precision = _precision(jacobian, point.prior, prior_terms.differences(circuit), free)
    here = g.ravel()[free]
    ends = ((bound.ravel()[free] - here) / gx.ravel()[free] for bound in (low, high))
    dx, factor, inside = solve_in_box(precision, b, *ends)
    # A factor of what single precision holds as infinite is none, though it may look like one.
    if factor is None or not np.isfinite(precision.diagonal()).all() or not np.isfinite(dx).all():
        return _Step(free, dx, 0.0, None, free, None, None, solved=False)
    return _Step(free, dx, 0.5 * b @ dx, factor, free[inside], told, jacobian[:, inside])


def _precision(jacobian, prior: prior_terms.Quadratic, between, free: np.ndarray) -> np.ndarray:
    """(n, n) of the cost over the n free cells, upper triangle: J^T J and the prior's."""
    precision = blas.ssyrk(1.0, jacobian.T, lower=1).T
    precision.reshape(-1)[:: free.size + 1] += prior.diagonal.ravel()[free]
    if prior.entries is None:
        return precision
    place = np.full(prior.diagonal.size, -1, np.int32)
    place[free] = np.arange(free.size)
    here, there = place[between.here], place[between.there]
    both = np.flatnonzero((here >= 0) & (there >= 0))
    precision[here[both], there[both]] += prior.entries[both]
    return precision


def _conjugate_gradients(point: _Point, between, free: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The Gauss-Newton step without its matrix: a product costs O(lines^3)."""
    diagonal = point.curvature.ravel()[free]
    picture = np.zeros(point.g.shape)
    k = point.network.k

    def product(p):
        picture.flat[free] = p
        rho = laplacian.hessian_product(k, point.gx * picture)
        data = point.gx * laplacian.hessian_product(k, point.weight**2 * rho)
        return (data + prior_terms.product(point.prior, picture, between)).ravel()[free]

    return conjugate_gradients(product, diagonal, b, steps=_CG_STEPS, target=1e-2)


def _descend(reading: Reading, point: _Point, step: _Step, broad: bool, extra, ceiling) -> _Point:
    """Take the step, or as much of it as stays below `ceiling`; the old point if none does."""
    if not step.free.size:
        return point
    low, high = (bound.ravel()[step.free] for bound in reading.bounds)
    dx = step.dx
    for _ in range(6):
        # in g: the readings are closer to linear in g than in log g
        change = np.minimum(np.maximum(dx, -0.9), 3.0) * point.gx.ravel()[step.free]
        g = point.g.copy()
        flat = g.reshape(-1)
        flat[step.free] = np.minimum(np.maximum(flat[step.free] + change, low), high)
        new = _Point.at(reading, g, broad, extra)
        if new.cost <= ceiling:
            return new
        dx = 0.4 * dx
    return point


def _spread(reading: Reading, point: _Point, step: _Step, force) -> np.ndarray:
    """One posterior standard deviation of the force (rows, cols) [N].

    Of the Gauss-Newton posterior for the free cells; from each one's own reading and prior alone
    for cells held at a bound.
    """
    std_x = 1.0 / np.sqrt(point.curvature + 1e-12)
    if step.factor is not None:
        std_x.flat[step.inside] = np.sqrt(inverse_diagonal(step.factor))
    std_x = np.minimum(_WIDEN * std_x, 10.0)
    curve = reading.curve
    resistance = curve.resistance(force)
    std = 0.5 * (curve.force(resistance * np.exp(-std_x)) - curve.force(resistance * np.exp(std_x)))
    return np.where(reading.circuit.populated, std, 0.0)
