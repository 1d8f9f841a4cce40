# SPDX-License-Identifier: Apache-2.0
"""What touches a skin in a day: fingers, palms, edges, strokes and pushes, one after the other.

`everyday` draws them off the grid, with a texture and a tremor, at `board.KNOTS` a second;
`long_pushes` is for links that stall while a hand presses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .board import KNOTS

IDLE = 1.6  # s at the start: the skin measures its rest
PUSH, PEAK = 30.0, 9.0  # N in all, N on a cell: what config/skin.yaml calls a push
_MARGIN = 1.15  # by which a push exceeds that: cells scatter by 8 %, and a push is no push at 99 %
_LASTS = 0.3  # s above them that make a push
_TEXTURE, _TREMOR = 0.15, 0.03  # RMS, of cells and of the time
_HARD = (11.0, 16.0)  # N on a cell of a hard edge: beyond the curve's end
_KINDS = {  # share of the touches
    "finger": 0.22,
    "two fingers": 0.14,
    "palm": 0.14,
    "edge": 0.1,
    "stroke": 0.1,
    "push": 0.3,
    "hard edge": 0.08,
}


class Touch(NamedTuple):
    kind: str
    start: float  # s
    end: float  # s


@dataclass
class Scene:
    """Touches over time."""

    force: np.ndarray  # (n, rows, cols) [N], at the knots
    touches: list[Touch]  # what was drawn

    def pushes(self, margin: float = _MARGIN) -> list[tuple[int, int]]:
        """First knot, and that behind the last, of each time that PUSH or PEAK is exceeded.

        Only one that exceeds one of them by `margin` for _LASTS counts; it begins where one is
        exceeded at all.
        """
        total, peak = self.force.sum((1, 2)), self.force.max((1, 2))
        level = np.maximum(total / PUSH, peak / PEAK)
        found = []
        for first, last in _runs(level >= 1.0):
            clear = _runs(level[first:last] >= margin)
            if any(b - a >= _LASTS * KNOTS for a, b in clear):
                found.append((first, last))
        return found


def _runs(true: np.ndarray) -> list[tuple[int, int]]:
    """First and behind the last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def everyday(cells: np.ndarray, seconds: float, rng, most: float, hard: bool = True) -> Scene:
    """Touches of all kinds with pauses between, after IDLE seconds without any.

    Args:
        cells: (rows, cols) bool, which crossings carry a cell.
        most: N on a cell that nothing but a hard edge exceeds: the curve's end.
        hard: whether there are hard edges, which do.
    """
    return _played(cells, seconds, rng, most, [k for k in _KINDS if hard or k != "hard edge"])


def long_pushes(cells: np.ndarray, seconds: float, rng, most: float) -> Scene:
    """Pushes of 2.5 to 4.5 s each, one a second later than the last."""
    return _played(cells, seconds, rng, most, ["push"], (2.5, 4.5), (0.8, 1.2))


def _played(cells, seconds, rng, most, kinds, held=(0.3, 1.5), pause=(0.3, 1.0)) -> Scene:
    n = round(seconds * KNOTS)
    force = np.zeros((n, *cells.shape))
    touches: list[Touch] = []
    at = round(IDLE * KNOTS)
    shares = np.array([_KINDS[kind] for kind in kinds])
    while True:
        kind = kinds[rng.choice(len(kinds), p=shares / shares.sum())]
        rise = rng.uniform(0.05, 0.3)
        hold = rng.uniform(*held)
        fall = rng.uniform(0.05, 0.3)
        part = _touch(kind, cells, (rise, hold, fall), most, rng)
        if at + len(part) + 10 > n:
            return Scene(force, touches)
        force[at : at + len(part)] += part
        touches.append(Touch(kind, at / KNOTS, (at + len(part)) / KNOTS))
        wait = rng.uniform(*pause) if rng.random() < 0.8 else rng.uniform(2.3, 3.0)  # a new tare
        at += len(part) + round(wait * KNOTS)


def _touch(kind: str, cells, times, most: float, rng) -> np.ndarray:
    """(n, rows, cols) [N] of one touch that rises, stays and falls for `times` [s]."""
    up, stay, down = (max(2, round(s * KNOTS)) for s in times)
    level = np.concatenate(
        [
            0.5 - 0.5 * np.cos(np.pi * np.arange(1, up + 1) / up),
            np.ones(stay),
            0.5 + 0.5 * np.cos(np.pi * np.arange(1, down + 1) / down),
        ]
    )
    tremor = gaussian_filter1d(rng.standard_normal(len(level)), 4.0)
    level = level * (1.0 + _TREMOR * tremor / max(tremor.std(), 1e-9))
    texture = np.exp(_TEXTURE * rng.standard_normal(cells.shape)) * cells
    if kind == "stroke":
        return level[:, None, None] * _strokes(texture, len(level), rng)
    force = level[:, None, None] * _pressed(kind, texture, rng)
    return force if kind == "hard edge" else np.minimum(force, most)


def _blob(shape, centre, width) -> np.ndarray:
    y, x = np.indices(shape)
    distance2 = (y - centre[0]) ** 2 + (x - centre[1]) ** 2
    return np.exp(-distance2 / (2.0 * width**2)) * (distance2 < (3.0 * width) ** 2)


def _place(shape, rng):
    """Anywhere on the skin, off the grid."""
    return [rng.uniform(0.0, n - 1.0) for n in shape]


def _loaded(picture, newtons: float) -> np.ndarray:
    """Return the picture scaled to a load."""
    total = picture.sum()
    return picture * (newtons / total) if total > 0.1 else 0.0 * picture  # beside a mask's cells


def _pressed(kind: str, texture, rng) -> np.ndarray:
    shape = texture.shape
    if kind in ("finger", "two fingers"):
        fingers = [
            _loaded(_blob(shape, _place(shape, rng), rng.uniform(0.6, 1.1)) * texture, newtons)
            for newtons in rng.uniform(1.0, 12.0, 1 if kind == "finger" else 2)
        ]
        return np.sum(fingers, 0)
    if kind == "palm":
        picture = _blob(shape, _place(shape, rng), rng.uniform(2.5, 5.0)) * texture
        return _loaded(picture, rng.uniform(5.0, 40.0))
    if kind == "push":
        picture = _blob(shape, _place(shape, rng), rng.uniform(1.2, 2.5)) * texture
        return _loaded(picture, rng.uniform(PUSH, 80.0))
    # an edge: a line of cells at any angle; a hard one is a few cells long
    angle, (y0, x0) = rng.uniform(0.0, np.pi), _place(shape, rng)
    y, x = np.indices(shape)
    across = (y - y0) * np.cos(angle) - (x - x0) * np.sin(angle)
    along = (y - y0) * np.sin(angle) + (x - x0) * np.cos(angle)
    long = rng.uniform(1.5, 4.0) if kind == "edge" else 0.8
    picture = np.exp(-0.5 * (across / 0.5) ** 2) * (np.abs(along) < long) * texture
    if kind == "edge":
        return _loaded(picture, rng.uniform(4.0, 25.0))
    top = picture.max()
    return picture * (rng.uniform(*_HARD) / top) if top > 0.1 else picture


def _strokes(texture, n: int, rng) -> np.ndarray:
    """(n, rows, cols): a finger drawn from one place to another."""
    shape = texture.shape
    start, end = np.array(_place(shape, rng)), np.array(_place(shape, rng))
    width, newtons = rng.uniform(0.7, 1.1), rng.uniform(2.0, 8.0)
    way = np.linspace(0.0, 1.0, n)[:, None] * (end - start) + start
    return np.array([_loaded(_blob(shape, place, width) * texture, newtons) for place in way])
