# SPDX-License-Identifier: Apache-2.0
"""A take: one performance of one gesture, as pictures in newtons, in a file of plain numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import FileError
from . import stored

SUFFIX = ".take.npz"
VERSION = 1  # of the file
PAUSE = 1.0  # s without a touch, which parts two takes


class Take(NamedTuple):
    """One performance of one gesture."""

    label: str  # name of the gesture
    person: str  # who made it
    pictures: np.ndarray  # (T, rows, cols) force on touched cells [N], 0 elsewhere
    period: float  # between pictures [s]
    pitch: float  # distance between neighbouring cells [m]

    def save(self, path: str | Path) -> None:
        """Write the take to an .npz file."""
        head = {"version": VERSION, "label": self.label, "person": self.person}
        head |= {"period": self.period, "pitch": self.pitch}
        stored.save(path, head, {"pictures": self.pictures.astype(np.float32)})


def load_take(path: str | Path) -> Take:
    """Read a take (FileError: the file is absent, too large, or no take)."""
    with stored.load(path, "take") as (head, arrays):
        pictures = np.asarray(arrays["pictures"], float)
        period, pitch = float(head["period"]), float(head["pitch"])
        if head["version"] != VERSION:
            raise ValueError(f"version {head['version']}: must be {VERSION}")
        if pictures.ndim != 3 or not (np.isfinite(pictures).all() and (pictures >= 0.0).all()):
            raise ValueError("pictures must be (T, rows, cols), finite and 0 or more")
        if not (period > 0.0 and pitch > 0.0):
            raise ValueError("period and pitch must be above 0")
        return Take(str(head["label"]), str(head["person"]), pictures, period, pitch)


def find_takes(paths: Iterable[str | Path]) -> Iterator[Path]:
    """Yield the files of takes that are named, and those in the folders that are.

    Raises:
        FileError: a path to nothing, or a folder without takes.
    """
    for path in map(Path, paths):
        if path.is_dir():
            found = sorted(path.rglob(f"*{SUFFIX}"))
            if not found:
                raise FileError(f"{path}: holds no take (*{SUFFIX})")
            yield from found
        elif path.exists():
            yield path
        else:
            raise FileError(f"{path}: does not exist")


def touches(pictures: np.ndarray, period: float) -> list[np.ndarray]:
    """Cut pictures (T, rows, cols), one every period [s], where nothing touches for a while."""
    on = np.flatnonzero(pictures.any((1, 2)))
    if len(on) == 0:
        return []
    ends = (np.diff(on) * period > PAUSE).nonzero()[0]
    starts, stops = np.r_[0, ends + 1], np.r_[ends, len(on) - 1]
    return [pictures[on[a] : on[b] + 1] for a, b in zip(starts, stops, strict=True)]
