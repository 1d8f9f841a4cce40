# SPDX-License-Identifier: Apache-2.0
"""Untouched boards with noisy cells, and boards that are touched while they should rest."""

from __future__ import annotations

import numpy as np

from support.lab.unknown import Unknown
from tactile_skin.simulation import scenes

NOISY = "scatters", "jumps", "drops to 0", "loses contact"
TOUCHED = "comes", "goes", "part of the time", "taps", "drifts"


def switching(n: int, rng, least: int = 1) -> np.ndarray:
    """(n,) bool, on and off at random, for `least` frames or more; both occur."""
    while True:
        dwell = least + rng.geometric(1.0 / rng.uniform(1.0, 10.0), n) - 1
        on = np.repeat(np.arange(n) % 2 == rng.integers(2), dwell)[:n]
        if 0 < on.sum() < n:
            return on


def noisy_cells(board: Unknown, kind: str, rng) -> tuple:
    """Cells that are noisy, and what makes (n, rows, cols) readings those of a board with them."""
    shape = board.supposed.shape
    count = rng.integers(1, 4)
    cells = [tuple(np.unravel_index(k, shape))
             for k in rng.choice(np.prod(shape), count, replace=False)]  # fmt: skip
    sigmas = {cell: rng.uniform(5.0, 40.0) for cell in cells}
    jumps = {cell: rng.choice([-1, 1]) * rng.uniform(20.0, 200.0) for cell in cells}

    def spoil(frames: np.ndarray) -> np.ndarray:
        frames, full, n = frames.copy(), board.supposed.full_scale, len(frames)
        for cell in cells:
            own = frames[(slice(None), *cell)]
            if kind == "scatters":
                own = own + sigmas[cell] * rng.standard_normal(n) / full
            elif kind == "jumps":
                own = own + jumps[cell] * switching(n, rng) / full
            else:
                own = np.where(switching(n, rng), 0.0, own)
            frames[(slice(None), *cell)] = np.clip(own, 0.0, 1.0)
        return frames

    return cells, spoil


def resting(board: Unknown, n: int, factor, rng) -> np.ndarray:
    """(n, rows, cols) readings of the untouched board whose cells conduct (n, rows, cols) times
    what they do at rest."""
    shape = board.supposed.shape
    if np.ndim(factor) == 0:
        pictures = [board.expose(np.zeros(shape))] * n
    else:
        pictures = [board.expose(np.zeros(shape), f) for f in factor]
    return np.array([board.converter.frame(p, rng) for p in pictures])


def noisy(board: Unknown, kind: str, n: int, rng) -> tuple[list, np.ndarray]:
    if kind != "loses contact":
        cells, spoil = noisy_cells(board, kind, rng)
        return cells, spoil(resting(board, n, 1.0, rng))
    shape = board.supposed.shape
    cell = tuple(int(rng.integers(k)) for k in shape)
    factor = np.ones((n, *shape))
    factor[(switching(n, rng), *cell)] = 1e-3
    return [cell], resting(board, n, factor, rng)


def touched(board: Unknown, kind: str, n: int, rng) -> np.ndarray:
    shape = board.supposed.shape
    if kind == "drifts":
        drift = rng.choice([-1, 1]) * rng.uniform(0.1, 0.3) * np.linspace(0.0, 1.0, n)
        return resting(board, n, np.ones(shape) * (1.0 + drift)[:, None, None], rng)
    at = rng.uniform(0.0, shape[0] - 1), rng.uniform(0.0, shape[1] - 1)
    newtons, width = np.exp(rng.uniform(np.log(0.3), np.log(3.0))), rng.uniform(0.4, 1.2)
    finger = scenes.finger(*shape, *at, newtons, width)
    change = rng.integers(2, n - 1)
    on = np.zeros(n, bool)
    if kind == "comes":
        on[change:] = True
    elif kind == "goes":
        on[:change] = True
    elif kind == "taps":
        on = switching(n, rng, least=2)
    else:
        first = rng.integers(1, n - 2)
        on[first : rng.integers(first + 1, n)] = True
    ratio = board.expose(np.zeros(shape)), board.expose(finger)
    return np.array([board.converter.frame(ratio[int(yes)], rng) for yes in on])
