# SPDX-License-Identifier: Apache-2.0
"""What an untouched skin reads, compared with what it read when its rest was measured.

Fabric changes cell by cell, and as a whole slowly. Two changes are none of its own: all cells at
once, as of a supply, a reference or a series resistance; and a line that reads as another one did,
cell for cell, as of a multiplexer or leads that were exchanged.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from ..calibration.at_rest import LINE_FALL
from ..calibration.rest import resting_conductance
from ..calibration.tare import DRIFT, DRIFT_UNSEEN
from ..calibration.touched import TOUCHED
from ..findings.finding import Finding, Kind, Severity, lines
from ..physics import readouts
from ..physics.adc import Adc
from ..solvers.reading import ROUNDING_NOISE
from .check import Check, Seen

_FRAMES = 20  # whose mean is looked at, at least: a board's low-pass leaves fewer alike
_TAKE = 0.18  # s that they take, at least
# Log conductance by which all cells change at once, beside what the tare follows of a drift.
_AT_ONCE = 0.004
# Of the cells, or of a line's, may have changed otherwise: a touch has left them behind.
_SHARE = 0.25
_QUARTILE = -ndtri(_SHARE)  # standard deviations that a normal distribution's quartile lies off
_EVEN = 0.1  # share of a `LINE_FALL` by which cells may differ that all have lost it: it stops then
_KEPT = 60.0  # s: by then touches have told another r_par, and a drift has been followed
_CELLS = 4  # of a line, at least, by which lines are compared
_OWN = 40.0  # sum of squares [noise squared] by which it differs from its own line
_OTHER = 4.0  # standard deviations of chi^2 up to which it is the other line
# The same, up to which no third one may be: on even fabric lines are alike, and one that something
# lay on at the tare reads as all others once that is gone.
_ALIKE = 10.0
_LEAST = 0.1  # ADC steps that a mean may be off: the rest is measured anew only from there on
_DITHER = 0.4  # ADC steps RMS of noise that average rounding away: with less it is off by that

# A hum: standard deviations of the common level that a swing exceeds,
_SWING = 6.0
_LEAST_SWING = 0.5  # and ADC steps;
_SWINGS = 4  # up and down, in a row,
_SWINGS_ALIKE = (
    2.5  # times that the largest and the longest of them are the smallest and the shortest
)
_LATELY = 60.0  # s in which they come

# Cells that swing, each by itself:
CLEAR = 4.0  # times the noise, by which a reading is low
_OVER = 0.3  # of how far it was low, that it comes over its rest: a curve is steeper below
_DEEPER = 2.0  # times which it may be lower than when it came back last
_BEATS = 8.0  # s within which it has come back


class Untouched(Check):
    """Follows the picture of one skin at rest: a fault if readings miss some of what presses."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._circuit = adc.circuit
        self._looked = -np.inf  # s
        self._before: np.ndarray | None = None  # what the last look saw
        self.forget()

    def forget(self) -> None:
        """Take what is read now for right: somebody has checked the skin, or it is explained."""
        self.found: Finding | None = None
        self._rest: np.ndarray | None = None  # before what was found
        self._found_at = -np.inf  # s
        self._begin()

    def _begin(self) -> None:
        self._sum, self._count = np.zeros(self._circuit.shape), 0
        self._since = np.inf  # s, the first of them

    def frame(self, seen: Seen) -> None:
        """Take a frame. Before the rest was measured each look is compared with the one before.

        What falls by then would be tared away.
        """
        t, rest = seen.t, seen.rest
        if seen.stirs or t < self._since < np.inf:  # or the clock was set back
            self._begin()
        if seen.stirs or seen.opens:
            return
        self._since = min(self._since, t)
        self._sum, self._count = self._sum + seen.adc, self._count + 1
        if self._count < _FRAMES or t - self._since < _TAKE:
            return
        now, before = self._sum / self._count, self._before
        self._begin()
        self._before = now
        if self._rest is not None:
            rest = self._rest
        elif rest is None:
            rest = now if before is None else before
        known = self._circuit.populated & (now > 0.0) & (now < 1.0) & (rest > 0.0) & (rest < 1.0)
        if np.count_nonzero(known) >= _CELLS:
            self._look(t, now, rest, seen.noise, known, seen.recovers)

    def _look(self, t: float, now, rest, noise: float, known, recovers: bool) -> None:
        least = ROUNDING_NOISE if noise * self._circuit.full_scale < _DITHER else _LEAST
        least, noise = least / self._circuit.full_scale, noise / _FRAMES**0.5
        exchanged = _another_line(now, rest, max(noise, least), known)
        elapsed = min(max(t - self._looked, 0.0), DRIFT_UNSEEN)
        limit = _AT_ONCE + DRIFT * (elapsed if self._rest is None else 0.0)
        limit += 4.0 * noise / (np.median(rest[known]) * np.count_nonzero(known) ** 0.5)
        self._looked, self._found_at = t, min(self._found_at, t)  # the clock may be set back
        change, even = self._common(now, rest, noise, known, limit)
        change = max(change, 0.0) if recovers else change
        before, stopped = self.found, self.found is not None and self.found.stops
        was_line = before is not None and before.kind is Kind.SWAPPED
        if exchanged:
            # what a touch leaves behind may look so once
            severity = Severity.FAULT if was_line else Severity.WARN
            self._rest, self._found_at = rest, t
            self.found = replace(exchanged, severity=severity)
        elif abs(change) > limit and not was_line and not (stopped and change > 0.0):
            fell = even and change < -LINE_FALL
            if before is None or fell > stopped:
                self._rest, self._found_at = rest, t
                severity = Severity.FAULT if fell else Severity.WARN
                numbers = {"share": float(np.expm1(change))}
                self.found = Finding(Kind.ALL_CELLS, severity=severity, numbers=numbers)
            elif not stopped and t - self._found_at > _KEPT:
                self.forget()
        else:
            self.forget()

    def _common(self, now, rest, noise: float, known, limit: float) -> tuple[float, bool]:
        """Return the log conductance that nearly all cells gained or lost, and whether evenly.

        It is 0 if some did neither. Evenly: as of the supply; a load that goes leaves no cells so
        alike.
        """
        # r_ref / rho, but for r_par, is what conducts
        a, b = now[known], rest[known]
        change = np.log(a / (1.0 - a) * (1.0 - b) / b)
        spread = noise / np.median(b * (1.0 - b))  # of one reading's change
        middle = float(np.median(change))
        # what is known already need not be found again, unless it grows into a fault
        news = self.found is None or (middle < -LINE_FALL and not self.found.stops)
        if news and abs(middle) > limit and known[self._circuit.populated].all():
            try:
                before = resting_conductance(rest, self._circuit)
                after = resting_conductance(now, self._circuit)
                change = np.log(after[known] / before[known])
            except ValueError:  # no cells read so
                pass
            else:  # by what a reading gains with its own cell
                own = readouts.solve(self._circuit, before, derivatives=False).own
                spread = noise / np.median((own * before)[known])
        low, middle, high = np.quantile(change, (_SHARE, 0.5, 1.0 - _SHARE))
        least = (low if middle > 0.0 else -high) + _QUARTILE * spread
        even = high - low < 2.0 * _QUARTILE * (_EVEN * abs(middle) + 1.5 * spread)
        return float(middle) if least > 0.5 * abs(middle) else 0.0, bool(even)


def _another_line(
    now: np.ndarray, rest: np.ndarray, noise: float, known: np.ndarray
) -> Finding | None:
    """Return which line reads as another one did; None: none does.

    Lines are compared by how their cells differ from each other: their level may drift.

    Args:
        noise: RMS of each of `now`, as ADC ratio.
    """
    now, rest = (np.where(known, adc, 0.0) for adc in (now, rest))
    for axis, a, b, there in ((0, now, rest, known), (1, now.T, rest.T, known.T)):
        both = (there[:, None] & there[None]).astype(float)  # (lines, lines, cells of a line)
        n = np.maximum(both.sum(2), 1.0)
        off = (a[:, None] - b[None]) * both
        off -= both * (off.sum(2) / n)[..., None]
        square = np.square(off / noise)
        free = np.maximum(n - 1.0, 1.0)
        beyond = (square.sum(2) - free) / np.sqrt(2.0 * free)  # of chi^2, from each other line
        beyond[n < _CELLS] = np.inf
        own = np.sort(square.diagonal(), axis=0)  # (cells, lines)
        own = own[: round((1.0 - _SHARE) * len(own))].sum(0)
        np.fill_diagonal(beyond, np.inf)
        alike = (beyond < _ALIKE).sum(1)
        found = (beyond.min(1) < _OTHER) & (alike == 1) & (own > _OWN)
        if found.any():
            k = int(found.argmax())
            numbers = {"other": float(beyond[k].argmin())}
            return Finding(Kind.SWAPPED, "live", **lines(axis, k), numbers=numbers)
    return None


class Hum(Check):
    """Follows the level that all readings have in common: mains hum lets it rise and fall.

    At 50 frames a second a hum of 50 Hz is a slow wave: the difference of two clocks. A supply that
    changes goes one way and stays; fabric that warms up, too.
    """

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._cells, self._full = adc.circuit.populated, adc.circuit.full_scale
        self.forget()

    def forget(self) -> None:
        self.found: Finding | None = None
        self._rest: np.ndarray | None = None  # (rows, cols) ADC ratio
        self._swings: deque[tuple[float, float, float]] = deque(maxlen=_SWINGS)  # end, s, steps
        self._way, self._turned = 0.0, (-np.inf, 0.0)  # +-1; s and steps of the last turn
        self._extreme = (-np.inf, 0.0)  # the farthest that it came since

    def frame(self, seen: Seen) -> None:
        if seen.rest is None or seen.estimate.force.max() >= TOUCHED:
            return
        # what was measured first: the rest that is followed goes with a slow hum
        self._rest = seen.rest if self._rest is None else self._rest
        off = (seen.adc - self._rest)[self._cells]
        off = off[~np.isnan(off)]
        if not off.size:
            return
        middle = off.size // 2
        level = float(np.partition(off, middle)[middle]) * self._full
        # of a median of so many readings
        chance = 1.25 * seen.noise * self._full / np.count_nonzero(self._cells) ** 0.5
        self._follow(seen.t, level, max(_SWING * chance, _LEAST_SWING))
        lately = seen.t - self._swings[0][0] < _LATELY if self._swings else False
        sizes, lengths = ([swing[k] for swing in self._swings] for k in (2, 1))
        alike = all(max(of) < _SWINGS_ALIKE * min(of) for of in (sizes, lengths) if of)
        self.found = None
        if lately and alike and len(sizes) == _SWINGS:
            numbers = {"steps": 0.5 * max(sizes), "seconds": 2.0 * max(lengths)}
            self.found = Finding(Kind.HUM, numbers=numbers)

    def _follow(self, t: float, level: float, least: float) -> None:
        """Take the level at t; a turn is known once it has come back by more than `least`."""
        if t < self._extreme[0]:  # the clock was set back
            self.forget()
        at, extreme = self._extreme
        if not self._way:
            if at == -np.inf:
                self._extreme = self._turned = t, level
            elif abs(level - extreme) > least:
                self._way = np.sign(level - extreme)
                self._turned, self._extreme = (-np.inf, extreme), (t, level)
        elif (level - extreme) * self._way > 0.0:
            self._extreme = t, level
        elif abs(level - extreme) > least:
            began, before = self._turned
            if np.isfinite(began):
                self._swings.append((at, at - began, abs(extreme - before)))
            self._turned, self._extreme, self._way = (at, extreme), (t, level), -self._way


class Shakes:
    """Follows how far each cell was below its rest before it was above it.

    A reading that is lost stays low; one of a loose contact comes back, and no higher. Where a
    board samples what shakes, the swing may beat as slowly as some seconds.
    """

    def __init__(self, shape: tuple[int, int]):
        self._dip = np.zeros(shape)  # how low each is since it was above its rest last
        self._depth = np.zeros(shape)  # how low it was before that,
        self._back = np.full(shape, -np.inf)  # and when it came back [s]

    def frame(self, t: float, off: np.ndarray, noise: float) -> None:
        """Take what the readings of an untouched skin (rows, cols) are over their rest."""
        back = (off > _OVER * self._dip) & (self._dip > CLEAR * noise)
        self._depth = np.where(back, self._dip, self._depth)
        self._back = np.where(back, t, np.minimum(self._back, t))  # the clock may be set back
        self._dip = np.where(off > 0.0, np.where(back, 0.0, self._dip), np.maximum(self._dip, -off))

    def covers(self, t: float, off: np.ndarray) -> np.ndarray:
        """(rows, cols) bool, whether readings that are so low have come back from there lately."""
        return (t - self._back < _BEATS) & (-off <= _DEEPER * self._depth)
