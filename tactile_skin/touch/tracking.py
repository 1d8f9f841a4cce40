# SPDX-License-Identifier: Apache-2.0
"""Contacts over time: touches with an id that stays while they move, join and part.

A frame's contact is the touch that it is nearest to, where that one was foreseen (linear
assignment within a gate), or whose cells it lies on. Where two touches join, both are one with the
id of the older; the younger has its id again when they part soon.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from .features import Contact, Frame

NEW, HELD, RELEASED = "new", "held", "released"
STATES = (NEW, HELD, RELEASED)

# Chosen on simulated touches (tests/touch); scored by benchmarks.accuracy.touch, in docs/touch.md.
LONGEST = 0.3  # s of places to which a touch's line of motion is fitted at most,
_SHORTEST = 0.07  # s of them that are fitted though they bend,
_MIN_PLACES = 4  # and places that determine a line
# Pitches, RMS, from a line, from which on a touch turns or changes its speed; more for a small one,
# whose centre stands on a cell and then goes on to the next. Fitted to round fingers of 7 to 22 mm
# that slide, rub, start and stop on the mat of benchmarks.body.seam, on seeds 100, 500 and 700.
_BENT = 0.04
_STAIRS = 0.35  # pitches more for each cell that it has fewer than
_SMOOTH = 1.8  # cells: its force over its hardest cell's
_SURE_AFTER = 0.12  # s of places from which on a touch is known as well as can be
_NOISE = 0.001  # m, RMS error of the centre of a touch that does not move
_REACH = 1.5  # pitches from its predicted place within which it is found,
_MAX_SPEED = 2.0  # and m/s
_MAX_ABSENCE = 0.05  # s that a touch may be missing before it is released
_PREDICTED = 0.3  # s for which the motion of a touch that has joined another is extrapolated
_MIN_DISTANCE = 1.5  # pitches between two touches
_MEMORY = 2.0  # s that a touch is kept after it joined another
_PART_OF = 0.5  # of a contact's force on a touch's cells, from which on it belongs to that touch
_STAYS = 0.3  # of a touch's force that is still on its cells, from which on it was not lifted
_STANDING = np.zeros(3)
IDS = 2**24  # a float32, as PointCloud2 carries it, holds so many different ones


class Touch(NamedTuple):
    """One touch as it is at a frame."""

    id: int  # from 1
    state: str  # one of STATES; "released" is reported once, with its last contact
    contact: Contact
    velocity: np.ndarray  # (3,) [m/s] of the centre; zero until it is known
    confidence: float  # 0..1, that it moves: near 0 for a touch that stands still


class Course:
    """Where a touch was lately: its velocity is that of the longest part that is a line.

    Args:
        pitch: of the cells [m].

    Attributes:
        velocity: (3,) [m/s]; zero until it is known.
        span: s that the line lasts; 0: there is none.
        seen: s that it is known for, 0.3 at most.
    """

    def __init__(self, pitch: float):
        self._pitch = pitch
        self._rows: list[tuple[float, ...]] = []  # t, x, y, z, cells
        self.velocity, self.span, self.seen = _STANDING, 0.0, 0.0

    def add(self, t: float, place: np.ndarray, cells: float) -> None:
        """Take where the touch is at t [s], which is later than before, or takes its last place.

        Args:
            place: (3,) [m].
            cells: its force over its hardest cell's.
        """
        rows = self._rows
        if rows and t <= rows[-1][0]:
            t = rows.pop()[0]
        rows.append((t, *place.tolist(), cells))
        while rows[0][0] < t - LONGEST:
            del rows[0]
        self.seen = t - rows[0][0]
        self.velocity, self.span = _STANDING, 0.0
        if len(rows) >= _MIN_PLACES:
            self._fit(np.array(rows[::-1]))

    def _fit(self, rows: np.ndarray) -> None:
        """Fit a line to the newest four places, five, and so on; take the longest that is one."""
        n = len(rows)
        columns = np.empty((13, n))  # t, x, y, z, cells; t^2, tx, ty, tz; and x^2, y^2, z^2; n
        columns[:5] = rows.T
        columns[:4] -= columns[:4, :1]
        np.multiply(columns[0], columns[:4], out=columns[5:9])
        np.square(columns[1:4], out=columns[9:12])
        columns[12] = 1.0
        sums = columns.cumsum(1)[:, _MIN_PLACES - 1 :]
        means = sums[:12] / sums[12]
        spread = means[5] - means[0] ** 2
        with_t = means[6:9] - means[0] * means[1:4]
        velocity = with_t / spread
        off2 = (means[9:12] - means[1:4] ** 2 - velocity * with_t).sum(0)
        allowed = _BENT + _STAIRS * np.maximum(_SMOOTH - means[4], 0.0)
        spans = -columns[0, _MIN_PLACES - 1 :]
        lines = (off2 <= (self._pitch * allowed) ** 2) | (spans <= _SHORTEST)
        k = int(lines.nonzero()[0].max(initial=0))
        self.velocity, self.span = velocity[:, k], float(spans[k])


class _Track:
    """What is known of one touch."""

    contact: Contact  # its last one

    def __init__(self, number: int, t: float, pitch: float):
        self.id, self.born = number, t
        self._pitch, self._course = pitch, Course(pitch)
        self.members = [self]  # the touches that are one contact, this, the oldest, first
        self.velocity, self.confidence = _STANDING, 0.0
        # Where it is by itself among its members, by its last place alone and how it went on from
        # there: velocity [m/s], once joined of what it moves apart from the others.
        self.since, self.place, self.leaving = t, _STANDING, _STANDING
        self.joined = t

    def take(self, t: float, contact: Contact, members: list[_Track]) -> None:
        """Take a contact at t for the touch; a centre that jumps says nothing of how it moves."""
        self.state, jumped = NEW, True
        if self.born < t:
            off = contact.position - self.foreseen(t)
            self.state, jumped = HELD, members != self.members or off @ off > self._pitch**2
        if members[1:] and members != self.members:
            _join(t, members, self.members, self._pitch)
        elif members[1:]:
            for member in members:  # they go where the whole goes
                member.place = member.place + contact.position - self.contact.position
        self.members, self.contact, self.seen = members, contact, t
        if jumped:
            self._course = Course(self._pitch)
        course = self._course
        course.add(t, contact.position, contact.force / contact.peak)
        self.velocity = course.velocity
        travelled2 = float(self.velocity @ self.velocity) * course.span**2
        sure = min(1.0, course.seen / _SURE_AFTER)
        self.confidence = sure * travelled2 / (travelled2 + (3.0 * _NOISE) ** 2)
        if not members[1:]:
            self.since, self.place, self.leaving = t, contact.position, self.velocity

    def foreseen(self, t: float) -> np.ndarray:
        """Where the touch, with all that joined it, is likely to be."""
        return self.contact.position + self.velocity * min(t - self.seen, _PREDICTED)

    def foreseen_alone(self, t: float) -> np.ndarray:
        """Where it would be without those that joined it."""
        return self.place + self.leaving * min(t - self.since, _PREDICTED)

    def as_touch(self, state: str) -> Touch:
        return Touch(self.id, state, self.contact, self.velocity, self.confidence)


def _join(t: float, members: list[_Track], before: list[_Track], pitch: float) -> None:
    """Those of `members` that were not there `before` join the others.

    Fingers pass by each other, not through: those that run into each other go on as one.
    """
    places = [member.foreseen_alone(t) for member in members]
    leaving = [member.leaving for member in members]
    for i, one in enumerate(members):
        for k, other in enumerate(members):
            if one in before and other not in before:
                apart, velocity = places[k] - places[i], leaving[k] - leaving[i]
                if (speed2 := velocity @ velocity) > 0.0:
                    apart = apart + velocity * max(-(apart @ velocity) / speed2, 0.0)
                if apart @ apart < (_MIN_DISTANCE * pitch) ** 2:  # where they are nearest
                    leaving[i] = leaving[k] = (leaving[i] + leaving[k]) / 2
    mean = sum(leaving) / len(members)
    for member, place, velocity in zip(members, places, leaving, strict=True):
        member.since, member.place, member.leaving = t, place, velocity - mean
        if member not in before[1:]:
            member.joined = t


class Tracker:
    """Gives the contacts of one skin, whose cells have a pitch [m], their ids."""

    def __init__(self, pitch: float):
        self.pitch = pitch
        self._tracks: list[_Track] = []
        # (rows, cols) 1 + place in `_tracks` at the last frame
        self._on = np.zeros((0, 0), int)
        self._t = -np.inf
        self._ids = 0

    def update(self, t: float, frame: Frame) -> list[Touch]:
        """Return a touch for each contact of a frame of t [s], in their order, then those released.

        One that was out of sight for less than 0.05 s, or joined another, is not reported.
        """
        released: list[_Track] = []
        if t < self._t:  # the clock was set back: what was seen has no place in time
            released = [member for track in self._tracks for member in track.members]
            self._tracks = []
        tracks, found = self._tracks, frame.contacts
        claims: list[list[_Track]] = [[] for _ in found]  # the touches that each contact is
        lost = list(range(len(tracks)))
        if tracks and found:
            lost = self._assign(t, frame, claims)
        now = []
        for contact, claim in zip(found, claims, strict=True):
            members = sorted(claim, key=lambda track: track.born) or [self._new(t)]
            members[0].take(t, contact, members)
            now.append(members[0])
        for track in now:
            released += [m for m in track.members[1:] if t - m.joined > _MEMORY]
            track.members = [m for m in track.members if m not in released]
        hidden = []
        for j in lost:
            if t - tracks[j].seen > _MAX_ABSENCE:
                released += tracks[j].members
            else:
                hidden.append(tracks[j])
        self._tracks, self._on, self._t = now + hidden, frame.labels, t
        return [track.as_touch(track.state) for track in now] + [
            r.as_touch(RELEASED) for r in released
        ]

    def _new(self, t: float) -> _Track:
        self._ids = self._ids % (IDS - 1) + 1
        return _Track(self._ids, t, self.pitch)

    def _assign(self, t: float, frame: Frame, claims: list[list[_Track]]) -> list[int]:
        """Put the touches that each contact is into `claims`; returns the places of those lost."""
        tracks, found = self._tracks, frame.contacts
        away = _distances([track.foreseen(t) for track in tracks], [c.position for c in found])
        reach = _REACH * self.pitch + _MAX_SPEED * min(t - self._t, _MAX_ABSENCE)
        pieces: list[list[int]] = [[] for _ in tracks]  # the contacts that each touch is now
        unmatched = set(range(len(found)))
        for j, k in _match(away, reach):
            pieces[j].append(k)
            unmatched.discard(k)
        if unmatched or not all(pieces):
            shared = self._shared_force(frame)  # (tracks, contacts) [N]
            part_of = shared > _PART_OF * np.array([c.force for c in found])
            stays = shared > _STAYS * np.array([[track.contact.force] for track in tracks])
            for k in unmatched:
                if part_of[:, k].any():
                    pieces[int(part_of[:, k].argmax())].append(k)
            for j in range(len(tracks)):
                if not pieces[j] and stays[j].any():  # it joined another
                    pieces[j].append(int(shared[j].argmax()))
        lost = []
        for j, track in enumerate(tracks):
            if len(pieces[j]) == 1:
                claims[pieces[j][0]] += track.members
            elif pieces[j]:
                self._part(t, track, pieces[j], found, claims)
            else:
                lost.append(j)
        return lost

    def _part(
        self,
        t: float,
        track: _Track,
        pieces: list[int],
        found: list[Contact],
        claims: list[list[_Track]],
    ) -> None:
        """Part a touch that is several contacts now: who of those that joined it is which."""
        members = track.members
        alone = [m.foreseen_alone(t) for m in members] if members[1:] else [track.foreseen(t)]
        away = _distances(alone, [found[k].position for k in pieces])
        which = dict(_match(away, np.inf))
        for i, member in enumerate(members):
            claims[pieces[which.get(i, int(away[i].argmin()))]].append(member)

    def _shared_force(self, frame: Frame) -> np.ndarray:
        """(tracks, contacts) force [N] of each contact on the cells of each track's last one."""
        on = self._on.ravel()[frame.cells]  # (m,)
        force: np.ndarray = (on == np.arange(1, len(self._tracks) + 1)[:, None]) @ frame.own.T
        return force


def stroke(touches: list[Touch]) -> tuple[np.ndarray, float]:
    """Velocity (3,) [m/s] of a single touch along the skin, and the confidence 0..1 that it moves.

    Two touches at once, or none, make no stroke.
    """
    held = [touch for touch in touches if touch.state != RELEASED]
    if len(held) != 1:
        return np.zeros(3), 0.0
    return held[0].velocity, held[0].confidence


def _distances(a: list[np.ndarray], b: list[np.ndarray]) -> np.ndarray:
    """(len(a), len(b)) [m]."""
    ends = [q.tolist() for q in b]
    return np.array([[math.dist(p.tolist(), q) for q in ends] for p in a])


def _match(cost: np.ndarray, limit: float) -> list[tuple[int, int]]:
    """Pairs of least total cost, each below the limit."""
    rows, cols = linear_sum_assignment(np.where(cost < limit, cost, 1e6))
    pairs = zip(rows.tolist(), cols.tolist(), strict=True)
    return [(j, k) for j, k in pairs if cost[j, k] < limit]
