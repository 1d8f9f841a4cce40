# SPDX-License-Identifier: Apache-2.0
"""Touches that no solver's model was made for: bodies off the grid, and real pressure pictures.

Both are drawn on a grid finer than the cells and averaged over each cell: no edge lies on a cell's
border but by chance.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import as_file, files

import numpy as np

_FINE = 8  # points a cell and side, of which the pressure is the mean
_LOAD = 30.0, 1000.0  # g a cell, lightest and heaviest body
_MOST_BODIES = 4
_HALF = 1.0, 4.5  # cells, half of a side, as the paper's rectangles (scenes.py)
_HOLLOW = 0.6  # inner radius of a ring over its outer one
_TEXTURE = 0.25  # relative RMS of the pressure's texture
_GRAIN = 6.0  # fine points, its blur
_NOISE = 0.05  # relative, of each cell
_PIXELS = 0.5, 4.0  # of a recorded picture that a cell spans, log-uniform: a hip to a whole body
_TOUCHED = 0.05  # share of the cells that a crop of a picture must load


def bodies(n: int, rows: int, cols: int, rng: np.random.Generator, half=_HALF) -> np.ndarray:
    """Draw (n, rows, cols) load [g] of one to four bodies each.

    Ellipses with Hertz's pressure, flat boxes, rings and kites with half sides of `half` [cells],
    placed and turned at random, with a smooth texture of 25 % and 5 % of noise a cell.
    """
    y, x = (np.mgrid[0 : rows * _FINE, 0 : cols * _FINE] + 0.5) / _FINE - 0.5
    longest = max(half[1] * min(1.0, min(rows, cols) / 12), 1.0)
    scenes = [_scene(y, x, (half[0], longest), rng) for _ in range(n)]
    return np.array(scenes).reshape(n, rows, cols)


def _scene(y: np.ndarray, x: np.ndarray, half, rng) -> np.ndarray:
    load = np.zeros(y.shape)
    for _ in range(rng.integers(1, _MOST_BODIES + 1)):
        cy, cx = rng.uniform(0.0, y[-1, 0]), rng.uniform(0.0, x[0, -1])
        turn = rng.uniform(0.0, np.pi)
        side = rng.uniform(*half, 2)
        u = ((y - cy) * np.cos(turn) + (x - cx) * np.sin(turn)) / side[0]
        v = ((x - cx) * np.cos(turn) - (y - cy) * np.sin(turn)) / side[1]
        r2 = u**2 + v**2
        kind = rng.integers(4)
        if kind == 0:
            shape = np.sqrt(np.maximum(1.0 - r2, 0.0))  # Hertz
        elif kind == 1:
            shape = np.maximum(abs(u), abs(v)) < 1.0
        elif kind == 2:
            shape = (r2 < 1.0) & (r2 > _HOLLOW**2)
        else:  # a kite: one end twice as long as the other
            shape = abs(u) + np.where(v > 0.0, v / 1.3, -v / 0.65) < 1.0
        load += shape * _texture(y.shape, rng) * rng.uniform(*_LOAD)
    return _cells(load, rng)


def _texture(shape, rng) -> np.ndarray:
    from scipy.ndimage import gaussian_filter  # here: most simulated boards feel no bodies

    grain = gaussian_filter(rng.standard_normal(shape), _GRAIN)
    return np.maximum(1.0 + _TEXTURE * grain / grain.std(), 0.1)


def _cells(load: np.ndarray, rng) -> np.ndarray:
    """Return the mean over each cell of a finer picture, with noise."""
    rows, cols = (size // _FINE for size in load.shape)
    cells = load.reshape(rows, _FINE, cols, _FINE).mean((1, 3))
    return np.maximum(cells * (1.0 + _NOISE * rng.standard_normal(cells.shape)), 0.0)


def pictures(n: int, rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Draw (n, rows, cols) load [g] of recorded pressure pictures.

    Each is scaled, turned and cropped to the skin; its heaviest cell bears 30 to 1000 g.
    """
    from scipy.ndimage import map_coordinates

    recorded = _recorded()
    y, x = (np.mgrid[0 : rows * _FINE, 0 : cols * _FINE] + 0.5) / _FINE
    y, x = y - rows / 2, x - cols / 2  # cells, from the skin's middle
    found = np.empty((n, rows, cols))
    for k in range(n):
        while True:
            picture = recorded[rng.integers(len(recorded))]
            middle = rng.choice(np.argwhere(picture > 0.0))
            turn = rng.uniform(0.0, 2.0 * np.pi)
            pixels = np.exp(rng.uniform(*np.log(_PIXELS)))
            py = middle[0] + pixels * (y * np.cos(turn) + x * np.sin(turn))
            px = middle[1] + pixels * (x * np.cos(turn) - y * np.sin(turn))
            cells = _cells(map_coordinates(picture, (py, px), order=1), rng)
            if np.count_nonzero(cells) >= _TOUCHED * cells.size:
                break
        found[k] = cells * (rng.uniform(*_LOAD) / cells.max())
    return found


@lru_cache(maxsize=1)
def _recorded() -> np.ndarray:
    """(60, 64, 27) pressure pictures in the recording mat's own unit."""
    with as_file(files(__package__) / "pictures" / "lying.npz") as path, np.load(path) as data:
        return data["frames"].astype(float)
