# SPDX-License-Identifier: Apache-2.0
"""Single cells that no touch moves so: they jump about, never move, or are often set aside."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from ..calibration.touched import TOUCHED
from ..findings.finding import Finding, Kind, at, largest
from ..physics.adc import Adc
from .check import Check, Seen

# Of a cell's force, that it gains or loses as it jumps, or is let go: `TOUCHED` at least.
_STEP = 0.15
_ALONE = 0.3  # of the change, or of the force: its neighbours have less
_MEMORY = 1.0  # s for which a stuck cell stands still, and a count of reversals falls by 1/e,
_JUMPS = 20.0  # and reversals that make a cell one that jumps: no finger drums so
# The same, of times that a reading is set aside. On a sound board each is once a minute; a touch
# that comes or goes sets one aside up to 6 times in a row (8 x 8, seed 33201).
_CONTACT_MEMORY = 10.0
_SET_ASIDE = 15.0
# Of its force, by which noise alone moves the mean of a look; a hand trembles more (3 % RMS in the
# tests). In a second a trembling force stays within it by chance once in some 10,000 times.
_STEADY = 0.02
_LOOK = 0.05  # s whose mean is looked at
_NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)


class Often:
    """Counts what happens to each cell, and forgets it in time.

    Attributes:
        count: (rows, cols) times.
    """

    def __init__(self, shape, memory: float, limit: float):
        self._memory, self._limit = memory, limit
        self.count = np.zeros(shape)

    def add(self, times, elapsed: float) -> None:
        """Count `times` (rows, cols) after so many seconds."""
        self.count = self.count * np.exp(-max(elapsed, 0.0) / self._memory) + times

    @property
    def cells(self) -> np.ndarray:
        """(rows, cols) bool, where it happens often."""
        return self.count > self._limit


class OddCells(Check):
    """Follows each cell of one skin."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        shape = adc.circuit.shape
        self._force, self._t = np.zeros(shape), -np.inf
        self._way = np.zeros(shape)  # +-1, of each cell's last jump
        self._reversals = Often(shape, _MEMORY, _JUMPS)
        self._aside = Often(shape, _CONTACT_MEMORY, _SET_ASIDE)
        self._stood_at = np.zeros(shape)  # N
        self._looked = -np.inf  # s
        self._sum, self._frames = np.zeros(shape), 0  # N, of the frames since
        self._since = np.full(shape, np.inf)  # s, since when a cell stands at that force, alone
        self._stuck = np.zeros(shape, bool)

    def frame(self, seen: Seen) -> None:
        t, force, before = seen.t, seen.estimate.force, self._force
        elapsed, step = t - self._t, force - before
        self._force, self._t = force, t
        aside = seen.estimate.aside
        self._aside.add(0.0 if aside is None else aside, elapsed)
        if not 0.0 < elapsed < _MEMORY:
            step, self._since[:] = np.zeros(force.shape), np.inf
        high = np.maximum(force, before)
        if high.max() < TOUCHED:  # nothing touches: the usual case
            self._reversals.add(0.0, elapsed)
            self._since[:], self._stuck[:] = np.inf, False
            return
        jumps = np.abs(step) > np.maximum(TOUCHED, _STEP * high)
        jumps &= _around(np.abs(step)) < _ALONE * np.abs(step)
        self._reversals.add(jumps & (np.sign(step) == -self._way), elapsed)
        self._way = np.where(jumps, np.sign(step), self._way)
        self._sum, self._frames = self._sum + force, self._frames + 1
        if not 0.0 <= t - self._looked < _LOOK:
            self._look_for_still_ones(t, self._sum / self._frames)
            self._looked, self._sum, self._frames = t, np.zeros(force.shape), 0

    def findings(self) -> list[Finding]:
        """Return which cells are odd by now; one of each kind, the worst."""
        found = []
        if self._reversals.cells.any():
            found.append(Finding(Kind.CONTACT, "jumps", **largest(self._reversals.count)))
        elif self._stuck.any():
            cell = np.argwhere(self._stuck)[0]
            numbers = {"force": float(self._force[tuple(cell)]), "seconds": _MEMORY}
            found.append(Finding(Kind.STUCK, "constant", **at(cell), numbers=numbers))
        if self._aside.cells.any():
            found.append(Finding(Kind.CONTACT, "set aside", **largest(self._aside.count)))
        return found

    def _look_for_still_ones(self, t: float, force: np.ndarray) -> None:
        off = np.abs(force - self._stood_at)
        self._stuck &= off <= _STEP * self._stood_at
        moved = off > _STEADY * self._stood_at
        alone = (force > TOUCHED) & (_around(force) < _ALONE * force)
        self._stood_at = np.where((moved | ~alone) & ~self._stuck, force, self._stood_at)
        self._since = np.where(~alone, np.inf, np.where(moved, t, np.minimum(self._since, t)))
        self._stuck |= t - self._since >= _MEMORY


def _around(values: np.ndarray) -> np.ndarray:
    """(rows, cols) the largest of each cell's eight neighbours."""
    return maximum_filter(values, footprint=_NEIGHBOURS, mode="constant")
