"""Single cells whose force moves as no touch does: one that jumps about, one that never moves."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

_FORGET = 1.0  # s in which a count of reversals falls by 1/e
_JUMP = 0.15  # of a cell's force, and
_LEAST = 0.3  # N, that it gains or loses from one frame to the next
_ALONE = 0.3  # of the change, or of the force: its neighbours have less
_NOISY, _QUIET = 20.0, 5.0  # reversals that make, and that end, a noisy cell: no finger drums so
# Of its force, by which noise alone moves the mean of a look; a hand trembles more (3 % RMS in the
# tests). In a second a trembling force stays within it by chance once in some 10,000 times.
_STEADY = 0.02
_DRIFT = 0.02  # N, besides: noise at low forces
_STUCK = 0.5  # N at least that a stuck cell has
_LOOK = 0.05  # s whose mean is looked at
_STANDS = 1.0  # s for which a stuck cell stands still, alone
_LEAVES = 0.15  # of its force, by which it must move to be none: touches beside it move it a little


class Cells:
    """Follows the force of each cell; all times are of one clock [s]."""

    def __init__(self, shape: tuple[int, int]):
        self._last = np.zeros(shape)
        self._t = -np.inf
        self._way = np.zeros(shape)  # +-1, of each cell's last jump
        self._reversals = np.zeros(shape)
        self._noisy = np.zeros(shape, bool)
        self._stood_at = np.zeros(shape)  # N
        self._looked = -np.inf  # s
        self._seen, self._frames = np.zeros(shape), 0  # N, the sum of the frames since
        self._since = np.full(shape, np.inf)  # s, since when a cell stands at that force, alone
        self._stuck = np.zeros(shape, bool)

    def frame(self, t: float, force: np.ndarray) -> str:
        """What is odd; empty if nothing is.

        Args:
            t: when the frame was read.
            force: (rows, cols) [N].
        """
        step, elapsed = force - self._last, t - self._t
        if not 0.0 < elapsed < _FORGET:
            step, self._since = np.zeros(force.shape), np.full(force.shape, np.inf)
        else:
            self._reversals *= np.exp(-elapsed / _FORGET)
        if max(force.max(), self._last.max()) < _LEAST and not self._noisy.any():
            self._last, self._t, self._since[:] = force, t, np.inf
            self._stuck[:] = False
            return ""  # nothing touches: the usual case
        high = np.maximum(force, self._last)
        self._last, self._t = force, t
        jumps = np.abs(step) > np.maximum(_LEAST, _JUMP * high)
        if jumps.any():
            jumps &= _around(np.abs(step)) < _ALONE * np.abs(step)
            self._reversals += jumps & (np.sign(step) == -self._way)
            self._way = np.where(jumps, np.sign(step), self._way)
        self._noisy = self._reversals > np.where(self._noisy, _QUIET, _NOISY)
        self._seen, self._frames = self._seen + force, self._frames + 1
        if not 0.0 <= t - self._looked < _LOOK:
            self._looked = t
            self._look_for_still_ones(t, self._seen / self._frames)
            self._seen, self._frames = np.zeros(force.shape), 0
        if self._noisy.any():
            row, col = np.unravel_index(self._reversals.argmax(), force.shape)
            return (
                f"row {row}, column {col} jumps between high and low force: is its contact loose?"
            )
        if self._stuck.any():
            row, col = np.argwhere(self._stuck)[0]
            return (
                f"row {row}, column {col} alone has read a constant {force[row, col]:.1f} N "
                f"for {_STANDS:g} s or longer: does something lie there, or is the cell stuck?"
            )
        return ""

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
