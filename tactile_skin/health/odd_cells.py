"""Single cells that no touch moves so: they jump about, never move, or are often set aside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter

from ..findings.finding import Finding, Kind, at, largest
from ..physics.adc import Adc

if TYPE_CHECKING:
    from .monitor import Seen

_FORGET = 1.0  # s in which a count of reversals falls by 1/e
_JUMP = 0.15  # of a cell's force, and
_LEAST = 0.3  # N, that it gains or loses from one frame to the next
_ALONE = 0.3  # of the change, or of the force: its neighbours have less
_JUMPS = 20.0  # reversals that make a cell one that jumps: no finger drums so
_CALM = 5.0  # and that end it
# Times that a reading is set aside which make a bad contact, and end one; time [s] in which the
# count falls by 1/e. Of a sound board's each is once a minute; a touch that comes or goes sets one
# aside up to 6 times in a row (8 x 8, seed 33201).
_BAD = 15.0
_GOOD = 3.0
_MEMORY = 10.0
# Of its force, by which noise alone moves the mean of a look; a hand trembles more (3 % RMS in the
# tests). In a second a trembling force stays within it by chance once in some 10,000 times.
_STEADY = 0.02
_DRIFT = 0.02  # N, besides: noise at low forces
_STUCK = 0.5  # N at least that a stuck cell has
_LOOK = 0.05  # s whose mean is looked at
_STANDS = 1.0  # s for which a stuck cell stands still, alone
_LEAVES = 0.15  # of its force, by which it must move to be none: touches beside it move it a little


class OddCells:
    """Follows each cell of one skin; all times are of one clock [s]."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        shape = adc.circuit.shape
        self._last = np.zeros(shape)
        self._t = -np.inf
        self._way = np.zeros(shape)  # +-1, of each cell's last jump
        self._reversals = np.zeros(shape)
        self._jumps = np.zeros(shape, bool)
        self._stood_at = np.zeros(shape)  # N
        self._looked = -np.inf  # s
        self._seen, self._frames = np.zeros(shape), 0  # N, the sum of the frames since
        self._since = np.full(shape, np.inf)  # s, since when a cell stands at that force, alone
        self._stuck = np.zeros(shape, bool)
        self._aside, self._bad = np.zeros(shape), np.zeros(shape, bool)  # times

    def frame(self, seen: Seen) -> None:
        """Take a frame."""
        t, force, aside = seen.t, seen.estimate.force, seen.estimate.aside
        self._count_aside(t - self._t, aside)
        step, elapsed = force - self._last, t - self._t
        if not 0.0 < elapsed < _FORGET:
            step, self._since = np.zeros(force.shape), np.full(force.shape, np.inf)
        else:
            self._reversals *= np.exp(-elapsed / _FORGET)
        if max(force.max(), self._last.max()) < _LEAST and not self._jumps.any():
            self._last, self._t, self._since[:] = force, t, np.inf
            self._stuck[:] = False
            return  # nothing touches: the usual case
        high = np.maximum(force, self._last)
        self._last, self._t = force, t
        jumps = np.abs(step) > np.maximum(_LEAST, _JUMP * high)
        if jumps.any():
            jumps &= _around(np.abs(step)) < _ALONE * np.abs(step)
            self._reversals += jumps & (np.sign(step) == -self._way)
            self._way = np.where(jumps, np.sign(step), self._way)
        self._jumps = self._reversals > np.where(self._jumps, _CALM, _JUMPS)
        self._seen, self._frames = self._seen + force, self._frames + 1
        if not 0.0 <= t - self._looked < _LOOK:
            self._looked = t
            self._look_for_still_ones(t, self._seen / self._frames)
            self._seen, self._frames = np.zeros(force.shape), 0

    def findings(self) -> list[Finding]:
        """Return which cells are odd by now; one of each kind, the worst."""
        found = []
        if self._jumps.any():
            found.append(Finding(Kind.CONTACT, "jumps", **largest(self._reversals)))
        elif self._stuck.any():
            cell = np.argwhere(self._stuck)[0]
            numbers = {"force": float(self._last[tuple(cell)]), "seconds": _STANDS}
            found.append(Finding(Kind.STUCK, "constant", **at(cell), numbers=numbers))
        if self._bad.any():
            found.append(Finding(Kind.CONTACT, "set aside", **largest(self._aside)))
        return found

    def forget(self) -> None:
        """Do nothing: it says what the last frames show."""

    def _count_aside(self, elapsed: float, aside: np.ndarray | None) -> None:
        self._aside *= np.exp(-max(elapsed, 0.0) / _MEMORY)
        if aside is not None:
            self._aside += aside
        self._bad = self._aside > np.where(self._bad, _GOOD, _BAD)

    def _look_for_still_ones(self, t: float, force: np.ndarray) -> None:
        off = np.abs(force - self._stood_at)
        self._stuck &= off <= _LEAVES * self._stood_at + _DRIFT
        moved = off > _STEADY * self._stood_at + _DRIFT
        alone = (force > _STUCK) & (_around(force) < _ALONE * force)
        self._stood_at = np.where((moved | ~alone) & ~self._stuck, force, self._stood_at)
        self._since = np.where(~alone, np.inf, np.where(moved, t, np.minimum(self._since, t)))
        self._stuck |= t - self._since >= _STANDS


def _around(values: np.ndarray) -> np.ndarray:
    """(rows, cols) the largest of each cell's eight neighbours."""
    return maximum_filter(values, footprint=_NEIGHBOURS, mode="constant")


_NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)
