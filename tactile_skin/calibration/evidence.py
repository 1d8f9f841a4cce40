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

# Times its conductance at rest from which on a cell is touched. A wrong circuit makes cells at rest
# seem touched, so the first rounds, which are far from the answer, take only the evident ones.
TOUCHED = 5.0, 2.0, 1.2
# The same, of a cell whose neighbours are unknown, too: fabric and cover carry 0.5 % of a touch to
# them (paper section IV), which is 5 % of their rest. Chosen with TOUCHED's last on 16 boards of
# 16 x 16 and 20 of 8 x 8 (tests/yardsticks/identify.py, seeds 140 to 159), scored on others. And
# where touches have soft rims: for those of fingers r_par would be found 5 % too high.
HARD, SOFT = 10.0, 2.0
_BESIDE = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
_FULL = 0.75  # share of touched cells from which on too few readings are left to ask
# chi^2 a reading up to which a frame is explained, and beyond which it is of no use: a wrong
# circuit leaves 2 to 5, a soft rim that is held at rest hundreds.
_EXPLAINED = 6.0, 30.0
# Share of a reading by which the circuit's model misses a sound skin's beyond that (creep, scans
# taken in turn), and standard deviations from which on a misfit counts less than its square: that
# of a bad contact, say.
_MODEL, _ODD = 0.001, 3.0
_STEPS = 6  # of Levenberg and Marquardt, a frame and round; the next round goes on
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
        conductance: (rows, cols) of the cells that explain it best [S].
        score: (2,) d(-chi^2 / 2) / d(r_par, r_line) past what the touched cells can take [1/ohm].
        information: (2, 2) of the same [1/ohm^2].
        by_rest: (2, readings) by how much the score changes with each reading of the rest
            [1/ohm/ADC step].
        chi2: of the fit.
        count: readings past the unknowns.
    """

    conductance: np.ndarray
    score: np.ndarray
    information: np.ndarray
    by_rest: np.ndarray
    chi2: float
    count: int


class Supposed:
    """A circuit, and the rest as it was measured if the circuit is that."""

    def __init__(self, circuit: Circuit, rest: Rest, hard: float):
        self.circuit, self._hard = circuit, hard
        self.rest = supposing(rest, circuit).conductance
        self._unit = np.ones(circuit.rows), np.ones(circuit.cols)
        self._stripes = circuit.stripes or (np.zeros(circuit.rows), np.zeros(circuit.cols))

    @cached_property
    def _shifts(self) -> list[np.ndarray]:
        """(rows, cols) [S/ohm] by which a cell at rest conducts more for each ohm more of r_par,
        and of r_line: so that the untouched skin reads what it read."""
        circuit, network = self.circuit, laplacian.solve(self.rest)
        cells = np.flatnonzero(circuit.populated)
        picture = np.zeros(circuit.shape)

        def product(p: np.ndarray) -> np.ndarray:
            picture.flat[cells] = p
            return laplacian.hessian_product(network.k, picture).flat[cells]

        shifts = []
        for pattern in self._patterns(network, self.rest):
            found = np.zeros(circuit.shape)
            diagonal = np.square(network.rho.flat[cells])
            found.flat[cells] = conjugate_gradients(
                product, diagonal, pattern.flat[cells], steps=300, target=1e-6
            )
            shifts.append(found)
        return shifts

    def _patterns(self, network, g: np.ndarray) -> list[np.ndarray]:
        """(rows, cols) d (two-terminal resistance) / d r_par, and / d r_line, of cells g."""
        by_line = lines.added_resistance(network.k, g, *self._unit)
        return [np.ones(g.shape), by_line]

    def evidence(
        self, adc: np.ndarray, noise: float, turn: int, g: np.ndarray | None = None
    ) -> Evidence | None:
        """Fit the touched cells of a frame, and see what is left.

        Args:
            adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
            noise: RMS of a reading [ADC steps].
            turn: how often the circuit was found anew before: which of TOUCHED to begin with. A
                touch with a soft rim needs the last, however far the circuit is.
            g: (rows, cols) conductance to begin with [S].

        Returns:
            None: nothing touches, or so much that the rest cannot be checked, or nothing explains
            the frame.
        """
        known = np.isfinite(adc)
        adc = np.where(known, adc, 0.0)
        if g is None:
            g = self._first_guess(adc, known)
        for threshold in TOUCHED[min(turn, len(TOUCHED) - 1) :]:
            found = self._past_touched(adc, known, noise, threshold, g)
            if found is None or found.chi2 < _EXPLAINED[0] * found.count:
                return found
        return found if found.chi2 < _EXPLAINED[1] * found.count else None

    def _past_touched(self, adc, known, noise: float, threshold: float, g) -> Evidence | None:
        """With the cells above a threshold of TOUCHED, and those beside hard ones, unknown."""
        circuit = self.circuit
        touched = circuit.populated & (g > threshold * self.rest)
        hard = circuit.populated & (g > self._hard * self.rest)
        free = (touched | binary_dilation(hard, _BESIDE)) & circuit.populated
        count = np.count_nonzero(free)
        if not count or count > _FULL * np.count_nonzero(known & circuit.populated):
            return None
        steps = adc * circuit.full_scale
        weight = known / np.sqrt(noise**2 + np.square(_MODEL * steps))  # 1/ADC steps
        fit = _Fit(self, adc, weight, np.flatnonzero(free).astype(np.int32))
        g, point = fit.run(np.where(free, g, self.rest))
        patterns = [
            pattern - laplacian.hessian_product(point.network.k, shift)
            for pattern, shift in zip(self._patterns(point.network, g), self._shifts, strict=True)
        ]
        by_rho = point.slope.ravel()  # of the misfit, in standard deviations an ohm
        jacobian = fit.jacobian(g, point)
        columns = np.stack([*(by_rho * p.ravel() for p in patterns), point.misfit.ravel()], 1)
        precision = jacobian.T @ jacobian
        precision[np.diag_indices(count)] *= 1.0 + _RIDGE
        left = columns - jacobian @ _solve(precision, jacobian.T @ columns)
        p, misfit = left[:, :2], left[:, 2]
        chi2, left = float(np.square(misfit).sum()), max(np.count_nonzero(known) - count, 1)
        trust = np.minimum(1.0, _ODD / np.maximum(np.abs(misfit), 1e-9))
        trust /= max(chi2 / left, 1.0)  # a frame that is explained badly says little
        weighed = (p * trust[:, None]).T
        by_rest = weighed * weight.ravel()
        return Evidence(g, -weighed @ misfit, weighed @ p, by_rest, chi2, left)

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

    def read(self, g: np.ndarray):
        """Network of ideal stripes, and ADC ratio (rows, cols), of cells g [S]."""
        network = laplacian.solve(g)
        added = lines.added_resistance(network.k, g, *self._stripes)
        return network, self.circuit.ratio(network.rho + added)


class _Point(NamedTuple):
    network: laplacian.Network
    misfit: np.ndarray  # (rows, cols) reading - model, in standard deviations
    slope: np.ndarray  # (rows, cols) d misfit / d (resistance before the reading) [1/ohm]
    chi: float


class _Fit:
    """The touched cells of one frame, all others at rest: Levenberg and Marquardt in log g."""

    def __init__(self, supposed: Supposed, adc, weight, unknown: np.ndarray):
        self._supposed, self._adc, self._weight = supposed, adc, weight
        self._unknown = unknown
        row, col = np.divmod(unknown, np.int32(supposed.circuit.cols))
        self._ends = row, col + np.int32(supposed.circuit.rows)
        self._readings = np.arange(adc.size, dtype=np.int32)

    def at(self, g: np.ndarray) -> _Point:
        circuit = self._supposed.circuit
        network, adc = self._supposed.read(g)
        misfit = (self._adc - adc) * circuit.full_scale * self._weight
        slope = adc * adc * (circuit.full_scale / circuit.r_ref) * self._weight
        return _Point(network, misfit, slope, float(np.square(misfit).sum()))

    def jacobian(self, g: np.ndarray, point: _Point) -> np.ndarray:
        """(readings, unknowns) d model / d log g, in standard deviations."""
        jacobian = laplacian.sensitivity(
            point.network.k, point.slope, self._readings, *self._ends
        ).astype(float)
        jacobian *= g.flat[self._unknown]
        return jacobian

    def run(self, g: np.ndarray) -> tuple[np.ndarray, _Point]:
        point, damping = self.at(g), 1e-3
        for _ in range(_STEPS):
            jacobian = self.jacobian(g, point)
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
