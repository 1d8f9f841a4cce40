# SPDX-License-Identifier: Apache-2.0
"""Reads touches of real hands that others recorded, as takes in newtons.

The recordings (github.com/yliess86/SocialTouch) are of a capacitive mat of 19 x 24 cells, 12 frames
a second. Their licence does not let them be shipped: name the file, with `frames` (all, 19, 24)
uint8, `n` (recordings,) frames of each, `label` 0..31 and `person`. A capacitive reading is no
force: each recording gets one of its own, log-normal.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactile_skin.touch.take import Take

PITCH = 0.014  # m, of the recorded cells
COARSE = 0.021  # m, of the mat of 16 x 16 that it is put on
PERIOD = 1.0 / 12.0  # s between frames
_FLOOR, _SPAN = 25.0, 230.0  # counts of an untouched cell, and above it to full scale
_EXPONENT = 1.5  # of force by reading, chosen
_FULL = 0.6  # N on a cell at full scale, median of the recordings; chosen: a palm is 31 N
_FULL_STD = 0.5  # of its logarithm
_SCALE = PITCH / COARSE

# What a robot's maker would call the 32 recorded gestures.
TWELVE = {
    "hold": (0, 1),
    "finger": (2, 3, 4, 5),
    "poke": (6, 7),
    "pat": (8, 9),
    "pinch": (10, 11),
    "palm tap": (12, 13, 29),
    "slap": (14, 15),
    "hit": (16, 17),
    "stroke": (18, 19, 20, 21, 30),
    "tickle": (22, 23, 24),
    "hug": (25, 26, 31),
    "finger stroke": (27, 28),
}
SIX = ("hold", "poke", "pat", "slap", "stroke", "tickle")  # distinct ones
GROUP = {label: name for name, labels in TWELVE.items() for label in labels}


def recorded(path: Path, coarse: bool = True, seed: int = 0) -> list[Take]:
    """Return the takes of a file of recordings; their labels are the numbers of the 32 gestures.

    Args:
        coarse: put on 16 x 16 cells of 21 mm, at a random row; else 19 x 24 of 14 mm.
        seed: of forces and places.
    """
    with np.load(path) as data:
        frames, count = data["frames"], data["n"]
        label, person = data["label"], data["person"]
    rng = np.random.default_rng([seed, 1])
    full = _FULL * np.exp(_FULL_STD * rng.standard_normal(len(count)))
    takes = []
    parts = np.split(frames, np.cumsum(count)[:-1])
    for picture, most, name, who in zip(parts, full, label, person, strict=True):
        share = np.maximum(picture.astype(float) - _FLOOR, 0.0) / _SPAN
        force = most * share**_EXPONENT
        if coarse:
            force = _on_coarse(force, rng.uniform(0.0, 16.0 - 19.0 * _SCALE))
        pitch = COARSE if coarse else PITCH
        takes.append(Take(str(name), f"person {who}", force, PERIOD, pitch))
    return takes


def _on_coarse(force: np.ndarray, first_row: float) -> np.ndarray:
    """Return (T, 16, 16) of (T, 19, 24): each cell's force is parted by area."""
    return np.einsum("ri,tij,cj->trc", _parts(19, first_row), force, _parts(24, 0.0), optimize=True)


def _parts(cells: int, first: float) -> np.ndarray:
    """Return (16, cells): the share of each fine cell that lies on each coarse one."""
    edge = np.arange(17.0)[:, None]
    start = first + np.arange(cells) * _SCALE
    overlap = np.minimum(edge[1:], start + _SCALE) - np.maximum(edge[:-1], start)
    return np.maximum(overlap, 0.0) / _SCALE
