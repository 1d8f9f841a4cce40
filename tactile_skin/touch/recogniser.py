"""Names gestures as they happen: which touches are one gesture, and what the hand does.

Pictures are averaged to 25 a second and each cell is gated by its standard deviation, so that a
noisy skin sees less rather than something else. Touches near each other in space and time are one
gesture; one that stands still becomes background. A gesture is named as soon as the model is sure,
and again where it changes its mind, until the hand is gone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .episode import LIMIT, SILENCE, Episode
from .features import segment
from .model import OTHER, GestureModel
from .tracking import IDS

PERIOD = 0.04  # s between pictures: a slap is seen in two, and noise is averaged over four frames
GATE = 3.0  # standard deviations above which a cell is touched
TOUCHED = 0.1  # N: a touch has a cell with more
REACH = 0.06  # m: touches within it of each other are of one hand: fingers are 0.02 to 0.04 apart
FIRST = 0.1  # s of a gesture before it is judged
EVERY = 2  # pictures between two judgements
STILL = 2.0  # s after which a touch that does not change is background
_CHANGE = 0.2  # share of its force by which a still touch may vary: a hand breathes by 5 to 10 %
_MOVED = 0.5  # pitches by which the centre of a still touch may move
_HARDER = 1.5  # times its force from which on what was background is a gesture again
_GONE = 0.3  # share of its force below which background has left
_ITS_OWN = 0.5  # share of a touch's force on the cells of the background that make it background
_PAUSE = 0.5  # s without a frame after which nothing is known of the gestures any more

NEW, HELD, DECIDED, ENDED = "new", "held", "decided", "ended"
STATES = (NEW, HELD, DECIDED, ENDED)


class Picture(NamedTuple):
    """The mean of some frames."""

    force: np.ndarray  # (rows, cols) [N], 0 on cells that are not surely touched
    period: float  # since the picture before [s]
    first: bool  # whether there was a pause before it


class Pictures:
    """Averages frames to PERIOD, and gates each cell by its standard deviation."""

    def __init__(self) -> None:
        self._frames: list[np.ndarray] = []
        self._stds: list[np.ndarray] = []
        self._start = self._last = -math.inf
        self._first = True

    def update(self, t: float, force: np.ndarray, std: np.ndarray | float = 0.0) -> Picture | None:
        """Take a frame; return the picture that it completes.

        Args:
            t: when it was taken [s].
            force: (rows, cols) on each cell [N].
            std: (rows, cols) or one, standard deviation of the force [N].
        """
        step, self._last = t - self._last, t
        if not 0.0 < step <= _PAUSE:  # how long this frame lasts is not known
            self._frames, self._stds, self._start, self._first = [], [], t, True
            return None
        self._frames.append(force)
        self._stds.append(np.broadcast_to(std, force.shape))
        if t - self._start < PERIOD - step / 2:
            return None
        mean = np.mean(self._frames, axis=0)
        spread = np.mean(self._stds, axis=0) / math.sqrt(len(self._frames))
        felt = np.where(mean > np.maximum(LIMIT, GATE * spread), mean, 0.0)
        picture = Picture(felt, t - self._start, self._first)
        self._frames, self._stds, self._start, self._first = [], [], t, False
        return picture


class Named(NamedTuple):
    """A gesture as it is at a picture."""

    id: int  # from 1
    state: str  # one of STATES
    decided: bool  # whether its label is new, or the first
    label: str  # what it is, "other", or "" while the model is not sure
    probabilities: np.ndarray  # (classes,) in the order of the model's classes
    place: tuple[float, float]  # row and column of the centre of force
    force: float  # [N]; 0 between two touches and when it has ended
    duration: float  # [s]


class _Active:
    """A gesture that goes on."""

    def __init__(self, number: int, episode: Episode, start: float):
        self.id, self.episode, self.start = number, episode, start
        self.state, self.label, self.favourite = NEW, "", -1
        self.probabilities = np.zeros(0)
        self.place = (0.0, 0.0)
        self.force, self.seen = 0.0, start
        self.cells = np.zeros(0, int)  # all that it has touched
        # force, row and column of the last pictures
        self.course: list[tuple[float, float, float]] = []


class _Background(NamedTuple):
    """A touch that stands still."""

    cells: np.ndarray  # (rows, cols) bool, of the touch and next to it
    force: float  # [N] when it became background


class Recogniser:
    """Follows the gestures on one skin.

    Args:
        model: what it names.
        pitch: distance between neighbouring cells [m].
        min_probability: of a gesture that is named.
        reach: touches within it of each other are one gesture [m].
    """

    def __init__(
        self,
        model: GestureModel,
        pitch: float,
        min_probability: float = 0.7,
        reach: float = REACH,
    ):
        self.model, self.pitch, self.reach = model, pitch, reach
        self.min_probability = min_probability
        self._ids = 0
        self._pictures = Pictures()
        self.reset()

    def reset(self) -> None:
        """Forget all gestures, the background too."""
        self._active: list[_Active] = []
        self._background: list[_Background] = []
        self._count = 0

    def update(self, t: float, force: np.ndarray, std: np.ndarray | float = 0.0) -> list[Named]:
        """Take a frame, as `Pictures.update`.

        Returns:
            The gestures that go on or have just ended, where this frame completes a picture; else
            an empty list.
        """
        picture = self._pictures.update(t, force, std)
        if picture is None:
            return []
        if picture.first:
            self.reset()
        return self._picture(t, picture.force, picture.period)

    def _picture(self, t: float, force: np.ndarray, period: float) -> list[Named]:
        cells, owner, n = segment(force, TOUCHED)
        flat, cols = force.ravel(), force.shape[1]
        touches = [cells[owner == k] for k in range(n)]
        touches = self._past_background(flat, touches)
        parts: dict[int, list[np.ndarray]] = {}
        for touch in touches:
            active = self._belongs_to(touch, cols)
            if active is None:
                self._ids = self._ids % (IDS - 1) + 1
                episode = Episode(force.shape, self.pitch, period)
                active = _Active(self._ids, episode, t)
                self._active.append(active)
            active.cells = np.union1d(active.cells, touch)
            parts.setdefault(active.id, []).append(touch)
        self._count += 1
        named = []
        for active in tuple(self._active):
            own = np.zeros(force.shape)
            for touch in parts.get(active.id, ()):
                own.ravel()[touch] = flat[touch]
            self._follow(active, t, own)
            named.append(self._name(active, t))
            active.state = HELD
        return named

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
                if force > _GONE * still.force:
                    kept.append(still)
        self._background = kept
        return [touches[k] for k in free]

    def _belongs_to(self, touch: np.ndarray, cols: int) -> _Active | None:
        """Return the gesture that has touched nearest to this touch, within reach."""
        nearest, least = None, self.reach
        rows, columns = np.divmod(touch, cols)
        for active in self._active:
            r, c = np.divmod(active.cells, cols)
            away = np.hypot(rows[:, None] - r, columns[:, None] - c).min() * self.pitch
            if away < least:
                nearest, least = active, away
        return nearest

    def _follow(self, active: _Active, t: float, own: np.ndarray) -> None:
        active.episode.add(own)
        total = float(own.sum())
        active.force = total
        if total > 0.0:
            active.seen = t
            rows, cols = np.indices(own.shape)
            active.place = float((own * rows).sum() / total), float((own * cols).sum() / total)
        active.course.append((total, *active.place))
        if len(active.course) * active.episode.period > STILL:
            del active.course[0]

    def _name(self, active: _Active, t: float) -> Named:
        over = active.episode.silence >= SILENCE
        still = not over and self._is_still(active)
        decided = self._judge(active, over or still)
        state = DECIDED if decided else active.state
        if over or still:
            self._active.remove(active)
            state = ENDED
            if not active.label:
                active.label, decided = OTHER, True
            if still:
                self._stands(active)
        return Named(
            active.id,
            state,
            decided,
            active.label,
            active.probabilities,
            active.place,
            active.force,
            t - active.start,
        )

    def _judge(self, active: _Active, final: bool) -> bool:
        """Ask the model; return whether the gesture has a label that it had not."""
        episode = active.episode
        if not final and (self._count % EVERY or episode.duration < FIRST):
            return False
        active.probabilities = self.model.probabilities(episode.features())
        favourite = int(active.probabilities.argmax())
        sure = active.probabilities[favourite] >= self.min_probability
        again = final or favourite == active.favourite
        active.favourite = favourite
        label = self.model.classes[favourite]
        if not (sure and again) or label == active.label:
            return False
        active.label = label
        return True

    def _is_still(self, active: _Active) -> bool:
        if (len(active.course) + 1) * active.episode.period < STILL:
            return False
        force, row, col = np.array(active.course).T
        mean = force.mean()
        steady = force.min() > 0.0 and np.abs(force - mean).max() < _CHANGE * mean
        return bool(steady and max(np.ptp(row), np.ptp(col)) < _MOVED)

    def _stands(self, active: _Active) -> None:
        own = active.episode.last > 0.0
        wide = np.pad(own, 1)
        for axis in (0, 1):
            wide = wide | np.roll(wide, 1, axis) | np.roll(wide, -1, axis)
        self._background.append(_Background(wide[1:-1, 1:-1], active.force))
