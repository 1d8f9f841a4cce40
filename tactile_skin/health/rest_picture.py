"""Whether a matrix is read at all: cells of a fabric rest apart, and that picture is its own.

Where all readings are alike no matrix is read. Where the picture of the rest stands at another
height a bit of the ADC is stuck: whatever presses changes each cell by its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from .ceiling import ABOVE, BEYOND, ROUND, WINDOW, Window

if TYPE_CHECKING:
    from .monitor import Seen

_STOOD = 10  # windows in which nothing moves that are looked at together: noise falls to a third
_ALIKE = 3.0  # times that readings at rest are further apart than now, which makes a fault,
_STILL_ALIKE = 2.0  # and which ends it
_MANY = 8  # readings at least
_RAISED = 0.3  # share of the rest by which no fabric changes between two measurements of it


class RestPicture:
    """Follows the picture of one skin, whose rest is known."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._adc = adc
        self._found: Finding | None = None
        self._mean: np.ndarray | None = None  # of windows in which nothing moved;
        self._count = 0  # how many

    def frame(self, seen: Seen) -> None:
        """Take a frame. On a small skin noise hides in a window whether all readings are alike."""
        window = seen.window
        if window is None or seen.rest is None:
            return
        rest = self._adc.rising_count(seen.rest)
        read, before, self._found = window.mean > 0.0, self._found, None
        if np.count_nonzero(read) < _MANY:
            return
        now, rest = self._stands(window)[read], rest[read]
        least = _ALIKE if before is None else _STILL_ALIKE
        apart, up = rest.std(), float(np.median(now - rest))
        if least * now.std() < apart:
            kind, form, numbers = Kind.NO_SIGNAL, "", {"steps": float(now.mean())}
        elif abs(up) > max(ABOVE, _RAISED * np.median(rest)) and least * (now - rest).std() < apart:
            kind, form, numbers = Kind.BITS, "shift", {"steps": up}
        else:
            return
        self._found = Finding(kind, form, severity=Severity.FAULT, numbers=numbers)

    def findings(self) -> list[Finding]:
        """Return what the last window showed."""
        return [self._found] if self._found else []

    def forget(self) -> None:
        """Do nothing: it says what the last window shows."""

    def _stands(self, window: Window) -> np.ndarray:
        """(rows, cols) mean of the last windows, as long as nothing moves."""
        limit = BEYOND * (window.noise + ROUND) * (2.0 / WINDOW) ** 0.5
        mean = self._mean
        if mean is None or (np.abs(window.mean - mean) > limit).any():
            mean, self._count = window.mean, 1
        else:
            self._count = min(self._count + 1, _STOOD)
            mean = mean + (window.mean - mean) / self._count
        self._mean = mean
        return mean
