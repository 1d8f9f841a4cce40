# SPDX-License-Identifier: Apache-2.0
"""When a push begins and ends, and when a stroke begins: what hooks are called for.

Pure, like stop.py: stamps come in, events come out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

_STROKE_BEGINS = 0.8  # confidence, 0..1: chosen, with hysteresis
_STROKE_ENDS = 0.4  # the same


class Pushed(NamedTuple):
    force: np.ndarray  # (3,) [N], on the robot, in the base frame; zero while it is not known
    centre: np.ndarray  # (3,) [m], centre of force


class Released(NamedTuple):
    seconds: float  # that the push lasted, its hold included


class Stroked(NamedTuple):
    velocity: np.ndarray  # (3,) [m/s], along the skin, in the base frame
    confidence: float  # 0..1


class Gesture(NamedTuple):
    name: str  # a class of the recogniser, or "other"
    probability: float  # of that class
    id: int  # of the gesture, which may be named again with another name
    position: np.ndarray  # (3,) [m], in the base frame
    force: float  # [N]; 0 where the hand has gone
    duration: float  # [s] until now


class Gestured(NamedTuple):
    gesture: Gesture


Event = Pushed | Released | Stroked | Gestured


class PushEvents:
    """Pairs the decisions of the stop with the place of the touch.

    The stop may decide before the wrench of the same reading is there: the event waits for it, but
    not longer than until the next decision.
    """

    def __init__(self) -> None:
        self._touch: tuple[float, Pushed] | None = None  # newest, with its stamp
        self._since: float | None = None  # stamp of the reading that began the push
        self._reported = False

    def touch(
        self, stamp: float, force: npt.ArrayLike, centre: npt.ArrayLike
    ) -> list[Pushed | Released]:
        """Wrench and centre of the reading of this stamp."""
        self._touch = stamp, Pushed(np.asarray(force, float), np.asarray(centre, float))
        return self._begin() if self._here() else []

    def stop(self, stamp: float, pushed: bool) -> list[Pushed | Released]:
        """Take the stop decided on the reading of this stamp: whether a push is on."""
        began = pushed and self._since is None
        if began:
            self._since, self._reported = stamp, False
        if self._since is None:
            return []
        events = self._begin() if self._here() or not began else []
        if not pushed:
            events.append(Released(max(0.0, stamp - self._since)))
            self._since = None
        return events

    def _here(self) -> Pushed | None:
        """Return where it is pushed, by a touch of this push; None: by none yet."""
        if self._touch is None or self._since is None or self._touch[0] < self._since:
            return None
        return self._touch[1]

    def _begin(self) -> list[Pushed | Released]:
        if self._reported:
            return []
        self._reported = True
        return [self._here() or Pushed(np.zeros(3), np.zeros(3))]


class StrokeEvents:
    """One event a stroke: when its confidence has risen, and again only after it has sunk."""

    def __init__(self) -> None:
        self._on = False

    def update(self, velocity: npt.ArrayLike, confidence: float) -> list[Stroked]:
        """Velocity (3,) [m/s] of the touch along the skin, with its confidence 0..1."""
        begins = not self._on and confidence >= _STROKE_BEGINS
        self._on = begins or (self._on and confidence >= _STROKE_ENDS)
        return [Stroked(np.asarray(velocity, float), confidence)] if begins else []
