# SPDX-License-Identifier: Apache-2.0
"""Methods side by side over one recording, as a table."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..middleware.threads import one_thread
from ..physics.curve import GRAM
from .results import STATUS, Job, Results

_WIDTH = 100  # characters of a line
_TOUCHED = 0.2  # N on a cell from which on a reading counts as touched: gesture_feature's own


@dataclass
class Compared:
    """Of m methods over n readings; differences are to the first method."""

    methods: list[str]
    results: list[Results]  # of each method
    cell: np.ndarray  # (m, n) mean absolute difference of a cell [N]


def compare(
    job: Job, methods: list[str], track: Callable[[Iterable], Iterable] = lambda steps: steps
) -> Compared:
    """Replay a recording with each of the methods, reading by reading.

    Raises:
        ValueError: fewer than two methods, or as `collect`.
    """
    if len(methods) < 2:
        raise ValueError(f"methods {', '.join(methods)}: give two or more")
    kept: list[list] = [[] for _ in methods]
    cell: list[np.ndarray] = []
    with one_thread():
        replays = [replace(job, method=method).replay() for method in methods]
        for steps in track(zip(*replays, strict=True)):
            force = np.array([step.force for step in steps])
            cell.append(np.abs(force - force[0]).mean((1, 2)))
            for step, into in zip(steps, kept, strict=True):
                into.append(step.without_picture())
    if not cell:
        raise ValueError(f"{job.path}: holds no reading")
    found = [Results.of(k, r.notes) for k, r in zip(kept, replays, strict=True)]
    return Compared(list(methods), found, np.array(cell).T)


def table(compared: Compared) -> str:
    """Return what is compared, and a line for each method."""
    first, reference = compared.results[0], compared.methods[0]
    touched = first.peak > _TOUCHED
    head = (
        "method",
        *STATUS,
        "stops",
        "time stopped",
        "total while touched",
        f"a cell from {reference}",
        "solved in, p50",
        "p99",
    )
    lines: list[tuple[str, ...]] = [head]
    for name, found, cell in zip(compared.methods, compared.results, compared.cell, strict=True):
        counts = [str(int(np.sum(found.status == k))) for k in range(len(STATUS))]
        stopped = f"{100 * np.mean(found.stops != ''):.1f} %"
        total = f"{np.nanmean(found.total[touched]):.1f} N" if touched.any() else "-"
        apart = f"{np.nanmean(cell[touched]) / GRAM:.1f} g" if touched.any() else "-"
        p50, p99 = (f"{1e3 * v:.2f} ms" for v in np.percentile(found.seconds, (50, 99)))
        begun = str(len(found.stop_begins))
        lines.append((name, *counts, begun, stopped, total, apart, p50, p99))
    about = (
        f"{len(first.stamps)} readings of {first.times[-1]:.1f} s, all by each method. Force and "
        f"differences are means; a cell from {reference}: how far each cell is from the same "
        f"cell by {reference}; touched: by {reference} a cell has more than {_TOUCHED:g} N."
    )
    return "\n".join([*textwrap.wrap(about, _WIDTH), "", *_aligned(lines)])


def _aligned(lines: list[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            word.rjust(width) if k else word.ljust(width)
            for k, (word, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
