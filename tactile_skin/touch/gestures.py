# SPDX-License-Identifier: Apache-2.0
"""A touch from its start to its release, in the terms of the social-touch field.

The features are those of Jung et al., "Touching the Void - Introducing CoST: Corpus of Social
Touch" (ICMI 2014), for one touch instead of the whole sensor, in SI units, and of the touch so far:
they are final at its release. What is left out are the mean pressures of each row and column,
which name places on the sensor and not what the hand does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .episode import FALLEN, RISEN
from .features import Contact, Frame
from .geometry import Geometry
from .tracking import RELEASED, Touch

_STEP = 0.001  # m: the RMS error of a centre; shorter steps would add up to a path


class Gesture(NamedTuple):
    """Features of one touch so far; means are over its frames."""

    duration: float  # [s], from its first frame to its last
    mean_pressure: float  # [Pa], of force / area
    max_pressure: float  # [Pa], on one cell
    pressure_variability: float  # [N/s], sum over its cells of |change of force|, mean over time
    contact_area: float  # [m^2], mean
    max_pressure_contact_area: float  # [m^2], in the frame of its largest force
    peak_count: int  # times that its force rose above half of its largest so far
    displacement: float  # [m], length of the centre's way
    net_displacement: float  # [m], from the first centre to the last


class Gestures:
    """Follows the touches of one skin."""

    def __init__(self, geometry: Geometry):
        self._area, self._pitch = geometry.cell_area.ravel(), geometry.pitch
        self._courses: dict[int, _Course] = {}
        # Of the last frame: force [N] on the cells, their contacts and the touches that these were.
        self._force = np.zeros(geometry.cell_area.shape)
        self._labels = np.zeros(geometry.cell_area.shape, int)
        self._ids: list[int] = []

    def update(self, t: float, frame: Frame, touches: list[Touch]) -> list[Gesture]:
        """Return a gesture for each of `Tracker.update`'s touches of a frame taken at t [s]."""
        if not touches:
            return []
        labels, n = frame.labels, len(frame.contacts)
        ids = [touch.id for touch in touches[:n]]
        # A cell that is touched no more changed by the touch that has left it.
        left_by = self._labels
        if ids != self._ids:
            label_now = {number: k for k, number in enumerate(ids, 1)}
            left_by = np.array([0, *(label_now.get(number, 0) for number in self._ids)])[left_by]
        changed_by = np.where(labels, labels, left_by)
        change = np.abs(frame.force - self._force)
        changes = np.bincount(changed_by.ravel(), change.ravel(), n + 1).tolist()
        hardest = (frame.own / self._area[frame.cells]).max(1, initial=0.0).tolist()
        for k, (touch, peak) in enumerate(zip(touches, hardest, strict=False), 1):
            course = self._courses.get(touch.id)
            if course is None:
                course = self._courses[touch.id] = _Course(t, touch.contact)
            course.take(t, touch.contact, peak, changes[k], self._pitch)
        gestures = [self._courses[touch.id].gesture() for touch in touches]
        for touch in touches:
            if touch.state == RELEASED:
                del self._courses[touch.id]
        self._force, self._labels, self._ids = frame.force, labels, ids
        return gestures


class _Course:
    """What a touch's features are summed up from."""

    def __init__(self, t: float, contact: Contact):
        self.start = self.end = t
        self.first = self.last = self.anchor = contact.position.tolist()
        self.frames = self.peaks = 0
        self.above = False
        self.pressure = self.hardest = self.changed = self.area = self.way = 0.0
        self.largest = self.largest_area = 0.0

    def take(self, t: float, contact: Contact, hardest: float, changed: float, jump: float) -> None:
        """Take the next contact of the touch.

        Args:
            hardest: pressure on one cell [Pa].
            changed: sum of |change of force| [N].
            jump: a centre that moves so far at once [m] did not move, the touch joined another.
        """
        self.end, self.last = t, contact.position.tolist()
        self.frames += 1
        self.pressure += contact.force / contact.area
        self.hardest = max(self.hardest, hardest)
        self.changed += changed
        self.area += contact.area
        if contact.force > self.largest:
            self.largest, self.largest_area = contact.force, contact.area
        above = contact.force > (FALLEN if self.above else RISEN) * self.largest
        self.peaks += above and not self.above
        self.above = above
        moved = math.dist(self.last, self.anchor)
        if moved >= _STEP:
            self.way += moved if moved < jump else 0.0
            self.anchor = self.last

    def gesture(self) -> Gesture:
        duration = self.end - self.start
        return Gesture(
            duration=duration,
            mean_pressure=self.pressure / self.frames,
            max_pressure=self.hardest,
            pressure_variability=self.changed / duration if duration > 0.0 else 0.0,
            contact_area=self.area / self.frames,
            max_pressure_contact_area=self.largest_area,
            peak_count=self.peaks,
            displacement=self.way,
            net_displacement=math.dist(self.last, self.first),
        )
