# SPDX-License-Identifier: Apache-2.0
"""What each cell conducts while nothing touches, followed as the fabric ages, creeps and warms.

A fabric's cells differ at rest, and drift. `PressureCurve.resting_at` gives that to the solvers;
here it is measured, in the pauses between touches. The first measurement takes whatever level a
fabric may rest at, of readings that do not change; from then on nothing is measured during a touch,
nor shortly after. A cell that bears `touched.RESTS` more than the median cell, by the curve, is
not at rest. A line that conducts less is not the fabric's doing, and is not followed. Where the
curve begins so high that an untouched cell reads about 0, the skin is open at rest: its rest is
measured once, and says nothing of the cables.
"""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np

from ..findings.finding import Finding, Kind, largest
from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from ..physics.readouts import apparent
from ..solvers.reading import FEW, MAX_NOISE, SCAN_NOISE, rest_reading
from ..solvers.suspect import BEYOND
from .at_rest import (
    LEAST_STEPS,
    NO_REST,
    odd_cell,
    one_voltage,
    open_up_to,
    weak_line,
    which_are_one,
)
from .rest import HALF_STEP, resting_conductance
from .touched import AT_REST, TOUCHED

# Conductance of the usual cell over the curve's at rest, between which any fabric may lie: chosen,
# 4.5 g on each cell of the shipped curve conduct three times as much. It may be more of a skin that
# bears no more than a cover by its curve [N].
_LOWEST_LEVEL = 0.1
_HIGHEST_LEVEL = 3.0
_COVER = 6.0
# Share by which a reading may move between the halves of a measurement and after it, beside its
# noise; share of the cells that may move more, with a bad contact.
_STILL_SHARE = 0.01
_RESTLESS = 0.02
_ALIKE_FRAMES = 1000  # that are looked at together while they are alike
_TRIES = 5  # measurements that held a touch, or seemed to, after which to say so
_OF_CHANGES = np.pi**0.5 / 2  # standard deviation over the mean change of one to the next, normal
_WINDOW = 1.0  # s that a measurement takes, and that a fabric recovers for after a touch
_QUIET_AFTER = 0.1  # s without a touch that must follow it: an onset is too weak to feel
_GAIN = 0.5  # share of the change, of the rest and of its noise, that a later measurement adds
# Changes of log conductance that are no fabric's, chosen on simulated boards (tests/calibration;
# benchmarks.faults): of all cells from what is known, and besides in each second, as a robot's
# cover warms up.
_MAX_STEP = 0.1
_MAX_DRIFT = 0.02 / 60.0
_DRIFTS_AFTER = 0.3  # s of rest after which a drift of all cells is followed
DRIFT = 0.003  # 1/s, of log conductance, that is followed at most
DRIFT_UNSEEN = 5.0  # s for which it is made up for, after a touch that hid it
_LEVEL_FRAMES = 4  # in a row, at or below a level that readings then had before any measurement


class Tare:
    """Follows the rest of one skin.

    Attributes:
        curve: the given curve, with the cells' offsets once they are known.
        found: why the last measurement could not be used; None: it could.
        measured: whether there was one that could.
        unseen: whether nothing shows yet that a matrix at rest is read: no second of rest has gone
            by, or all cells read alike in it, where those of a fabric would not, or conduct what
            no fabric of this curve does, or readings have risen since the start.
        noise: RMS of a usual reading at rest [ADC steps]; None: not measured yet.
        noted: lines that are one, or a cell unlike the others, by the last measurement; None: there
            is none. The rest is followed all the same.
        opens: ADC ratio up to which nothing touches a skin that is open at rest; 0: it is none, by
            the curve or by what it was found to read.
    """

    def __init__(self, circuit: Circuit, curve: PressureCurve, floor: float = 0.0):
        """Follow the rest of a skin; floor: ADC ratio below which its ADC reads 0."""
        self.curve, self.measured, self.unseen = curve, False, True
        self.found: Finding | None = None
        self.noted: Finding | None = None
        self.noise: float | None = None
        self._learned = -np.inf  # s, when the rest was measured last
        self._first: np.ndarray | None = None  # (rows, cols) [S] that was measured first
        self._circuit = circuit
        self._few = max(1.0, _RESTLESS * np.count_nonzero(circuit.populated))  # odd cells
        at_rest = curve.points[0][1]
        self.opens = open_up_to(circuit, curve, floor)
        self._max_factor = at_rest / float(curve.resistance(AT_REST))  # as a factor of conductance
        self._last = -np.inf  # s, when the last frame was read
        self._restless = 0  # measurements in a row whose parts differed
        self._alike = np.zeros(circuit.shape), 0  # sum and frames of seconds that read alike
        # (rows, cols) as `_conducts`, lowest level before any measurement: readings of a line that
        # share their sum fall under a touch, what a crossing conducts does not
        self._lowest = np.full(circuit.shape, np.inf)
        self._level: deque[np.ndarray] = deque(maxlen=_LEVEL_FRAMES)  # the last frames
        self._begin(-np.inf)
        self._quiet = self._followed = -np.inf  # s, when a touch was last, and a drift followed
        self._drifted: tuple[float, np.ndarray] | None = None  # s, and what was read then

    def suppose(self, circuit: Circuit) -> None:
        """Suppose the same readings at rest, of another circuit; ValueError: no skin reads so."""
        before = 1.0 / self.curve.rest_resistance
        adc = rest_reading(self._circuit, self.curve)
        now = resting_conductance(adc, circuit, SCAN_NOISE / FEW**0.5)
        cells = circuit.populated
        self.curve = self.curve.resting_at(np.where(cells, 1.0 / np.where(cells, now, 1.0), 1.0))
        if self._first is not None:
            self._first = np.where(cells, self._first * now / before, self._first)
        self._circuit = circuit

    def _begin(self, after: float) -> None:
        """Measure anew, from `after` [s] on."""
        self._after = after
        self._times: list[float] = []
        self._frames: list[np.ndarray] = []

    def update(self, t: float, adc: np.ndarray, force: np.ndarray) -> bool:
        """Take a frame.

        Args:
            t: when it was read [s]. On ROS that is the time of day: set back, it begins again.
            adc: (rows, cols) ADC ratio.
            force: (rows, cols) that was found in it [N].

        Returns:
            whether `curve` changed.
        """
        if t < self._last:
            self._learned = -np.inf  # how long ago is unknown, and whether a pause is over
            self._quiet, self._followed, self._drifted = t, t, None
            self._begin(t + _WINDOW)
        elif self.measured and force.max() > TOUCHED:
            self._begin(t + _WINDOW)
        elif t - self._last > _WINDOW:  # what lies between was not seen
            self._begin(t)
        if force.max() > AT_REST:
            self._quiet, self._drifted = t, None
        self._last = t
        if not self.measured:
            self._level.append(_conducts(self._circuit, adc))
            if len(self._level) == _LEVEL_FRAMES:
                self._lowest = np.minimum(self._lowest, np.max(self._level, axis=0))
        followed = self.measured and not self.opens and self._follow(t, adc)
        if t >= self._after and t not in self._times[-1:]:  # a clock may stand still
            self._times.append(t)
            self._frames.append(adc)
            many = len(self._times) > FEW
            if many and t - self._times[0] >= _WINDOW + _QUIET_AFTER:
                after = int(np.count_nonzero(np.array(self._times) > t - _QUIET_AFTER))
                window = _Window(np.array(self._frames), after, self._circuit)
                self._begin(t)
                return self._measure(window) or followed
        return followed

    def _measure(self, window: _Window) -> bool:
        """Take a second of frames; whether `curve` changed."""
        still = np.count_nonzero(window.moved) <= self._few
        self._restless = 0 if still else self._restless + 1
        if not still:
            if not self.measured:
                self.found = Finding(Kind.UNSTEADY) if self._restless >= _TRIES else None
            return False
        if window.spread > 0.0:  # readings that never move are below a threshold, or averaged away
            before = window.spread if self.noise is None else self.noise
            self.noise = before + _GAIN * (window.spread - before)
        if not self.measured and (risen := self._risen(window)):
            self.found, self.unseen = risen, True
            return False
        full = self._circuit.full_scale
        if self.opens and np.median(window.mean[self._circuit.populated]) * full < LEAST_STEPS:
            self.unseen = False
            off = window.mean[self._circuit.populated] * full  # steps that its zeros are off
            self.noise = float(np.hypot(window.spread, np.square(off).mean() ** 0.5)) or self.noise
            read = np.where(window.mean * full > LEAST_STEPS, window.mean, 0.0)
            return not self.measured and self._learn(read, window.noise)
        self.opens = 0.0  # it conducts
        found = self._one_voltage(window)
        self.unseen = found is not None and found.stops
        # below half a step rounding leaves no reading
        zero = self._circuit.populated & (window.mean * full < HALF_STEP)
        zero &= ~(zero.all(1)[:, None] | zero.all(0))  # such a line is not connected
        if np.count_nonzero(zero) > self._few:
            numbers = {"count": np.count_nonzero(zero)}
            found = found or Finding(Kind.ZEROS, "cells", numbers=numbers)
        if found:
            self.found = self.found if self.measured else found
            return False
        return self._learn(window.mean, window.noise / window.count**0.5)

    def _one_voltage(self, window: _Window) -> Finding | None:
        """Return that no matrix is read; together seconds that are alike have less noise."""
        total, count = self._alike
        total, count = total + window.count * window.mean, count + window.count
        for seen, n in ((window.mean, window.count), (total / count, count)):
            found = one_voltage(seen, n, window.noise, self._circuit)
            if not found:
                self._alike = np.zeros(total.shape), 0
                return None
        kept = min(count, _ALIKE_FRAMES)
        self._alike = total * (kept / count), kept
        return found

    def _risen(self, window: _Window) -> Finding | None:
        """Return that readings are far above a level that they had: something lies there by now."""
        noise = min(window.noise, MAX_NOISE)  # what rises while it is measured is none
        least = (BEYOND * noise + 1.0) / self._circuit.full_scale
        now = np.maximum(_conducts(self._circuit, window.mean), self._lowest)
        more = now > self._max_factor * self._lowest
        by = window.mean * (now - self._lowest) / np.maximum(now, np.finfo(float).tiny)
        risen = (by > least) & more & self._circuit.populated
        if np.count_nonzero(risen) <= self._few:
            return None
        most = largest(np.where(risen, by, 0.0))
        return Finding(Kind.LOADED, "risen", **most, numbers={"count": np.count_nonzero(risen)})

    def _follow(self, t: float, adc: np.ndarray) -> bool:
        """Take over by what all cells have drifted since, from a frame that nothing touches.

        A measurement needs a longer pause between two touches than a hand at work leaves, and the
        fabric goes on warming up. It does so slowly; a supply or a reference that fails does not.
        A frame counts once no touch follows it: the onset of one raises all readings of a floating
        matrix a little, always upwards.
        """
        if self._drifted is None:
            if t - max(self._quiet, self._followed) >= _DRIFTS_AFTER:
                self._drifted = t, adc
            return False
        read, adc = self._drifted
        if t - read < _QUIET_AFTER:
            return False
        self._drifted = None
        elapsed, self._followed = min(read - self._followed, DRIFT_UNSEEN), read
        known = self._circuit.populated & (adc > 0.0) & (adc < 1.0)
        before = rest_reading(self._circuit, self.curve)
        change = [_conducts(self._circuit, np.where(known, a, before)) for a in (adc, before)]
        common = float(np.median(np.log(change[0] / change[1])[known]))
        noise = SCAN_NOISE / (self._circuit.full_scale * np.median(adc[known]))
        if not noise < abs(common) <= _MAX_STEP:
            return False
        common = float(np.clip(common, -DRIFT * elapsed, DRIFT * elapsed))
        self.curve = self.curve.resting_at(np.exp(-common) * self.curve.rest_resistance)
        return True

    def _learn(self, adc: np.ndarray, noise: float) -> bool:
        """Take over what a skin at rest reads, to `noise` [ADC steps]; whether `curve` changed."""
        full = self._circuit.full_scale
        noted = None if self.opens else which_are_one(adc * full, noise, self._circuit.populated)
        off = (adc - rest_reading(self._circuit, self.curve)) * full
        if np.square(off).mean() < (BEYOND * noise) ** 2:
            self.found, self.measured, self.noted = None, True, noted
            return False
        cells, at_rest = self._circuit.populated, self.curve.points[0][1]
        try:
            read = np.maximum(adc, HALF_STEP / full) if self.opens else adc
            now = resting_conductance(read, self._circuit, noise)
            now = np.where(cells, now, 1.0 / at_rest)
        except ValueError as error:
            self.found = Finding(Kind.FABRIC, "none", detail=str(error))
            return False
        fabric = self.curve.usual
        level = float(np.median(now[cells])) * at_rest
        bears = float(fabric.force(1.0 / now)[cells].sum())
        high = level > _HIGHEST_LEVEL and bears > _COVER
        self.unseen = high or (level < _LOWEST_LEVEL and not self.opens)
        if self.unseen:
            numbers = {"ohm": at_rest / level, "expected": at_rest}
            self.found = Finding(Kind.FABRIC, numbers=numbers)
        else:
            odd = odd_cell(now, cells, fabric, 1.0 / (full * np.median(read[cells])))
            weak = None if self.opens else weak_line(np.log(now * at_rest), cells, first=True)
            self.found, noted = (
                (odd, noted) if odd and odd.form == NO_REST else (weak, noted or odd)
            )
        if self.found:
            return False
        self.measured, self.noted = True, noted
        if self._first is None:
            self._first = now
        else:
            before = 1.0 / self.curve.rest_resistance
            risen = now / self._first
            self.found = weak_line(np.log(risen), cells, first=False)
            risen = np.where(cells, risen / np.median(risen[cells]), 0.0)
            if not self.found and risen.max() > self._max_factor:  # a light touch that stands
                numbers = {"times": risen.max(), "force": AT_REST}
                self.found = Finding(Kind.STUCK, NO_REST, **largest(risen), numbers=numbers)
            common = float(np.median(np.log(now / before)[cells]))
            if abs(common) > _MAX_STEP + _MAX_DRIFT * (self._last - self._learned):
                numbers = {"share": float(np.expm1(common))}
                self.found = self.found or Finding(Kind.ALL_CELLS, numbers=numbers)
            if self.found:
                return False
            now = before + _GAIN * (now - before)
        self._learned = self._last
        self.curve = self.curve.resting_at(np.where(cells, 1.0 / now, at_rest))
        return True


class _Window:
    """A second of frames, and what a tenth of one after it reads.

    Attributes:
        mean: (rows, cols) ADC ratio, of `count` frames.
        noise: RMS of the usual reading, by what changes from frame to frame [ADC steps].
        spread: the same within both halves: a board's low-pass makes successive frames alike.
        moved: (rows, cols) bool, readings of which the halves, or what follows, differ: there is a
            touch, or its end.
    """

    def __init__(self, frames: np.ndarray, after: int, circuit: Circuit):
        cells, full = circuit.populated, circuit.full_scale
        self.count = len(frames) - after
        middle = self.count // 2
        parts = frames[:middle], frames[middle : self.count], frames[self.count :]
        self.mean = frames[: self.count].mean(0)
        changes = np.abs(np.diff(frames, axis=0))
        # the largest may be a touch
        noise = _OF_CHANGES * (changes.sum(0) - changes.max(0)) / (len(changes) - 1)
        noise = np.maximum(noise, SCAN_NOISE / full)
        self.noise = float(np.median(noise[cells])) * full
        variance = np.mean([part.var(0, ddof=1) for part in parts[:2]], axis=0)
        self.spread = float(np.median(variance[cells])) ** 0.5 * full
        self.moved = np.zeros(circuit.shape, bool)
        for one, other in itertools.pairwise(parts):
            limit = BEYOND * noise * (1.0 / len(one) + 1.0 / len(other)) ** 0.5
            limit += _STILL_SHARE * one.mean(0)
            self.moved |= np.abs(one.mean(0) - other.mean(0)) > limit


def _conducts(circuit: Circuit, adc: np.ndarray) -> np.ndarray:
    """(rows, cols) r_ref times what conducts at each crossing, but for r_par."""
    scale, offset = apparent(circuit, adc)
    left = scale - adc * min(offset / circuit.r_ref, 1.0)
    return adc / np.maximum(left, 1.0 / circuit.full_scale)
