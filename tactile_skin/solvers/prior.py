# SPDX-License-Identifier: Apache-2.0
"""What is likely of a touch before it is read (docs/derivation.md): the prior of `map`.

Works in x, the log of conductance over that at rest, in which a relative error is a difference.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ..learning import denoiser
from ..physics import compiled, quadratic
from ..physics.laplacian import Network
from ..physics.quadratic import inverse, solve_in_box
from ..physics.readouts.floating import Floating
from .reading import Linearised, Reading
from .suspect import CHI2_LIMIT

# Chosen on bodies of many sizes and textures (benchmarks/accuracy/prior.py).
SPREAD = 0.3  # of x, and of its differences between neighbours, below which they are drawn to 0
_BROAD = 0.1  # share of the cells at rest below which the whole skin is loaded
# Geary's contiguity ratio: 1 where neighbours differ as any two cells do. Touches on all of a skin
# have less than 0.45, loads that are independent in each cell more than 0.6, by first guesses of
# scans of 8x8 and 16x16 cells of all readouts (seed 555).
_ALIKE = 0.55
# Standard deviation of `Reading.supposed`, as a share of it. Chosen on 240 grounded boards (seeds 1
# and 2) of which 2 to 6 % was not read: more lie within two standard deviations than with 0.1, 0.2.
_SUPPOSED = 0.14
_MOST_FALL = -0.9  # of a cell's conductance, by which a step may change it
_MOST_RISE = 3.0  # the same
# The last step, `with_neighbours`.
_STEPS = 3  # at most; one nearly always


class Differences:
    """Which cells the prior compares: neighbours in a row and in a column.

    Attributes:
        weight: (differences,) of each one's cost weight/2 log(spread^2 + d^2): 1, or 0 where a cell
            is missing; first those to the right, then downwards.
        here, there: (differences,) int32, flat cells, here < there, that a difference joins.
    """

    def __init__(self, shape: tuple[int, int], cells: np.ndarray | None = None):
        cells = np.ones(shape, bool) if cells is None else cells
        n = np.arange(cells.size, dtype=np.int32).reshape(shape)
        pairs = ((n[:, :-1], n[:, 1:]), (n[:-1], n[1:]))
        self.here, self.there = (np.concatenate([p[k].ravel() for p in pairs]) for k in (0, 1))
        self.weight = 1.0 * (cells.ravel()[self.here] & cells.ravel()[self.there])


@lru_cache(maxsize=16)
def differences(circuit) -> Differences:
    """Between a circuit's cells; kept, as each step of a fit asks for them."""
    return Differences(circuit.shape, circuit.mask)


class Quadratic(NamedTuple):
    """A prior's quadratic majorant at some x; pictures are (rows, cols).

    Entries off the precision's diagonal lie where `Differences` says; None: there are none.
    """

    value: float
    gradient: np.ndarray
    diagonal: np.ndarray
    entries: np.ndarray | None


def touches(x: np.ndarray, between: Differences) -> Quadratic:
    """Most cells are at rest; neighbours are alike, with sharp edges.

    Each difference d has the cost 1/2 log(s^2 + d^2): small ones are drawn together, a large one,
    an edge, costs next to nothing more. Distance from rest costs log(1 + d/s): its slope at rest
    holds a cell there that noise alone would lift.

    Args:
        x: (rows, cols), 0 at rest and where there is no cell.
    """
    value, gradient, diagonal, entries = quadratic.roughness(x, between.weight, SPREAD**2)
    above = x + SPREAD
    value += float(np.log(above / SPREAD).sum())
    gradient += 1.0 / above
    return Quadratic(value, gradient, diagonal, entries)


def level(force: np.ndarray, slope: np.ndarray, cells: np.ndarray) -> Quadratic:
    """Return a load on the whole skin: each cell's force is uniform from 0 to one unknown level.

    The level is twice the mean force; a uniform spread has mean / sqrt(3). slope: d force / d x.
    """
    mean = force[cells].mean()
    if not mean > 0.0:  # a step that is too long; no load has that level
        nothing = np.zeros(force.shape)
        return Quadratic(np.inf, nothing, nothing, None)
    found = known(force, slope, mean, mean / 3**0.5, cells)
    # The level moves with the forces: without that, each step would lower all of them.
    lift = 3.0 * (np.square(force[cells] / mean).mean() - 1.0) / mean
    return found._replace(gradient=found.gradient - lift * np.where(cells, slope, 0.0))


def known(force, slope, mean, std, cells) -> Quadratic:
    """Return what is known of each force, mean and std [N], or of each x, whose slope is 1."""
    off = np.where(cells, (force - mean) / std, 0.0)
    rate = np.where(cells, slope / std, 0.0)
    return Quadratic(0.5 * np.square(off).sum(), off * rate, np.square(rate), None)


def force_of(reading, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(rows, cols) force of cells that conduct g [N], and d force / d x."""
    cells = reading.circuit.populated
    force = np.where(cells, reading.curve.force(1.0 / np.where(cells, g, 1.0)), 0.0)
    return force, -reading.curve.slope(force)


def pressed(reading: Reading, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(rows, cols) g as of cells that all rest as the curve says [S], which is d g / d x; and x.

    x is the log of it over that at rest; 0 where there is no cell.
    """
    curve, cells = reading.curve, reading.circuit.populated
    gx = g if curve.offset is None else g - curve.offset * cells
    return gx, np.log(np.where(cells, gx * curve.points[0][1], 1.0))


def is_broad(circuit, at_rest: np.ndarray) -> bool:
    """Whether nearly all cells are loaded, by (rows, cols) which are at rest."""
    cells = circuit.populated
    return bool(np.count_nonzero(at_rest & cells) < _BROAD * np.count_nonzero(cells))


def is_level(reading: Reading, g: np.ndarray) -> bool:
    """Whether neighbours under g (rows, cols) [S] are no more alike than any two cells."""
    x, between = pressed(reading, g)[1].ravel(), differences(reading.circuit)
    apart = between.weight @ np.square(x[between.here] - x[between.there])
    as_any = 2.0 * x[reading.circuit.populated.ravel()].var() * between.weight.sum()
    return bool(apart > _ALIKE * as_any)


@lru_cache(maxsize=4)
def _arrays(reading: Reading) -> tuple[np.ndarray, np.ndarray]:
    """Return what `compiled.point` takes of a reading that is not topped."""
    circuit, curve = reading.circuit, reading.curve
    offset = np.zeros(circuit.shape) if curve.offset is None else curve.offset * circuit.populated
    divider = circuit.r_ref, circuit.r_ref + circuit.r_par, circuit.full_scale
    said = reading.threshold, reading.noise, reading.fitted_noise, curve.points[0][1]
    return np.array([reading.adc, reading.known, reading.capped, offset]), np.array(divider + said)


class Point:
    """All that follows from one g in a fit; but for `model`, `prior` and `cost` (rows, cols).

    Attributes:
        model: of the frame.
        gx, x: `pressed` of g.
        prior: there.
        cost: in units of 1/2 chi^2.
        own: d reading / d x of each cell's own, in standard deviations.
        pull: - d (chi^2 / 2) / d x, for all cells at once in O(lines^3).
        slope: - d cost / d x.
        alone: chi^2 that each cell alone would gain, with its slope's sign.
    """

    def __init__(self, reading: Reading, g: np.ndarray, broad: bool):
        circuit, between, found = reading.circuit, differences(reading.circuit), None
        self._bounds = reading.bounds
        if not (broad or reading.topped.any()) and circuit.readout_class is Floating:
            found = compiled.point(g, *_arrays(reading), between.weight, SPREAD)
        if found is not None:
            (log_det, value, self.cost), k, pictures, entries = found
            rho, misfit, weight, self.gx, self.x, gradient, diagonal, *derived = pictures
            self.own, self.pull, self.slope, self.alone = derived
            network = Floating(circuit, g, Network(log_det, k, rho))
            self.model = Linearised(g, network, network.adc, misfit, weight)
            self.prior = Quadratic(value, gradient, diagonal, entries)
            return
        self.model = model = _supposing(reading, reading.linearised(g, reading.fitted_noise))
        self.gx, self.x = pressed(reading, g)
        if broad:
            self.prior = level(*force_of(reading, g), circuit.populated)
        else:
            self.prior = touches(self.x, between)
        self.cost = float(0.5 * np.vdot(model.misfit, model.misfit) + self.prior.value)
        self.own = model.network.own * model.weight * self.gx
        self.pull = self.gx * model.network.pull(model.weight * model.misfit)
        self.slope = self.pull - self.prior.gradient
        self.alone = circuit.populated * self.slope * np.abs(self.slope) / (self.curvature + 1e-9)

    @property
    def curvature(self) -> np.ndarray:
        """(rows, cols) of the cost over each cell's x, from its own reading and prior alone."""
        return np.square(self.own) + self.prior.diagonal

    def stepped(self, cells: np.ndarray, dx: np.ndarray) -> np.ndarray:
        """(rows, cols) g [S] after a step dx of the x of flat cells (n,), within their bounds.

        It is taken in g: the readings are closer to linear in g than in log g.
        """
        change = np.minimum(np.maximum(dx, _MOST_FALL), _MOST_RISE) * self.gx.ravel()[cells]
        low, high = (bound.ravel()[cells] for bound in self._bounds)
        g = self.model.g.copy()
        flat = g.reshape(-1)
        flat[cells] = np.minimum(np.maximum(flat[cells] + change, low), high)
        return g

    def ends(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps of x (n,) that lead flat cells to their bounds."""
        here, gx = self.model.g.ravel()[cells], self.gx.ravel()[cells]
        low, high = ((bound.ravel()[cells] - here) / gx for bound in self._bounds)
        return low, high


def _supposing(reading: Reading, model: Linearised) -> Linearised:
    """Return the model with what is supposed of cells that were not read as readings of theirs."""
    supposed = reading.supposed
    if not np.count_nonzero(supposed):
        return model
    weight = np.divide(1.0, _SUPPOSED * supposed, out=model.weight.copy(), where=supposed > 0.0)
    misfit = np.where(supposed > 0.0, (supposed - model.adc) * weight, model.misfit)
    return model._replace(misfit=misfit, weight=weight)


class NormalEquations:
    """The linear system of a fit's last step; x = log g of its unknowns, (n,) flat cells."""

    def __init__(self, free: np.ndarray, inside: np.ndarray, information, precision):
        self.unknowns, self._inside = free[inside], inside
        self._information, self._precision = information, precision

    @cached_property
    def information(self) -> np.ndarray:
        """Return J^T J of the unknowns (n, n), upper triangle."""
        kept = np.flatnonzero(self._inside)
        return self._information.take(kept, 0).take(kept, 1)

    @cached_property
    def inverse(self) -> np.ndarray:
        """Return the unknowns' covariance (n, n), upper triangle."""
        return inverse(self._precision, self._inside)

    @property
    def covariance(self) -> np.ndarray:
        """Return the unknowns' covariance (n, n), both triangles."""
        upper = np.triu(self.inverse).astype(float)
        return upper + np.triu(upper, 1).T

    @property
    def absorbed(self) -> float:
        """Return the number of readings that the unknowns take: trace(H^-1 J^T J)."""
        both = np.triu(self.inverse) * np.triu(self.information)
        return float(2.0 * both.sum() - both.trace())


def precision(information, prior: Quadratic, between: Differences, free: np.ndarray):
    """(n, n) of the cost over the n free cells, upper triangle: J^T J and the prior's."""
    total, entries = information.copy(), prior.entries
    if compiled.add_terms(total, prior.diagonal, entries, free):
        return total
    total.reshape(-1)[:: free.size + 1] += prior.diagonal.ravel()[free]
    if entries is None:
        return total
    place = np.full(prior.diagonal.size, -1, np.int32)
    place[free] = np.arange(free.size)
    here, there = place[between.here], place[between.there]
    both = np.flatnonzero((here >= 0) & (there >= 0))
    total[here[both], there[both]] += entries[both]
    return total


def product(terms: Quadratic, x: np.ndarray, between: Differences) -> np.ndarray:
    """Return the precision times x, (rows, cols)."""
    total = terms.diagonal * x
    if terms.entries is not None:
        for one, other in ((between.here, between.there), (between.there, between.here)):
            joined = np.bincount(one, terms.entries * x.ravel()[other], x.size)
            total += joined.reshape(x.shape)
    return total


def with_neighbours(
    reading: Reading, point: Point, equations: NormalEquations, std_x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return what the neighbours of each unknown say of it, after a fit, in place of `touches`.

    A fit knows some cells well, and some of a hard patch hardly at all. A small network
    (learning/denoiser.py) says from it what is likely of each cell, and how surely; one more step
    meets the readings with that as the only prior.

    Args:
        point: of the fit.
        std_x: (rows, cols) its standard deviation of x.

    Returns:
        g [S], standard deviation of x, ADC ratio, (rows, cols) each; None: the fit stays, as
        there is no step that meets the readings as well.
    """
    cells, free = reading.circuit.populated, equations.unknowns
    if not free.size:
        return None
    unknown = np.zeros(cells.shape, bool)
    unknown.flat[free] = True
    data = equations.information
    mean, std = denoiser.shipped()(point.x, std_x, point.own, unknown, cells)
    # what chi^2 rises by beyond chance is the step's curvature
    beyond = CHI2_LIMIT * (2.0 * reading.n_informative) ** 0.5
    limit = np.square(point.model.misfit).sum() + beyond
    for _ in range(_STEPS):
        terms = known(point.x, 1.0, mean, std, unknown)
        b = (point.pull - terms.gradient).ravel()[free]
        matrix = precision(data, terms, differences(reading.circuit), free)
        dx, solved, inside = solve_in_box(matrix, b, *point.ends(free))
        if not solved or not np.isfinite(dx).all():
            return None
        g = point.stepped(free, dx)
        adc = reading.model(g)
        if np.square(reading.misfit(adc) / reading.fitted_noise).sum() <= limit:
            std_x = std_x.copy()
            std_x.flat[free[inside]] = np.sqrt(inverse(matrix, inside).diagonal())
            return g, std_x, adc
        point = Point(reading, g, False)
        data = point.model.information(free, point.gx)
    return None
