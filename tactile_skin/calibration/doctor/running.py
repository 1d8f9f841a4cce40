"""The doctor on a running skin: asked while the robot stands still for a fault, and not before.

`diagnose` takes 30 to 120 ms for 256 cells and up to 0.7 s for 1024, which must not come between a
push and its stop. Its frames begin with the stop, so that none of the sound board's is among them,
and go on in between where one stop follows another, as of a fault that only touches show.
"""

from __future__ import annotations

import numpy as np

from ...physics.circuit import Circuit
from . import diagnose
from .findings import Finding

_KEPT = 512  # frames at most; every other one of them goes when they are reached
_FEWEST = 50  # frames that are asked
_BRIEF = 0.5, 25  # s, and frames: what stops for less is no fault that lasts
_OVER = 10.0  # s without a stop after which what stopped is over
_FIRST, _LATER = 2.0, 60.0  # s of a stop after which to ask; then twice as long each time, up to


class RunningDoctor:
    """Follows one skin; all times are of one clock [s]."""

    def __init__(self):
        self._forget()

    def _forget(self) -> None:
        self._found: tuple[Finding, ...] = ()  # asked twice in succession
        self._before: set[tuple] = set()  # what was found last
        self._frames: list[np.ndarray] = []
        self._every, self._count = 1, 0  # how many frames come for one that is kept; frames
        self._stopped = False
        self._begun = self._last = np.inf  # s, of the frames
        self._stood = -np.inf  # s, when the robot stood last
        self._due = _FIRST  # s since `_begun`

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong; empty while nothing stops the robot."""
        return self._found if self._stopped else ()

    @property
    def message(self) -> str:
        return "; ".join(str(finding).rstrip(".") for finding in self.findings)

    def frame(self, t: float, adc: np.ndarray, stopped: bool) -> None:
        """Take a frame.

        Args:
            t: when it was read [s].
            adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
            stopped: whether a fault of this skin stops the robot.
        """
        if self._frames and (t < self._last or t - self._stood > _OVER):
            self._forget()
        self._stopped = stopped
        if stopped:
            self._stood = t
        elif self._stood - self._begun < _BRIEF[0] or self._count < _BRIEF[1]:
            self._forget()
        if not (stopped or self._frames):
            return
        self._begun, self._last = min(self._begun, t), t
        if self._count % self._every == 0:
            self._frames.append(adc.astype(np.float32))
        self._count += 1
        if len(self._frames) >= _KEPT:
            self._frames, self._every = self._frames[::2], 2 * self._every

    def look(self, circuit: Circuit) -> None:
        """Ask, if it is time."""
        elapsed = self._last - self._begun
        if not self._stopped or len(self._frames) < _FEWEST or elapsed < self._due:
            return
        while self._due <= elapsed:
            self._due += min(self._due, _LATER)
        try:
            found = diagnose(np.array(self._frames), circuit, series=False)
        except ValueError:  # of a reading that is none, the node speaks itself
            found = []
        self._found = tuple(f for f in found if _name(f) in self._before)
        self._before = {_name(f) for f in found}


def _name(finding: Finding) -> tuple:
    return finding.kind, finding.where
