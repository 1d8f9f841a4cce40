"""Forces that a scale or a force sensor recorded beside a skin."""

from __future__ import annotations

import numpy as np

from ..errors import FileError
from ..files import read_bytes, shorten

_LARGEST_REFERENCE = 1 << 26  # bytes


def read_reference(path: str) -> tuple[np.ndarray, np.ndarray]:
    """(m,) times [s] and (m,) forces [N] of a scale or sensor: a CSV of two columns.

    Raises:
        FileError: a line but the first that is not two numbers, times that do not rise.
        OSError: the file cannot be read.
    """
    lines = read_bytes(path, _LARGEST_REFERENCE).decode("utf-8", "replace").splitlines()
    values: list[tuple[float, float]] = []
    for number, line in enumerate(lines, 1):
        words = line.replace(";", ",").split(",")
        try:
            t, force = (float(word) for word in words)
        except ValueError:
            if number == 1 or not line.strip():
                continue
            raise FileError(f"{path}: line {number}, {shorten(line)}: must be time,force") from None
        if not np.isfinite([t, force]).all() or (values and t <= values[-1][0]):
            raise FileError(f"{path}: line {number}, {shorten(line)}: times must rise [s]")
        values.append((t, force))
    if len(values) < 2:
        raise FileError(f"{path}: no lines of time [s],force [N]")
    times, force = np.array(values).T
    return times, force
