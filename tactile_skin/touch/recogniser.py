# SPDX-License-Identifier: Apache-2.0
"""Names gestures as they happen: which touches are one gesture, and what the hand does.

Pictures are averaged to 25 a second, fine cells are put together, and each is gated by its standard
deviation, so that a noisy skin sees less rather than something else. Touches near each other in
space and time are one gesture; one that stands still becomes background. A gesture is named as soon
as the model is sure, and again where it changes its mind, until the hand is gone.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .episode import FEATURES, LIMIT, SILENCE, Episode
from .features import segment
from .model import OTHER, GestureModel
from .tracking import IDS

PERIOD = 0.04  # s between pictures: a slap is seen in two, and noise is averaged over four frames
GATE = 3.0  # standard deviations above which a cell is touched
TOUCHED = 0.1  # N: a touch has a cell with more
COMMON_PITCH = 0.02  # m: fingers lie so far apart; finer cells say more of the mat than of the hand
_FINE = 0.75  # of it: mats with less between their cells are read on cells of COMMON_PITCH
REACH = 0.06  # m: touches within it of each other are of one hand: fingers are 0.02 to 0.04 apart
FIRST = 0.2  # s of a gesture before it is judged: until then a pat and a poke look alike
EVERY = 0.08  # s between two judgements at least,
_LONGER = 0.1  # and this share of its length so far: less than that changes no mind
STILL = 2.0  # s after which a touch that does not change is background
_CHANGE = 0.2  # share of its force by which a still touch may vary: a hand breathes by 5 to 10 %
_MOVED = 0.5  # pitches by which the centre of a still touch may move
_HARDER = 1.5  # times its force from which on what was background is a gesture again
_GONE = 0.3  # share of its force below which background is leaving
_ITS_OWN = 0.5  # share of a touch's force on the cells of the background that make it background
# m^2 that all touches cover, more than hands do: one is 0.8 % of a body's 1.8 m^2, 0.014 m^2. Who
# lies or sits on a skin covers 0.15 m^2 and more, and a part of him that moves is no gesture.
_HANDS = 0.1
_PAUSE = 0.5  # s without a frame, which ends all gestures

NEW, HELD, DECIDED, ENDED = "new", "held", "decided", "ended"
STATES = (NEW, HELD, DECIDED, ENDED)


class Picture(NamedTuple):
    """The mean of some frames."""

    force: np.ndarray  # (rows, cols) of Cells [N], 0 where nothing surely touches
    period: float  # since the picture before [s]
    first: bool  # whether there was a pause before it


class Cells:
    """Cells of about one size, in which a touch looks alike on mats of any pitch.

    Those of a fine mat give their force to the larger ones they lie on, by area.

    Args:
        pitch: distance between neighbouring cells of the mat [m]; `pitch`: of these cells.
    """

    def __init__(self, pitch: float):
        self.pitch = COMMON_PITCH if pitch < _FINE * COMMON_PITCH else pitch
        self._ratio = self.pitch / pitch
        self._ends = np.zeros(2)  # last row and column of the mat

    def of(self, force: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the force on these cells and its standard deviation, of the mat's (rows, cols)."""
        self._ends = np.array(force.shape) - 1.0
        if self._ratio == 1.0:
            return force, std
        down, across = (_shares(n, self._ratio) for n in force.shape)
        variance = down**2 @ np.broadcast_to(std, force.shape) ** 2 @ (across**2).T
        return np.asarray(down @ force @ across.T), np.sqrt(variance)

    def place(self, row: float, col: float) -> tuple[float, float]:
        """Return the row and column of the mat at a row and column of these cells."""
        at = (np.array([row, col]) + 0.5) * self._ratio - 0.5
        row, col = np.minimum(at, self._ends).tolist()  # the last of these cells may reach beyond
        return row, col


@lru_cache(maxsize=8)
def _shares(n: int, ratio: float) -> np.ndarray:
    """Return (m, n): the share of each of n cells that lies on each of m that are `ratio` long."""
    edge = np.arange(math.ceil(n / ratio) + 1)[:, None] * ratio
    start = np.arange(n)
    overlap = np.minimum(edge[1:], start + 1) - np.maximum(edge[:-1], start)
    return np.asarray(np.maximum(overlap, 0.0))


class Pictures:
    """Averages frames to PERIOD, in `Cells`, and gates each cell by its standard deviation."""

    def __init__(self, cells: Cells) -> None:
        self._cells = cells
        self._last = -math.inf
        self._begin(-math.inf, True)

    def _begin(self, t: float, first: bool) -> None:
        """Begin a picture after a frame at t [s]."""
        self._start, self._first, self._count = t, first, 0
        self._force: np.ndarray | float = 0.0  # sums over its frames
        self._std: np.ndarray | float = 0.0

    def update(self, t: float, force: np.ndarray, std: np.ndarray | float = 0.0) -> Picture | None:
        """Take a frame; return the picture that it completes.

        Args:
            t: when it was taken [s].
            force: (rows, cols) on each cell [N].
            std: (rows, cols) or one, standard deviation of the force [N].
        """
        step, self._last = t - self._last, t
        if not 0.0 < step <= _PAUSE:  # how long this frame lasts is not known
            self._begin(t, True)
            return None
        self._count += 1
        self._force = self._force + force
        self._std = self._std + std
        if t - self._start < PERIOD - step / 2:
            return None
        mean, spread = self._cells.of(
            np.asarray(self._force / self._count), np.asarray(self._std / self._count**1.5)
        )
        felt = np.where(mean > np.maximum(LIMIT, GATE * spread), mean, 0.0)
        picture = Picture(felt, t - self._start, self._first)
        self._begin(t, False)
        return picture


class Named(NamedTuple):
    """A gesture as it is at a picture."""

    id: int  # from 1
    state: str  # one of STATES
    decided: bool  # whether its label is new, or the first
    label: str  # what it is, "other", or "" while the model is not sure
    probabilities: np.ndarray  # (classes,) in the order of the model's classes
    features: np.ndarray  # those of `episode.FEATURES` that the model was asked with last
    place: tuple[float, float]  # row and column of the mat, of the centre of force
    force: float  # [N]; 0 between two touches and when it has ended
    duration: float  # [s]


class Ongoing:
    """One gesture as it goes on: the touches that belong together, and what they did so far."""

    def __init__(self, number: int, episode: Episode, start: float):
        self.id, self.episode = number, episode  # from 1; its pictures, in numbers
        self.start = self.seen = start  # when it began, and its last picture was complete [s]
        self.state = NEW  # NEW, HELD or ENDED
        self.still = False  # whether it has ended because it stands still
        self.place = (0.0, 0.0)  # row and column of `Cells`, of the centre of force
        self.force = 0.0  # [N]; 0 between two touches and when it has ended
        self.impulse = 0.0  # sum of its force over time [N s]
        self.covered = 0.0  # area that it and all other touches covered, at the most [m^2]
        self.cells = np.zeros(0, int)  # (n,) flat numbers of all that it has touched
        # force, row and column of the last pictures
        self._course: list[tuple[float, float, float]] = []

    def follow(self, t: float, own: np.ndarray) -> None:
        """Take the picture of its cells (rows, cols) [N] at t [s]."""
        self.seen = t
        self.episode.add(own)
        self.force, *centre = self.episode.touch
        self.impulse += self.force * self.episode.period
        if self.force > 0.0:
            self.place = centre[0], centre[1]
        self._course.append((self.force, *self.place))
        if len(self._course) * self.episode.period > STILL:
            del self._course[0]
        over = self.episode.silence >= SILENCE
        self.still = not over and self._is_still()
        if over or self.still:
            self.state = ENDED

    def _is_still(self) -> bool:
        if (len(self._course) + 1) * self.episode.period < STILL:
            return False
        force, row, col = np.array(self._course).T
        mean = force.mean()
        steady = force.min() > 0.0 and np.abs(force - mean).max() < _CHANGE * mean
        return bool(steady and max(np.ptp(row), np.ptp(col)) < _MOVED)


class _Background(NamedTuple):
    """A touch that stands still."""

    cells: np.ndarray  # (rows, cols) bool, of the touch and next to it
    force: float  # [N] when it became background

    @classmethod
    def of(cls, gesture: Ongoing) -> _Background:
        own = gesture.episode.last > 0.0
        wide = np.pad(own, 1)
        for axis in (0, 1):
            wide = wide | np.roll(wide, 1, axis) | np.roll(wide, -1, axis)
        return cls(wide[1:-1, 1:-1], gesture.force)


class Gathering:
    """Gathers the touches that are one gesture: those within `reach` [m], soon after each other."""

    def __init__(self, pitch: float, reach: float = REACH):
        self.cells, self.reach = Cells(pitch), reach
        self._ids = 0
        self._pictures = Pictures(self.cells)
        self._active: list[Ongoing] = []
        self._background: list[_Background] = []

    def update(self, t: float, force: np.ndarray, std: np.ndarray | float = 0.0) -> list[Ongoing]:
        """Take a frame; return the gestures that go on or have just ended, if it ends a picture.

        After a pause of frames those before it have ended.
        """
        picture = self._pictures.update(t, force, std)
        if picture is None:
            return []
        lost: list[Ongoing] = []
        if picture.first:
            lost, self._active, self._background = self._active, [], []
            for gesture in lost:
                gesture.state, gesture.force = ENDED, 0.0
        return lost + self._picture(t, picture.force, picture.period)

    def _picture(self, t: float, force: np.ndarray, period: float) -> list[Ongoing]:
        cells, owner, n = segment(force, TOUCHED)
        flat, cols = force.ravel(), force.shape[1]
        touches = [cells[owner == k] for k in range(n)]
        touches = self._past_background(flat, touches)
        parts: dict[int, list[np.ndarray]] = {}
        for touch in touches:
            gesture = self._belongs_to(touch, cols)
            if gesture is None:
                self._ids = self._ids % (IDS - 1) + 1
                episode = Episode(force.shape, self.cells.pitch, period)
                gesture = Ongoing(self._ids, episode, t)
                self._active.append(gesture)
            gesture.cells = np.union1d(gesture.cells, touch)
            parts.setdefault(gesture.id, []).append(touch)
        followed = self._active
        covered = np.count_nonzero(flat) * self.cells.pitch**2
        for gesture in followed:
            gesture.covered = max(gesture.covered, covered)
            own = np.zeros(force.shape)
            for touch in parts.get(gesture.id, ()):
                own.ravel()[touch] = flat[touch]
            if gesture.episode.duration > 0.0:
                gesture.state = HELD
            gesture.follow(t, own)
        self._background += [_Background.of(gesture) for gesture in followed if gesture.still]
        self._active = [gesture for gesture in followed if gesture.state != ENDED]
        return followed

    def _past_background(self, flat: np.ndarray, touches: list[np.ndarray]) -> list[np.ndarray]:
        """Return the touches that are not background, and let go of background that has left."""
        kept, free = [], list(range(len(touches)))
        for still in self._background:
            on = still.cells.ravel()
            own = [
                k
                for k in free
                if flat[touches[k]][on[touches[k]]].sum() > _ITS_OWN * flat[touches[k]].sum()
            ]
            force = sum(float(flat[touches[k]].sum()) for k in own)
            if force < _HARDER * still.force:
                free = [k for k in free if k not in own]
                if force > 0.0:  # what is left of it as it leaves is no new gesture
                    leaves = force < _GONE * still.force
                    kept.append(still._replace(force=force) if leaves else still)
        self._background = kept
        return [touches[k] for k in free]

    def _belongs_to(self, touch: np.ndarray, cols: int) -> Ongoing | None:
        """Return the gesture that has touched nearest to this touch, within reach."""
        nearest, least = None, self.reach
        rows, columns = np.divmod(touch, cols)
        for gesture in self._active:
            r, c = np.divmod(gesture.cells, cols)
            away = np.hypot(rows[:, None] - r, columns[:, None] - c).min() * self.cells.pitch
            if away < least:
                nearest, least = gesture, away
        return nearest


class _Opinion:
    """What the model has said of a gesture."""

    def __init__(self) -> None:
        self.label = ""
        self.surely = -1  # number of the class that it was last sure of, or -1
        self.probabilities, self.features = np.zeros(0), np.zeros(len(FEATURES))
        self.due = FIRST  # s into the gesture when the model is asked next


class Recogniser:
    """Names the gestures on one skin.

    Args:
        model: what it names.
        pitch: distance between neighbouring cells [m].
        min_probability: of a gesture that is named.
    """

    def __init__(self, model: GestureModel, pitch: float, min_probability: float = 0.7):
        self.model, self.min_probability = model, min_probability
        self._gathering = Gathering(pitch)
        self._opinions: dict[int, _Opinion] = {}  # of the gestures that go on, by id

    def update(self, t: float, force: np.ndarray, std: np.ndarray | float = 0.0) -> list[Named]:
        """Take a frame, as `Pictures.update`.

        Returns:
            The gestures that go on or have just ended, where this frame completes a picture; else
            an empty list.
        """
        gestures = self._gathering.update(t, force, std)
        if not gestures:
            return []
        self._opinions = {g.id: self._opinions.get(g.id) or _Opinion() for g in gestures}
        named = []
        for gesture in gestures:
            opinion = self._opinions[gesture.id]
            decided = self._judge(gesture, opinion)
            state = DECIDED if decided and gesture.state != ENDED else gesture.state
            said = opinion.label, opinion.probabilities, opinion.features
            seen = self._gathering.cells.place(*gesture.place), gesture.force
            named.append(
                Named(gesture.id, state, decided, *said, *seen, gesture.seen - gesture.start)
            )
        return named

    def _judge(self, gesture: Ongoing, opinion: _Opinion) -> bool:
        """Ask the model; return whether the gesture has a label that it had not."""
        episode, final = gesture.episode, gesture.state == ENDED
        if not final and episode.duration < opinion.due:
            return False
        wait = max(EVERY, _LONGER * episode.duration)
        opinion.due = episode.duration + wait - episode.period / 2
        opinion.features = episode.features()
        opinion.probabilities = self.model.probabilities(opinion.features)
        favourite = int(opinion.probabilities.argmax())
        label = self.model.classes[favourite]
        sure = opinion.probabilities[favourite] >= self.min_probability
        sure = sure and (label == OTHER or not (gesture.covered > _HANDS or episode.lies()))
        again = favourite == opinion.surely
        opinion.surely = favourite if sure else -1
        if final and not sure:
            label = OTHER  # what was named early on is withdrawn
        elif not sure or not (again or final):
            return False
        if label == opinion.label:
            return False
        opinion.label = label
        return True
