# SPDX-License-Identifier: Apache-2.0
"""Forces that a scale or a force sensor recorded beside a skin."""

from __future__ import annotations

import numpy as np

from ..errors import FileError
from ..files import read_bytes, shorten
from .lines import sort_lines

_LARGEST_REFERENCE = 1 << 26  # bytes


def read_reference(path: str) -> tuple[np.ndarray, np.ndarray]:
    """(m,) times [s] and (m,) forces [N] of a scale or sensor: a CSV of two columns.

    Raises:
        FileError: a line but the first that is not two numbers, times that do not rise.
        OSError: the file cannot be read.
    """
    lines = read_bytes(path, _LARGEST_REFERENCE).decode("utf-8-sig", "replace").splitlines()
    numeric, texts = sort_lines(lines)
    values: list[np.ndarray] = []
    for line in sorted([*numeric, *texts], key=lambda line: line.number):
        where = f"{path}: line {line.number}, {shorten(lines[line.number - 1])}"
        if len(line.numbers) != 2 or np.isnan(line.numbers).any():
            if line.number == 1:
                continue
            raise FileError(f"{where}: must be time,force")
        if values and line.numbers[0] <= values[-1][0]:
            raise FileError(f"{where}: times must rise [s]")
        values.append(line.numbers)
    if len(values) < 2:
        raise FileError(f"{path}: no lines of time [s],force [N]")
    times, force = np.array(values).T
    return times, force
