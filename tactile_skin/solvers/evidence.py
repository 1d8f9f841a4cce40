# SPDX-License-Identifier: Apache-2.0
"""What one frame says of the resistances that lie in series (docs/derivation.md).

Untouched cells conduct what they did at rest, touched ones anything. An ohm more of r_par changes
the readings by a pattern; what the touched cells can take of it is projected out of it, and out of
the misfit. What is left of both gives a score and its information, which add up over frames.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.ndimage import binary_dilation

from ..physics import laplacian, lines, readouts
from ..physics.adc import Adc
from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from .fixed_point import MAX_STEPS, fill, first_guess, iterate
from .reading import OUTLIER, Linearised, check_reading

# Times its conductance at rest from which on a cell is evidently touched: noise is far below, even
# in the shadow of a hard touch. What else is touched is found by `_Z`.
_EVIDENT = 20.0
# The same, of a cell whose neighbours are unknown, too: fabric and cover carry 0.5 % of a touch to
# them (paper section IV), which is 5 % of their rest. And where touches have soft rims: with those
# of fingers held at rest, r_par would be found 1 % too high.
HARD = 10.0
SOFT = 2.0
# Share of its diagonal by which a matrix that is singular to single precision is made regular: near
# a bound of the curve's range, or where readings do not determine all of the touched cells.
_RIDGE = 1e-5
_FULL = 0.75  # share of touched cells from which on too few readings are left to ask
# Standard deviations by which a cell that is held at rest must want to conduct more to be touched,
# and how often such cells are sought. Noise must not choose them: a limit on a noisy estimate frees
# cells that read too high; those left, which read too low, make r_par seem 1 % too small.
_Z = 3.5
_SEARCHES = 3
_HIDDEN = 1e-3  # share of a cell's squared pattern below which the others can take it
# chi^2 a reading, that no other r_par or r_line takes, beyond which a frame is of no use.
_EXPLAINED = 30.0
# Share of a reading, and of what a cell conducts, by which the circuit's model misses a sound skin
# beyond the noise (creep, scans in turn).
MODEL = 0.0005
MIN_SCALE = 0.15  # of r_ref: what a board's r_par may be where none is configured
_MOST_PARTS = 300.0  # ohm, the same whatever r_ref is: two CD4051 have 250 at 5 V, and more below
_CUT_OFF = 3.0  # ADC steps from the converter's ends within which a reading's noise is cut off
_STEPS = 6  # of Levenberg and Marquardt, a frame and search of touched cells; the next goes on
_SETTLED = 0.5  # gain in chi^2 of a step that is the last
RELEVANT = 0.025  # of `series_scale`: less moves hard touches by 8 to 25 g a cell
REST_FRAMES = 40  # whose mean the rest of a running skin is taken for
HARDEST = 0.002  # times r_ref that a cell has at least: 20 ohm beside 10 kohm
_ANY = 3.0  # standard deviation of a touched cell's log conductance: nothing is known of it


def series_scale(circuit: Circuit) -> float:
    """Return the series resistance that errors of r_par are compared with [ohm]: r_par may be 0."""
    scale = MIN_SCALE * circuit.r_ref
    if not circuit.readout_class.shares_sum:  # else readings tell r_ref + r_par, to a share
        scale = min(scale, _MOST_PARTS)
    return max(circuit.r_par, scale)


def past(columns: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Return what unknowns leave of changes of the readings, (readings, k) in standard deviations.

    Args:
        columns: (readings, k).
        jacobian: (readings, n) d model / d x of the unknowns, x = log of a conductance.
    """
    precision = jacobian.T @ jacobian
    precision.reshape(-1)[:: len(precision) + 1] *= 1.0 + _RIDGE
    return columns - jacobian @ solve(precision, jacobian.T @ columns)


def solve(precision: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return precision^-1 b, of a matrix that is positive definite, or hardly."""
    posv = lapack.sposv if precision.dtype == np.float32 else lapack.dposv
    _, x, bad = posv(precision, b)
    return np.linalg.lstsq(precision, b, rcond=None)[0] if bad else x


class Evidence(NamedTuple):
    """What one frame says of the circuit that is supposed.

    Attributes:
        score: (2 + k,) d(-chi^2 / 2) / d(r_par, `Readout.second`) past what the touched cells can
            take [1/ohm]; 0 where the latter is not modelled; and by `Adc.bends`.
        information: (2 + k, 2 + k) of the same [1/ohm^2].
        by_rest: (2 + k, rows, cols) by how much the score changes with what each cell conducts at
            rest [1/ohm/S].
        chi2: of the fit.
        count: readings past the unknowns.
    """

    score: np.ndarray
    information: np.ndarray
    by_rest: np.ndarray
    chi2: float
    count: int  # type: ignore[assignment]  # a tuple has a method of this name


class Supposed:
    """A circuit, and what its cells conduct at rest.

    Args:
        rest: (rows, cols) conductance of each cell at rest [S], as it is measured with the circuit.
        hard: HARD or SOFT.
        exact: whether stripes are taken beyond first order; the time is that of the literal network
            for each frame.
        end: ADC ratio at which the converter ends.
        adc: whose bends are asked for, too; None: none are.
    """

    def __init__(
        self,
        circuit: Circuit,
        rest: np.ndarray,
        hard: float,
        *,
        exact: bool = False,
        end: float = 1.0,
        adc: Adc | None = None,
    ):
        self._adc = adc or Adc(circuit)
        self.circuit, self._hard, self._exact, self._end = circuit, hard, exact, end
        self.rest = rest
        self._cells = np.flatnonzero(circuit.populated).astype(np.int32)
        # of any cell: between half of its own rest and the hardest
        hardest = HARDEST * circuit.r_ref
        softest = np.full(circuit.shape, 2.0 * hardest)
        softest.flat[self._cells] = np.maximum(2.0 * hardest, 2.0 / self.rest.flat[self._cells])
        self._curve = PressureCurve((0.0, 1.0), (softest.max(), hardest)).resting_at(softest)

    @cached_property
    def _resting(self) -> readouts.Readout:
        return readouts.solve(self.circuit, self.rest).behind_stripes(np.zeros(self.circuit.shape))

    @cached_property
    def _shifts(self) -> list[np.ndarray]:
        """(rows, cols) [S/ohm] that resting cells conduct more for an ohm of r_par; of the others.

        So the untouched skin reads what it read.
        """
        resting, other = self._resting, self._resting.by_second
        if other.any():
            other = resting.cells_for(self._cells, -other)
        bends = [resting.cells_for(self._cells, -b) for b in self._adc.bends(resting.adc)]
        return [resting.cells_for(self._cells, -resting.by_r_par), other, *bends]

    def by_reading(self, by_rest: np.ndarray) -> np.ndarray:
        """(2 + k, readings) change of a score with each reading of the rest [1/ohm/ADC step].

        Args:
            by_rest: of `Evidence`, or a sum of them.
        """
        found = [self._resting.readings_for(self._cells, b).ravel() for b in by_rest]
        return np.array(found) / self.circuit.full_scale

    def evidence(self, adc: np.ndarray, noise: float) -> Evidence | None:
        """Fit the touched cells of a frame, and see what is left.

        Args:
            adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
            noise: RMS of a reading [ADC steps].

        Returns:
            None: nothing touches, or so much that the rest cannot be checked, or nothing explains
            the frame.
        """
        circuit = self.circuit
        reading = check_reading(adc, circuit, self._curve, missing=True, noise=noise)
        g = first_guess(reading)
        if not circuit.has_ideal_drivers:  # else it is the solution
            g, _ = iterate(reading, self.rest, MAX_STEPS, 1.0)
        g = fill(reading, g)
        further = self._beyond_first_order(g)
        touched = circuit.populated & (g > _EVIDENT * self.rest)
        if not touched.any():
            return None
        touched = circuit.populated & (touched | binary_dilation(g > self._hard * self.rest))

        std = np.sqrt(noise**2 + np.square(MODEL * reading.steps))

        def at(g: np.ndarray) -> Linearised:
            return reading.linearised(g, std, readouts.solve(circuit, g).behind_stripes(further))

        expected = at(np.where(touched, g, self.rest)).adc
        width = _CUT_OFF / circuit.full_scale
        # by the model: noise must not choose
        cut_off = (expected < self._adc.range[0] + width) | (expected > self._end - width)
        reading = replace(reading, known=reading.known & ~cut_off)
        hardest = 1.0 / (HARDEST * circuit.r_ref)  # S
        most = _FULL * np.count_nonzero((reading.known | reading.capped) & circuit.populated)
        for search in range(_SEARCHES + 1):
            if np.count_nonzero(touched) > most:
                return None
            model = _fit(at, np.where(touched, g, self.rest), np.flatnonzero(touched), hardest)
            g = model.g
            patterns, misfit, by_no_circuit, more = self._past_touched(model, touched, further)
            if search == _SEARCHES or not more.size:
                break
            touched.flat[more] = True
        count = max(reading.n_informative - int(np.count_nonzero(touched)), 1)
        unexplained = float(np.square(by_no_circuit).sum()) / count
        if unexplained > _EXPLAINED:
            return None
        trust = np.minimum(1.0, OUTLIER / np.maximum(np.abs(by_no_circuit), 1e-9))
        trust /= max(unexplained, 1.0)  # a frame that is explained badly says little
        weighed = (patterns * trust[:, None]).T
        by_adc = model.weight * weighed.reshape(-1, *g.shape)
        by_rest = [~touched * model.network.pull(b) for b in by_adc]
        score, information = -weighed @ misfit, weighed @ patterns
        chi2 = float(np.square(misfit).sum())
        return Evidence(score, information, np.array(by_rest), chi2, count)

    def _patterns(self, model: Linearised, further: np.ndarray) -> list[np.ndarray]:
        """(rows, cols) d misfit / d r_par, and / d r_line or r_drive [1/ohm]; / d each bend."""
        network = model.network
        changes = [network.by_r_par, network.by_second, *self._adc.bends(network.adc)]
        if further.any():  # it grows with the square of r_line
            more = network.by_r_par * 2.0 * further / np.max(self.circuit.r_line)
            changes[1] = changes[1] + more
        return [
            -model.weight * (change + network.change(shift))
            for change, shift in zip(changes, self._shifts, strict=True)
        ]

    def _past_touched(self, model: Linearised, touched: np.ndarray, further) -> tuple:
        """Return what the touched cells cannot take, and the held cells that are touched.

        Returns:
            (readings, 2 + k) `_patterns`, (readings,) misfit, what no circuit takes, flat cells.
        """
        jacobian = _jacobian(model, self._cells)
        free = touched.flat[self._cells]
        pictures = (*self._patterns(model, further), model.misfit)
        columns = np.stack([picture.ravel() for picture in pictures], 1)
        columns = np.concatenate([columns, jacobian[:, ~free]], 1)
        k = len(pictures) - 1
        size = np.square(columns[:, k + 1 :]).sum(0)
        left = past(columns, jacobian[:, free])
        patterns, misfit = left[:, :k], left[:, k]
        held = past(left[:, k:], patterns)  # whatever the circuit is
        by_no_circuit, held = held[:, 0], held[:, 1:]
        spread = np.sqrt(np.maximum(np.square(held).sum(0), _HIDDEN * size))
        more = self._cells[~free][held.T @ by_no_circuit > _Z * spread]
        return patterns, misfit, by_no_circuit, more

    def _beyond_first_order(self, g: np.ndarray) -> np.ndarray:
        """(rows, cols) [ohm] that stripes add to cells g beyond first order."""
        stripes = self.circuit.stripes
        if not self._exact or stripes is None:
            return np.zeros(g.shape)
        network = laplacian.solve(g)
        further = lines.solve(g, *stripes) - network.rho
        further -= lines.added_resistance(network.k, g, *stripes)
        return np.where(self.circuit.populated & np.isfinite(further), further, 0.0)


def _jacobian(model: Linearised, cells: np.ndarray) -> np.ndarray:
    """Return (readings, cells) d model / d log g, in standard deviations."""
    readings = np.arange(model.g.size, dtype=np.int32)
    return model.jacobian(readings, cells) * model.g.flat[cells]


def _fit(at, g: np.ndarray, unknown: np.ndarray, most: float) -> Linearised:
    """Fit the unknown cells of a frame, by its model `at` g: Levenberg and Marquardt in log g."""
    model, damping = at(g), 1e-3
    chi2 = np.square(model.misfit).sum()
    for _ in range(_STEPS):
        jacobian = _jacobian(model, unknown)
        precision = jacobian.T @ jacobian
        diagonal = precision.diagonal().copy()
        pull = jacobian.T @ model.misfit.ravel()
        before = chi2
        while damping < 1e3:
            precision[np.diag_indices(diagonal.size)] = diagonal * (1.0 + damping) + _ANY**-2
            step = np.clip(solve(precision, pull), -1.5, 1.5)
            new = model.g.copy()
            new.flat[unknown] = np.minimum(new.flat[unknown] * np.exp(step), most)
            trial = at(new)
            if (now := np.square(trial.misfit).sum()) <= before:
                model, chi2 = trial, now
                break
            damping *= 8.0
        damping = max(damping / 10.0, 1e-6)
        if before - chi2 < _SETTLED:
            break
    return model
