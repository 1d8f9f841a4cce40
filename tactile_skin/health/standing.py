# SPDX-License-Identifier: Apache-2.0
"""A touch that stands without moving, from the first frame on or for minutes: what it may be."""

from __future__ import annotations

import numpy as np

from ..calibration.touched import TOUCHED
from ..findings.finding import Finding, Kind, largest
from ..physics.adc import Adc
from .check import Check, Seen

_LOOK = 1.0  # s between looks
# Of its force, by cells, that a touch may differ from what it was: fabric creeps by 10 to 30 % a
# decade of time, a hand that works changes all of it.
_MOVED = 0.3
_FIRST = (
    3.0  # s after the first frame in which a touch counts as there from the start: rest takes 1
)
_SOON = 10.0  # s that such a touch stands when it is said,
_LONG = 120.0  # and any other
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
