"""Two lines that are exchanged: what touches tell of the order of the lines.

A touch covers neighbouring cells. Read in the right order its picture rises once and falls once;
with two lines exchanged it is torn, and varies more from line to line. Each touch has one vote, of
the size by which another order would be smoother than this one.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from .load import IDLE

_FEWEST = 5  # touches that speak for another order, or against it
_SPEAKS = 0.02  # share of a touch's variation by which one does
_MAJORITY = 0.5  # of the votes' sum over the sum of their sizes
_GAIN = 0.06  # share of all variation that the other order saves at least, of one touch
_LIGHT = 0.03  # share of the picture's largest value below which a cell counts as untouched
_FEWEST_LINES = 4  # whose order the touches tell
# What a running skin says takes more, since nobody asked: touches, agreement of the votes, share
# saved. Chosen on grips of two fingers at one distance, which look torn on 8 columns, and on
# everyday touches of exchanged lines (4 x 4 to 16 x 16).
_SURE_TOUCHES, _SURE_AGREEMENT, _SURE_GAIN = 8, 0.9, 0.15
_KEPT = 24  # touches: the latest
_SAME = 0.8  # share of a touch that another one covers: it has no vote of its own


def smooth_picture(values: np.ndarray) -> np.ndarray:
    """(..., rows, cols) of sum 1, of what each cell gains under touches: the order's evidence."""
    picture = np.sqrt(np.maximum(values, 0.0))
    picture = np.maximum(picture - _LIGHT * picture.max((-2, -1), keepdims=True), 0.0)
    return picture / np.maximum(picture.sum((-2, -1), keepdims=True), 1e-12)


def distances(pictures: np.ndarray) -> np.ndarray:
    """(touches, lines + 2, lines + 2) how much any two lines differ; nothing is touched beyond.

    Args:
        pictures: (touches, lines, cells of a line).
    """
    padded = np.pad(pictures, ((0, 0), (1, 1), (0, 0)))
    return np.abs(padded[:, :, None] - padded[:, None]).sum(3)


class Vote(NamedTuple):
    """Attributes:
    touches: that were counted.
    share: of the variation that the other order saves.
    agreement: sum of the votes over the sum of their sizes.
    """

    touches: int
    share: float
    agreement: float


def vote(now: np.ndarray, other: np.ndarray) -> Vote | None:
    """What touches, of (touches,) variation in this order and in the other, prefer; None: this."""
    found = best_vote(now, (now - other)[:, None])
    return found and found[1]


def best_vote(now: np.ndarray, saved: np.ndarray) -> tuple[int, Vote] | None:
    """The order that most touches prefer, and by how much; None: there is none.

    Args:
        now: (touches,) variation in this order.
        saved: (touches, orders) what each other order saves of it.
    """
    speaks = np.abs(saved) > _SPEAKS * now[:, None]
    size, count = (np.abs(saved) * speaks).sum(0), speaks.sum(0)
    share = saved.sum(0) / max(now.sum(), 1e-12)
    agreement = (saved * speaks).sum(0) / np.maximum(size, 1e-12)
    wins = (count >= _FEWEST) & (agreement >= _MAJORITY)
    wins &= share > _GAIN / max(len(now), 1) ** 0.5
    if not wins.any():
        return None
    k = int(np.where(wins, share, -np.inf).argmax())
    return k, Vote(int(count[k]), float(share[k]), float(agreement[k]))


def exchanged(apart: np.ndarray) -> tuple[tuple[int, int], Vote] | None:
    """The two lines without whose exchange the touches are smoother; None: there are none.

    Args:
        apart: as `distances` has it.
    """
    lines = apart.shape[1] - 2
    if lines < _FEWEST_LINES or len(apart) < _FEWEST:
        return None
    before, here, after = (slice(k, k + lines) for k in range(3))
    k = np.arange(lines)
    beside = apart[:, k, k + 1] + apart[:, k + 1, k + 2]  # (touches, lines), of each to both sides
    there = apart[:, before, here] + apart[:, after, here]  # line b in the place of line a
    saved = beside[:, :, None] + beside[:, None] - there - there.swapaxes(1, 2)
    a, b = np.triu_indices(lines, 1)
    saved = saved[:, a, b] - np.where(b == a + 1, 2.0 * apart[:, a + 1, b + 1], 0.0)
    every = np.arange(lines + 1)
    found = best_vote(apart[:, every, every + 1].sum(1), saved)
    return found and ((int(a[found[0]]), int(b[found[0]])), found[1])


class Order:
    """Follows the touches of one skin.

    Attributes:
        message: which lines seem to be exchanged; empty if none do.
    """

    def __init__(self):
        self.message = ""
        self._pictures: deque[np.ndarray] = deque(maxlen=_KEPT)
        self._strongest: np.ndarray | None = None  # (rows, cols) [N], of the touch that is there

    def frame(self, force: np.ndarray) -> None:
        """Take the force (rows, cols) [N] that was found in a frame."""
        if force.max() >= IDLE:
            if self._strongest is None or force.sum() > self._strongest.sum():
                self._strongest = force
        elif self._strongest is not None:
            self._take(smooth_picture(self._strongest))
            self._strongest = None

    def _take(self, picture: np.ndarray) -> None:
        others = [p for p in self._pictures if np.minimum(p, picture).sum() <= _SAME]
        self._pictures = deque([*others, picture], _KEPT)
        pictures = np.array(self._pictures)
        self.message, most = "", _SURE_GAIN / len(pictures) ** 0.5
        for name, turned in (("rows", pictures), ("columns", pictures.swapaxes(1, 2))):
            if (found := exchanged(distances(turned))) is None:
                continue
            (a, b), votes = found
            sure = votes.touches >= _SURE_TOUCHES and votes.agreement >= _SURE_AGREEMENT
            if sure and votes.share > most:
                most = votes.share
                self.message = (
                    f"{name} {a} and {b} seem to be exchanged: {votes.touches} touches are torn, "
                    "and whole with these lines the other way round. Check the wiring: touches are "
                    "seen in the wrong place"
                )
