# SPDX-License-Identifier: Apache-2.0
"""A touch that stands without moving: what it may be, and whether the board takes it away."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..calibration.touched import TOUCHED
from ..findings.finding import Finding, Kind, Severity, largest
from ..physics.adc import Adc
from ..solvers.reading import FEW, ROUNDING_NOISE
from ..solvers.suspect import MODEL_ERROR
from .check import Check, Seen, over

_LOOK = 1.0  # s between looks
# Of its force, by cells, that a touch may differ from what it was: fabric creeps by 10 to 30 % a
# decade of time, a hand that works changes all of it.
_MOVED = 0.3
_FIRST = 3.0  # s after the first frame in which a touch is there from the start: rest takes 1
_SOON = 10.0  # s that such a touch stands when it is said,
_LONG = 120.0  # and any other
# Readings over those at rest that fall back together: s that are compared, as the stop does; share
# of them that is left, at most; times the noise that they, and their fall, are; times it, and what
# a skin differs from its model, by which they may miss one share, or one amount.
_SPAN = 0.3
_KEPT = 0.85
_CLEAR = 10.0
_STEEP = 30.0  # times it that they differ by, and fall by: else noise hides that a hand's differ
_EXACT = 1.5
# Times what their forces differ from one share: a hand that loosens keeps that of forces, or none
_BETTER = 0.25
# Share of what was left half of this time ago that stands: an exponential fall to `_KEPT` or less
# in the first half goes on by as much in the second.
_STANDS_AT = 0.95
STANDS = "stands"  # form of what is found


class Standing(Check):
    """Follows the force picture of one skin; a warning, and no stop of its own."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._first = self._looked = -np.inf  # s
        self.forget()

    def forget(self) -> None:
        """Begin again."""
        self.found: Finding | None = None
        self._since = np.inf  # s
        self._picture: np.ndarray | None = None  # (rows, cols) that it had then [N]

    def frame(self, seen: Seen) -> None:
        t, force = seen.t, np.asarray(seen.estimate.force)
        if t < self._looked:  # the clock was set back
            self._first = self._looked = -np.inf
            self.forget()
        if t - self._looked < _LOOK:
            return
        self._first = t if self._first == -np.inf else self._first
        self._looked = t
        picture, touched = self._picture, force.max() >= TOUCHED
        if picture is None or np.abs(force - picture).sum() > _MOVED * picture.sum() or not touched:
            self.forget()
            if touched:
                self._since, self._picture = t, force
            return
        early = self._since - self._first < _FIRST
        if t - self._since >= (_SOON if early else _LONG):
            # it does not change: each new reason of a stop calls every hook
            numbers = {"force": float(picture.sum())}
            since = "since the start" if early else f"for {_LONG:g} s or longer"
            place = largest(picture)
            self.found = Finding(Kind.LOADED, STANDS, **place, numbers=numbers, detail=since)


class MovingZero(Check):
    """Follows whether the readings of a touch fall back by one share and stand, or by one amount.

    So does a firmware's zero that follows each reading in steps, or at a speed. Of a hand that lets
    go the readings of hard cells fall by another share than those of soft ones: they end at r_ref.
    All of them fall by one share behind a low-pass, but to none.
    """

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._full = adc.circuit.full_scale
        self.forget()

    def forget(self) -> None:
        self.found: Finding | None = None
        # s, (rows, cols) [ADC steps], force (rows, cols) [N]
        self._last: deque[tuple[float, np.ndarray, np.ndarray]] = deque()

    def frame(self, seen: Seen) -> None:
        last = self._last
        if seen.rest is None or (last and seen.t < last[-1][0]):
            last.clear()
            return
        read = over(seen.adc, seen.rest) * self._full
        last.append((seen.t, read, np.asarray(seen.estimate.force)))
        while len(last) > 2 and last[1][0] <= seen.t - _SPAN:
            last.popleft()
        noise = max(seen.noise * self._full, ROUNDING_NOISE)
        pressed = np.count_nonzero(last[0][1] > _CLEAR * noise) >= FEW
        if self.found is None and len(last) > 1 and pressed:
            half = seen.t - _SPAN / 2.0
            between = next((past for t, past, _ in reversed(last) if t <= half), last[0][1])
            error = max(MODEL_ERROR, _BETTER * _apart(last[0][2], last[-1][2]))
            if (share := fell_together(last[0][1], between, read, noise, error)) is not None:
                self.found = Finding(
                    Kind.ZEROS, "moves", Severity.FAULT, numbers={"share": 1.0 - share}
                )


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the RMS by which an array differs from a share of one, over that of this one."""
    square = float(np.sum(one * one))
    if not square:
        return 0.0
    off = other - float(np.sum(one * other)) / square * one
    return float(np.sqrt(np.sum(off * off) / square))


def fell_together(
    before: np.ndarray,
    between: np.ndarray,
    now: np.ndarray,
    noise: float,
    error: float,
) -> float | None:
    """Return the share of readings over those at rest that is left, if all of them fell alike.

    Args:
        before, between, now: (rows, cols) over the rest, at three times [ADC steps].
        noise: RMS of a reading [ADC steps].
        error: relative, by which they may miss one share.
    """
    pressed = before > _CLEAR * noise
    one, middle, other = before[pressed], between[pressed], now[pressed]
    if one.size < FEW or one.std() < _STEEP * noise:
        return None
    fell, share = one - other, float(one @ other / (one @ one))
    if not 1.0 - _KEPT < share < _KEPT or np.sqrt(np.square(fell).mean()) < _STEEP * noise:
        return None
    square = np.square(one).mean()
    alike = np.square(other - share * one).mean() / (1.0 + share**2)
    # a low-pass would bring it to rest
    stands = other @ middle > _STANDS_AT * (middle @ middle)
    by_share = stands and alike < (_EXACT * noise) ** 2 + error**2 * square
    left = other > _CLEAR * noise  # the others are back at rest
    moved = np.count_nonzero(left) >= FEW and fell[left].mean() > _STEEP * noise
    exact = (_EXACT * noise) ** 2 + MODEL_ERROR**2 * square
    by_amount = moved and fell[left].var() / 2.0 < exact
    return share if by_share or by_amount else None
