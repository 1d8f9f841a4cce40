"""What one frame says of the circuit that is supposed (docs/derivation.md)."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.ndimage import binary_dilation

from ..physics import kernel, laplacian, lines
from ..physics.circuit import Circuit
from ..physics.conjugate_gradients import conjugate_gradients
from .rest import Rest, supposing

# Times its conductance at rest from which on a cell is evidently touched: noise is far below, even
# in the shadow of a hard touch. What else is touched is found by `_Z`.
_EVIDENT = 20.0
# The same, of a cell whose neighbours are unknown, too: fabric and cover carry 0.5 % of a touch to
# them (paper section IV), which is 5 % of their rest. And where touches have soft rims: with those
# of fingers held at rest, r_par would be found 1 % too high.
HARD, SOFT = 10.0, 2.0
_BESIDE = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
_FULL = 0.75  # share of touched cells from which on too few readings are left to ask
# Standard deviations by which a cell that is held at rest must want to conduct more to be touched,
# and how often such cells are sought. Noise must not choose them: a limit on a noisy estimate frees
# cells that read too high; those left, which read too low, make r_par seem 1 % too small.
_Z, _SEARCHES = 3.5, 3
_HIDDEN = 1e-3  # share of a cell's squared pattern below which the others can take it
# chi^2 a reading beyond which a frame is of no use: a wrong circuit leaves 2 to 5.
_EXPLAINED = 30.0
# Share of a reading by which the circuit's model misses a sound skin's beyond the noise (creep,
# scans in turn), and standard deviations from which a misfit counts less than its square: that of a
# bad contact, say.
_MODEL, _ODD = 0.0005, 3.0
_STEPS = 6  # of Levenberg and Marquardt, a frame and search of touched cells; the next goes on
_SETTLED = 0.5  # gain in chi^2 of a step that is the last
_HARDEST = 20.0  # ohm that a cell has at least
_ANY = 3.0  # standard deviation of a touched cell's log conductance: nothing is known of it
# Times the noise, RMS: by which a frame may differ from the one before, since a touch that moves is
# read row by row; and by which it differs from the last that was asked.
_STANDS, _NEW = 2.5, 4.0
_RIDGE = 1e-6  # of the touched cells' precision: the readings may not determine all of them


def stands_anew(adc, before, last, noise: float) -> bool:
    """Whether a touch stands, and is another one than the last that was asked.

    Args:
        adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
        before: a frame shortly before it; None: there is none.
        last: the last that was asked; None: there is none.
        noise: RMS of a reading, as ADC ratio.
    """
    if before is None or _rms(adc - before) > _STANDS * noise:
        return False
    return last is None or _rms(adc - last) > _NEW * noise


def _rms(values: np.ndarray) -> float:
    return float(np.nan_to_num(np.square(values)).mean() ** 0.5)


class Evidence(NamedTuple):
    """What one frame says of the circuit that is supposed.

    Attributes:
        score: (2,) d(-chi^2 / 2) / d(r_par, r_line) past what the touched cells can take [1/ohm].
        information: (2, 2) of the same [1/ohm^2].
        by_rest: (2, rows, cols) by how much the score changes with what each cell conducts at rest
            [1/ohm/S].
        chi2: of the fit.
        count: readings past the unknowns.
    """

    score: np.ndarray
    information: np.ndarray
    by_rest: np.ndarray
    chi2: float
    count: int


class Supposed:
    """A circuit, and the rest as it was measured if the circuit is that.

    Args:
        hard: HARD or SOFT.
        exact: whether stripes are taken beyond first order; the time is that of the literal network
            for each frame.
    """

    def __init__(self, circuit: Circuit, rest: Rest, hard: float, *, exact: bool = False):
        self.circuit, self._hard, self._exact = circuit, hard, exact
        self.rest = supposing(rest, circuit).conductance
        self._unit = np.ones(circuit.rows), np.ones(circuit.cols)
        self._stripes = circuit.stripes or (np.zeros(circuit.rows), np.zeros(circuit.cols))

    @cached_property
    def _shifts(self) -> list[np.ndarray]:
        """(rows, cols) [S/ohm] by which a cell at rest conducts more for each ohm more of r_par,
        and of r_line: so that the untouched skin reads what it read."""
        network = self._resting
        return [self._at_rest(p, 1e-6) for p in self._patterns(network, self.rest)]

    def by_reading(self, by_rest: np.ndarray) -> np.ndarray:
        """(2, readings) by how much a score changes with each reading of the rest [1/ohm/ADC step].

        Args:
            by_rest: of `Evidence`, or a sum of them.
        """
        circuit = self.circuit
        steps_per_ohm = np.square(circuit.ratio(self._resting.rho)) * (
            circuit.full_scale / circuit.r_ref
        )
        return np.array([(self._at_rest(b, 1e-3) / steps_per_ohm).ravel() for b in by_rest])

    @cached_property
    def _resting(self) -> laplacian.Network:
        return laplacian.solve(self.rest)

    def _at_rest(self, b: np.ndarray, target: float) -> np.ndarray:
        """(rows, cols) H^-1 b, H = - d (two-terminal resistance) / d (conductance) at rest."""
        circuit, network = self.circuit, self._resting
        cells = np.flatnonzero(circuit.populated)
        picture = np.zeros(circuit.shape)

        def product(p: np.ndarray) -> np.ndarray:
            picture.flat[cells] = p
            return laplacian.hessian_product(network.k, picture).flat[cells]

        found, diagonal = np.zeros(circuit.shape), np.square(network.rho.flat[cells])
        found.flat[cells] = conjugate_gradients(
            product, diagonal, b.flat[cells], steps=300, target=target
        )
        return found

    def _patterns(self, network, g: np.ndarray) -> list[np.ndarray]:
        """(rows, cols) d (two-terminal resistance) / d r_par, and / d r_line, of cells g."""
        by_line = lines.added_resistance(network.k, g, *self._unit)
        return [np.ones(g.shape), by_line]

    def evidence(self, adc: np.ndarray, noise: float) -> Evidence | None:
        """Fit the touched cells of a frame, and see what is left.

        Args:
            adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
            noise: RMS of a reading [ADC steps].

        Returns:
            None: nothing touches, or so much that the rest cannot be checked, or nothing explains
            the frame.
        """
        circuit, known = self.circuit, np.isfinite(adc)
        adc = np.where(known, adc, 0.0)
        g = self._first_guess(adc, known)
        touched = circuit.populated & (g > _EVIDENT * self.rest)
        if not touched.any():
            return None
        touched = circuit.populated & (
            touched | binary_dilation(g > self._hard * self.rest, _BESIDE)
        )
        steps = adc * circuit.full_scale
        weight = known / np.sqrt(noise**2 + np.square(_MODEL * steps))  # 1/ADC steps
        further = self._beyond_first_order(g)
        most = _FULL * np.count_nonzero(known & circuit.populated)
        for search in range(_SEARCHES + 1):
            if np.count_nonzero(touched) > most:
                return None
            fit = _Fit(self, adc, weight, np.flatnonzero(touched).astype(np.int32), further)
            g, point = fit.run(np.where(touched, g, self.rest))
            past = self._past_touched(g, point, touched, further)
            more = past.more if search < _SEARCHES else np.zeros(0, int)
            if not more.size:
                break
            touched.flat[more] = True
        count = max(np.count_nonzero(known) - np.count_nonzero(touched), 1)
        chi2 = float(np.square(past.misfit).sum())
        if chi2 > _EXPLAINED * count:
            return None
        trust = np.minimum(1.0, _ODD / np.maximum(np.abs(past.misfit), 1e-9))
        trust /= max(chi2 / count, 1.0)  # a frame that is explained badly says little
        weighed = (past.patterns * trust[:, None]).T
        by_rho = (weighed * point.slope.ravel()).reshape(2, *g.shape)
        by_rest = [~touched * laplacian.hessian_product(point.network.k, b) for b in by_rho]
        score, information = -weighed @ past.misfit, weighed @ past.patterns
        return Evidence(score, information, np.array(by_rest), chi2, count)

    def _past_touched(self, g, point: _Point, touched: np.ndarray, further) -> _Past:
        """What is left past what the touched cells can take, and held cells that are touched."""
        patterns = self._patterns(point.network, g)
        if further.any():  # it grows with the square of r_line
            patterns[1] = patterns[1] + 2.0 * further / np.max(np.concatenate(self._stripes))
        cells = np.flatnonzero(self.circuit.populated).astype(np.int32)
        jacobian = _jacobian(point, g, cells)
        free = touched.flat[cells]
        columns = [
            point.slope * (pattern - laplacian.hessian_product(point.network.k, shift))
            for pattern, shift in zip(patterns, self._shifts, strict=True)
        ]
        columns = np.stack([c.ravel() for c in (*columns, point.misfit)], 1)
        columns = np.concatenate([columns, jacobian[:, ~free]], 1)
        size = np.square(columns[:, 3:]).sum(0)
        absorbing = jacobian[:, free]
        precision = absorbing.T @ absorbing
        precision[np.diag_indices(len(precision))] *= 1.0 + _RIDGE
        left = columns - absorbing @ _solve(precision, absorbing.T @ columns)
        p, misfit = left[:, :2], left[:, 2]
        held = left[:, 2:] - p @ _solve(p.T @ p, p.T @ left[:, 2:])  # whatever the circuit is
        misfit_past, held = held[:, 0], held[:, 1:]
        spread = np.sqrt(np.maximum(np.square(held).sum(0), _HIDDEN * size))
        more = cells[~free][held.T @ misfit_past > _Z * spread]
        return _Past(p, misfit, more)

    def _beyond_first_order(self, g: np.ndarray) -> np.ndarray:
        """(rows, cols) [ohm] that stripes add to cells g beyond first order."""
        if not self._exact or not max(map(np.max, self._stripes)):
            return np.zeros(g.shape)
        network = laplacian.solve(g)
        added = lines.solve(g, *self._stripes).rho - network.rho
        return np.where(
            self.circuit.populated & np.isfinite(added),
            added - lines.added_resistance(network.k, g, *self._stripes),
            0.0,
        )

    def _first_guess(self, adc: np.ndarray, known: np.ndarray) -> np.ndarray:
        """(rows, cols) [S]: the fixed point, from rest."""
        circuit = self.circuit
        cells = np.flatnonzero(circuit.populated & known).astype(np.int32)
        rho = np.maximum(circuit.two_terminal(np.maximum(adc, 1e-6)), 1.0).flat[cells]
        low = np.log(0.5 * self.rest.flat[cells])
        high = np.full(cells.size, -np.log(_HARDEST))
        found, _ = kernel.fixed_point(
            self.rest, cells, rho, low, high, r_ref=circuit.r_ref, r_par=circuit.r_par,
            goal=cells.size / circuit.full_scale**2, steps=60, deadline=np.inf,
        )  # fmt: skip
        return found

    def read(self, g: np.ndarray, further: np.ndarray):
        """Network of ideal stripes, and ADC ratio (rows, cols), of cells g [S].

        Args:
            further: (rows, cols) [ohm] that the stripes add beyond first order.
        """
        network = laplacian.solve(g)
        added = lines.added_resistance(network.k, g, *self._stripes) + further
        return network, self.circuit.ratio(network.rho + added)


class _Point(NamedTuple):
    network: laplacian.Network
    misfit: np.ndarray  # (rows, cols) reading - model, in standard deviations
    slope: np.ndarray  # (rows, cols) d misfit / d (resistance before the reading) [1/ohm]
    chi: float


class _Past(NamedTuple):
    patterns: np.ndarray  # (readings, 2) d misfit / d (r_par, r_line) [1/ohm]
    misfit: np.ndarray  # (readings,) in standard deviations
    more: np.ndarray  # flat cells that are touched, too


def _jacobian(point: _Point, g: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(readings, cells) d model / d log g, in standard deviations."""
    rows, cols = g.shape
    row, col = np.divmod(cells, np.int32(cols))
    readings = np.arange(g.size, dtype=np.int32)
    jacobian = laplacian.sensitivity(
        point.network.k, point.slope, readings, row, col + np.int32(rows)
    )
    return jacobian * g.flat[cells]


class _Fit:
    """The touched cells of one frame, all others at rest: Levenberg and Marquardt in log g."""

    def __init__(self, supposed: Supposed, adc, weight, unknown: np.ndarray, further):
        self._supposed, self._adc, self._weight = supposed, adc, weight
        self._unknown, self._further = unknown, further

    def at(self, g: np.ndarray) -> _Point:
        circuit = self._supposed.circuit
        network, adc = self._supposed.read(g, self._further)
        misfit = (self._adc - adc) * circuit.full_scale * self._weight
        slope = adc * adc * (circuit.full_scale / circuit.r_ref) * self._weight
        return _Point(network, misfit, slope, float(np.square(misfit).sum()))

    def run(self, g: np.ndarray) -> tuple[np.ndarray, _Point]:
        point, damping = self.at(g), 1e-3
        for _ in range(_STEPS):
            jacobian = _jacobian(point, g, self._unknown)
            precision = jacobian.T @ jacobian
            diagonal = precision.diagonal().copy()
            pull = jacobian.T @ point.misfit.ravel()
            before = point.chi
            while damping < 1e3:
                precision[np.diag_indices(diagonal.size)] = diagonal * (1.0 + damping) + _ANY**-2
                step = np.clip(_solve(precision, pull), -1.5, 1.5)
                new = g.copy()
                moved = g.flat[self._unknown] * np.exp(step)
                new.flat[self._unknown] = np.minimum(moved, 1.0 / _HARDEST)
                trial = self.at(new)
                if trial.chi <= before:
                    g, point = new, trial
                    break
                damping *= 8.0
            damping = max(damping / 10.0, 1e-6)
            if before - point.chi < _SETTLED:
                break
        return g, point


def _solve(precision: np.ndarray, b: np.ndarray) -> np.ndarray:
    """precision^-1 b, of a positive definite matrix."""
    _, x, bad = lapack.dposv(precision, b)
    return np.linalg.lstsq(precision, b, rcond=None)[0] if bad else x
