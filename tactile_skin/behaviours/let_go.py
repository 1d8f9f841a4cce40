# SPDX-License-Identifier: Apache-2.0
"""Whether what presses was let go, or only fades: a push ends when the hand leaves.

A fabric under a load conducts more with time, never less. Readings that creep back to rest under a
hand are those of a board that moves its zero, or of a converter that drifts.
"""

from __future__ import annotations

from collections import deque

# What presses is let go as its force falls to a share within some time, by a share of its largest
# (hands take 3 s at most from full force to none), and then stands. A zero that follows the reading
# with a time constant of 1 s takes as much away, and goes on. It does not take three quarters: a
# hand has left then, though a soft cover comes back for seconds.
_FALL = 0.4  # s
_FALLS_TO = 2.0 / 3.0  # of what it was then
_FALLS_BY = 0.12  # of the largest
_LEAVES = 0.25  # of what it was then
_STANDS = 0.1  # s in which a force that stands
_KEEPS = 0.95  # keeps so much of itself


class Pressing:
    """Follows how much of what pressed was not let go; all times are of one clock [s].

    Attributes:
        force: the force that stands, as far as nobody let go [N]: that of the last fast fall, or a
            larger one since.
    """

    def __init__(self) -> None:
        self._last: deque[tuple[float, float]] = deque()  # s, N, of the last `_FALL` s
        self.force = self._largest = 0.0

    def begin(self) -> None:
        """Take what was before as over: a clock that was set back, or somebody has checked."""
        self._last.clear()
        self.force = self._largest = 0.0

    def take(self, t: float, force: float) -> None:
        """Take what a reading of t feels [N]."""
        last = self._last
        while len(last) > 1 and last[1][0] <= t - _FALL:
            last.popleft()  # the last one before a gap stays
        self._largest = max(self._largest, force)
        if force >= self.force or self._let_go(t, force):
            self.force = force
        last.append((t, force))
        self._largest = self._largest if self.force else 0.0

    def _let_go(self, t: float, force: float) -> bool:
        """Whether a force that is less than before has fallen fast, and the fall has ended."""
        felt = [felt for _, felt in self._last]
        before = max(felt, default=0.0)
        if not (force <= _FALLS_TO * before and before - force >= _FALLS_BY * self._largest):
            return False
        just = [felt for at, felt in self._last if at >= t - _STANDS] or felt[-1:]
        return force <= _LEAVES * before or force >= _KEEPS * max(just, default=0.0)
