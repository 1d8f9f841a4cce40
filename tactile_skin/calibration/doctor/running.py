"""The doctor on a running skin: asked while the robot stands still for a fault, and not before.

`diagnose` takes 30 ms for 256 cells and 0.1 s for 1024, which must not come between a push and its
stop. Its frames begin with the stop, so that none of the sound board's is among them.
"""

from __future__ import annotations

import numpy as np

from ...physics.circuit import Circuit
from . import diagnose
from .findings import Finding

_KEPT = 512  # frames at most; every other one of them goes when they are reached
_FEWEST = 50  # frames that are asked
_FIRST, _LATER = 2.0, 60.0  # s of a stop after which to ask; then twice as long each time, up to


class RunningDoctor:
    """Follows one skin; all times are of one clock [s].

    Attributes:
        findings: what is wrong, asked twice in succession; empty while nothing stops the robot.
    """

    def __init__(self):
        self.findings: tuple[Finding, ...] = ()
        self._forget()

    def _forget(self) -> None:
        self.findings, self._before = (), set()
        self._frames: list[np.ndarray] = []
        self._every, self._count = 1, 0  # how many frames come for one that is kept; frames
        self._begun = self._last = np.inf
        self._due = _FIRST  # s since `_begun`

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
        if not stopped or t < self._last:
            if self._frames:
                self._forget()
            if not stopped:
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
        if len(self._frames) < _FEWEST or elapsed < self._due:
            return
        self._due += min(self._due, _LATER)
        try:
            found = diagnose(np.array(self._frames), circuit, series=False)
        except ValueError:  # of a reading that is none, the node speaks itself
            found = []
        self.findings = tuple(f for f in found if _name(f) in self._before)
        self._before = {_name(f) for f in found}


def _name(finding: Finding) -> tuple:
    return finding.kind, finding.where
