# SPDX-License-Identifier: Apache-2.0
"""The noise-aware inverse: least squares in ADC steps, force >= 0, and a prior.

    minimise  1/2 sum ((reading - u(x)) / noise)^2 + prior(x),   x = log g between its bounds
by projected Gauss-Newton. The Jacobian is analytic, d u_a / d x_b = u_a^2 / R_ref * t_ab^2 g_b
(docs/derivation.md).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..findings.finding import Finding, Kind
from ..physics.laplacian import conjugate_gradients
from ..physics.quadratic import solve_in_box
from ..physics.readouts import BOUND
from . import prior as prior_terms
from . import suspect
from .aside import without_bad_contacts
from .estimate import Estimate
from .fit import Fit, Step
from .fixed_point import START_STEPS, fill, first_guess, iterate, last_guess
from .prior import NormalEquations, Point
from .reading import NEAR_REST, OUTLIER, ROUNDING_NOISE, SCAN_NOISE, Reading, noise_at_rest

MAX_STEPS = 12  # of Gauss-Newton; bounds the time of readings that no circuit explains
_NEAR = 1.2  # residual over noise at which the fixed point has done its part
_SETTLED = 4.0  # gain in units of 1/2 chi^2 below which a step is the last
_SETTLED_SUM = 0.5  # the same where readings share a sum: little gain moves a hard load's level far
_ALONE = 1.5  # the same that one cell alone may gain then, where a fit did not begin near its end
# chi^2 that a cell at rest must gain alone to become an unknown; noise gains it in 1 of 70 cells.
_JOIN_CHI2 = 6.0
_JOIN_SHARE = 0.1  # of the best cell's gain, that it must gain as well
_MOST_JOIN = 40  # cells that join in one step: of more, most would be found at rest again
_DENSE = 600  # unknowns up to which a Cholesky factor is faster than conjugate gradients
# Of x that such gradients suppose of a cell at least: one that was not read and bears nothing has
# none of its own: the readings of others determine it.
_LEAST_CURVATURE = 1.0
# Last costs, of which a step must not exceed the largest: a bound met costs at first. Of a load on
# the whole skin the last one counts, or steps that are too long alternate between two pictures; but
# not where two may fit, since the way from the hardest one leads over higher costs.
_MEMORY = 4
_UNCHANGED = 2.2  # standard deviations of chi^2 up to which a frame is that of the same load
_ANOTHER = 1.3  # times the force of a lighter picture from which on a heavier one is another
_LIGHTEST = 0.5  # of its conductance at rest, that a cell keeps from which a cover lifts
_LIGHTER_STEPS = 2
# Noise that is measured in the frame (docs/derivation.md).
_MAX_FITS = 6  # that may be made
_LOUD = 2.0  # times `SCAN_NOISE`: a fit that did not know of it is no start for another
_USUAL_COUNT = 3.0  # readings, as which `SCAN_NOISE`, that boards usually have, counts


def map_estimate(reading: Reading, start: Estimate | None = None) -> Estimate:
    """Most probable force, from `start` or from a few steps of the fixed point.

    A start may lead to a bad local fit, so a suspect frame is solved again without it. What is
    doubted once the time is over, more time might explain. Where two pictures may explain a frame,
    both are sought, each from a start of its own.
    """
    reading, warm = reading.above_cut_off(), start is not None
    g = first_guess(reading) if start is None else last_guess(reading, start)
    same = None if start is None else _unchanged(reading, start, g)
    if same is not None:
        return same
    warm = warm and not reading.may_fit_two
    # What spoils a frame, as a bad contact, spoils many: the fit without a start then counts.
    bad = warm and start is not None and (start.aside is not None or start.status == "suspect")
    fit = _fit(reading, g if start is None else first_guess(reading)) if bad or not warm else None
    if fit is None or (bad and fit.status != "suspect"):
        cold, fit = fit, _fit(reading, g, warm=True)
        if fit.status != "ok" and (cold or not reading.late()):
            cold = cold or _fit(reading, first_guess(reading))
            fit = fit if cold.status == "failed" else cold
    # without cross-talk cells of any other circuit would fit as well
    if fit.status == "suspect" and reading.circuit.has_cross_talk and not reading.late():
        if not reading.noise_given:
            reading = replace(reading, noise=float(fit.reading.noise))
        if found := without_bad_contacts(reading, partial(_fit, warm=True), fit.g):
            return found
    estimate = fit.estimate()
    finding = estimate.finding
    if isinstance(finding, Finding) and _is_lighter(reading, estimate, finding):
        numbers = {**finding.numbers, suspect.LIGHTER: 1.0}
        return replace(estimate, finding=replace(finding, numbers=numbers))
    if reading.may_fit_two and estimate.status == "ok":
        return _unless_another(reading, estimate)
    if estimate.status != "suspect" or not reading.late() or suspect.by_reading(reading):
        return estimate
    finding = Finding(Kind.MISFIT, "late")
    return replace(estimate, message=str(finding), finding=finding)


def _unless_another(reading: Reading, estimate: Estimate) -> Estimate:
    """Return an estimate, or the heavier of two that explain the frame alike, which is suspect.

    The other one is sought from the hardest load on all cells.
    """
    n, noise = reading.n_informative, max(float(estimate.noise), ROUNDING_NOISE)
    known = replace(reading, noise=float(estimate.noise), noise_given=True)
    other = _fit(known, reading.circuit.populated * reading.bounds[1]).estimate()
    if reading.late():
        message = suspect.no_convergence(reading, int(estimate.iterations))
        return replace(estimate, status="failed", message=message)
    light, heavy = sorted((estimate, other), key=lambda found: float(found.force.sum()))
    least, most = float(light.force.sum()), float(heavy.force.sum())
    worse = n * (other.residual**2 - estimate.residual**2) / noise**2  # of chi^2
    if (
        other.status != "ok"
        or most < _ANOTHER * least
        or worse > suspect.CHI2_LIMIT * (2.0 * n) ** 0.5
    ):
        return estimate
    finding = Finding(Kind.MISFIT, "two pictures", numbers={"least": least, "most": most})
    return replace(heavy, status="suspect", message=str(finding), finding=finding)


def _unchanged(reading: Reading, start: Estimate, g: np.ndarray) -> Estimate | None:
    """Return the last frame's estimate if it explains this one as well: the load is the same.

    The misfit of readings of the same load to the last fit is noise, and a little more for the
    noise that that fit had absorbed.
    """
    if start.method != "map" or start.status != "ok" or not reading.noise:
        return None
    noise = reading.noise if reading.noise_given else start.noise
    residual = reading.residual(reading.model(g))
    if residual**2 > noise**2 * (1.0 + _UNCHANGED * (2.0 / reading.n_informative) ** 0.5):
        return None
    return replace(start, residual=residual, iterations=0)


def _fit(
    reading: Reading, g: np.ndarray, warm: bool = False, fits: int = _MAX_FITS, level=True
) -> Fit:
    """Fit the load to a reading.

    Args:
        warm: g is close to the answer; a step that went as predicted is then the last one.
        fits: that may be made to measure the noise, where it was not given.
        level: whether the load may be one of the level prior.
    """
    circuit, begin = reading.circuit, g
    g, steps = iterate(reading, g, START_STEPS, _NEAR * reading.fitted_noise)
    g = fill(reading, g)
    if not reading.noise_given and fits == _MAX_FITS:
        reading = _with_noise_at_rest(reading, g)
    low = reading.bounds[0]
    at_rest = circuit.populated & (g < NEAR_REST * low)
    broad = level and prior_terms.is_broad(circuit, at_rest) and prior_terms.is_level(reading, g)
    g = np.where(at_rest, low, g)
    point, step, iterations, settled = _converge(reading, Point(reading, g, broad), broad, warm)
    if broad and _leaves_level(reading, point):
        found = _fit(reading, point.model.g, warm, fits, level=False)
        return found._replace(iterations=found.iterations + steps + iterations)
    converged = step.solved and (settled or iterations == MAX_STEPS)
    if converged and not reading.late():
        again, g = reading, point.model.g
        if not reading.noise_given and fits:
            noise, close = _noise_left(reading, point, step), suspect.MEASURED_NOISE
            if not 1.0 / close < noise / reading.noise < close:
                again = reading.with_noise(noise)
            if broad or again.noise > _LOUD * SCAN_NOISE:
                g = begin
        if again.noise != reading.noise:
            found = _fit(again, g, warm, max(fits - 1, 0), level)
            return found._replace(iterations=found.iterations + steps + iterations)
    finding = suspect.by_reading(reading)
    finding = finding or suspect.by_residual(reading, point.model.adc, ROUNDING_NOISE)
    failure = "" if converged else suspect.no_convergence(reading, iterations)
    failure += "" if step.solved else ": the step exceeds single precision"
    return Fit(reading, point, step, broad, steps + iterations, finding, failure)


def _is_lighter(reading: Reading, estimate: Estimate, finding: Finding) -> bool:
    """Whether a misfit is that of cells that conduct less than at rest, but `_LIGHTEST` of it."""
    (free,) = reading.circuit.populated.ravel().nonzero()
    if "times" not in finding.numbers or free.size > _DENSE or reading.late():
        return False
    reading = reading if reading.noise_given else reading.with_noise(float(estimate.noise))
    low, high = (bound.ravel()[free] for bound in reading.bounds)
    g = reading.circuit.populated / reading.curve.resistance(estimate.force)
    for _ in range(_LIGHTER_STEPS):
        here = g.ravel()[free]
        model = reading.linearised(g, reading.fitted_noise)
        data = model.information(free, g)
        data.reshape(-1)[:: free.size + 1] += 1.0  # a cell that its reading hardly tells stays
        pull = (g * model.network.pull(model.weight * model.misfit)).ravel()[free]
        least, most = _LIGHTEST * low / here - 1.0, high / here - 1.0
        dx, solved, _ = solve_in_box(data, pull, least, most)
        if not solved or not np.isfinite(dx).all():
            return False
        g.flat[free] = here * (1.0 + dx)
    return suspect.by_residual(reading, reading.model(g), ROUNDING_NOISE) is None


def _converge(
    reading: Reading, point: Point, broad: bool, warm: bool
) -> tuple[Point, Step, int, bool]:
    """Gauss-Newton from a point: the last point and step, their number, whether that is the end."""
    costs = [point.cost]
    iterations, settled = 0, False
    shares = reading.circuit.readout_class.shares_sum
    least = _SETTLED_SUM if shares else _SETTLED
    memory = 1 if broad and not reading.may_fit_two else _MEMORY
    while iterations < MAX_STEPS:
        iterations += 1
        step = _gauss_newton(reading, point)
        if not step.solved:
            break
        point = _descend(reading, point, step, broad, max(costs[-memory:]))
        costs.append(point.cost)
        # What is left to gain is the error of the quadratic's prediction. A load on the whole skin
        # is tested by its cost, and is therefore fitted to the end.
        left = 2.0 * abs(costs[-2] - costs[-1] - step.gain)
        settled = step.gain < least or (
            left < least and not broad and (warm or _gain_alone(reading, point) < _ALONE)
        )
        if settled or reading.late() or (broad and _leaves_level(reading, point)):
            break
    return point, step, iterations, settled


def _gain_alone(reading: Reading, point: Point) -> float:
    """Return the most that one cell alone would gain, in units of 1/2 chi^2."""
    at_rest = point.model.g <= reading.bounds[0] * BOUND
    return 0.5 * float(np.where(at_rest, point.alone, np.abs(point.alone)).max())


def _leaves_level(reading: Reading, point: Point) -> bool:
    """Whether a fit with the level prior finds a load that does not cover the skin.

    The first guess lifts neighbours of a hard touch, which that prior lets go. Noise does the same
    to an even load, so it must be known.
    """
    at_rest = point.model.g < NEAR_REST * reading.bounds[0]
    return reading.noise_given and not prior_terms.is_broad(reading.circuit, at_rest)


def _with_noise_at_rest(reading: Reading, g: np.ndarray) -> Reading:
    """Return the reading with the noise of those cells that the first guess g [S] has at rest."""
    low = reading.bounds[0]
    at_rest = reading.known & reading.circuit.populated & (g < NEAR_REST * low)
    adc = reading.model(np.where(at_rest, low, g))
    noise = noise_at_rest(reading.misfit(adc)[at_rest])
    return reading.with_noise(SCAN_NOISE if noise is None else noise)


def _noise_left(reading: Reading, point: Point, step: Step) -> float:
    """RMS noise [ADC steps] by what a fit leaves, corrected for what its unknowns absorbed.

    The distance of outliers does not count; where the unknowns absorb nearly all readings, the
    noise is what boards usually have.
    """
    absorbed = 0.0 if step.equations is None else step.equations.absorbed
    left = reading.n_informative - absorbed
    misfit = suspect.beside_sums(reading, point.model.misfit)
    square = np.minimum(np.square(misfit), OUTLIER**2).sum() * reading.fitted_noise**2
    usual = _USUAL_COUNT * SCAN_NOISE**2
    return float(((square + usual) / (left + _USUAL_COUNT)) ** 0.5)


def _gauss_newton(reading: Reading, point: Point) -> Step:
    low, high = reading.bounds
    g, circuit = point.model.g, reading.circuit
    # A cell at rest joins if it alone would gain enough, compared with the best: a touch that moved
    # leaves misfit along its lines in cells that the next step finds at rest.
    slope, alone = point.slope, point.alone
    gain = max(_JOIN_CHI2, _JOIN_SHARE * max(alone.max(), -alone.min()))
    at_rest = g <= low * BOUND
    joins = at_rest & (alone >= gain)
    if np.count_nonzero(joins) > _MOST_JOIN:
        joins &= alone >= np.partition(alone[joins], -_MOST_JOIN)[-_MOST_JOIN]
    moves = joins | ~at_rest & ((g < high / BOUND) | (slope < 0))
    moves = moves if circuit.mask is None else moves & circuit.mask
    (free,) = moves.ravel().nonzero()
    if not free.size:
        return Step(free, np.zeros(0), 0.0)
    b, between = slope.flat[free], prior_terms.differences(circuit)
    if free.size > _DENSE:
        dx = _conjugate_gradients(point, between, free, b)
        solved = bool(np.isfinite(dx).all())
        return Step(free, dx, 0.5 * b @ dx, solved=solved)
    information = point.model.information(free, point.gx)
    precision = prior_terms.precision(information, point.prior, between, free)
    dx, solved, inside = solve_in_box(precision, b, *point.ends(free))
    # The factor of a matrix with overflows is unusable, though LAPACK may return one.
    if not solved or not np.isfinite(precision.diagonal()).all() or not np.isfinite(dx).all():
        return Step(free, dx, 0.0, solved=False)
    equations = NormalEquations(free, inside, information, precision)
    return Step(free, dx, float(0.5 * b @ dx), equations)


def _conjugate_gradients(point: Point, between, free: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solve for the Gauss-Newton step without its matrix: a product costs O(lines^3)."""
    diagonal = np.maximum(point.curvature.ravel()[free], _LEAST_CURVATURE)
    picture = np.zeros(point.gx.shape)
    network, square = point.model.network, point.model.weight**2

    def product(p):
        picture.flat[free] = p
        data = point.gx * network.pull(square * network.change(point.gx * picture))
        return (data + prior_terms.product(point.prior, picture, between)).ravel()[free]

    return conjugate_gradients(product, lambda r: r / diagonal, b)


def _descend(reading: Reading, point: Point, step: Step, broad: bool, ceiling) -> Point:
    """Take the step, or as much of it as stays below `ceiling`; the old point if none does."""
    if not step.free.size:
        return point
    dx = step.dx
    for _ in range(6):
        new = Point(reading, point.stepped(step.free, dx), broad)
        if new.cost <= ceiling:
            return new
        dx = 0.4 * dx
    return point
