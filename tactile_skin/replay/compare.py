"""Methods side by side over one recording: a table, and a picture."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..middleware.threads import one_thread
from ..physics.curve import GRAM
from .results import STATUS, Job, Results

_TOUCHED = 0.2  # N on a cell from which on a reading counts as touched: gesture_feature's own


@dataclass
class Compared:
    """Of m methods over n readings; differences are to the first method.

    Attributes:
        results: of each method.
        cell: (m, n) mean absolute difference of a cell [N].
        worst: index of the reading in which two methods differ most.
        pictures: (m, rows, cols) of that reading [N].
    """

    methods: list[str]
    results: list[Results]
    cell: np.ndarray
    worst: int
    pictures: np.ndarray


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
    worst, most, pictures = 0, -1.0, None
    with one_thread():
        begun = time.process_time()
        replays = [replace(job, method=method).replay() for method in methods]
        for k, steps in enumerate(track(zip(*replays, strict=True))):
            force = np.array([step.force for step in steps])
            cell.append(np.abs(force - force[0]).mean((1, 2)))
            largest = float(np.nan_to_num(cell[-1]).max())
            if largest > most:
                worst, most, pictures = k, largest, force
            for step, into in zip(steps, kept, strict=True):
                step.force = None
                into.append(step)
        cpu = time.process_time() - begun
    if pictures is None:
        raise ValueError(f"{job.path}: holds no reading")
    found = [Results.of(k, cpu, r.notes) for k, r in zip(kept, replays, strict=True)]
    return Compared(list(methods), found, np.array(cell).T, worst, pictures)


def table(compared: Compared) -> str:
    """A line for each method."""
    first = compared.results[0]
    touched = first.peak > _TOUCHED
    head = (
        "method",
        *STATUS,
        "stops",
        "stopped",
        "force while touched",
        "cell, from the first",
        "p50",
        "p99",
    )
    lines = [head]
    for name, found, cell in zip(compared.methods, compared.results, compared.cell, strict=True):
        counts = [str(int(np.sum(found.status == k))) for k in range(len(STATUS))]
        stopped = f"{100 * np.mean(found.stops != ''):.1f} %"
        total = f"{np.nanmean(found.total[touched]):.1f} N" if touched.any() else "-"
        apart = f"{np.nanmean(cell[touched]) / GRAM:.1f} g" if touched.any() else "-"
        p50, p99 = (f"{1e3 * v:.2f} ms" for v in np.percentile(found.seconds, (50, 99)))
        begun = str(len(found.stop_begins))
        lines.append((name, *counts, begun, stopped, total, apart, p50, p99))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            word.rjust(width) if k else word.ljust(width)
            for k, (word, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def draw(compared: Compared):
    """Total force over time, and the reading in which the methods differ most."""
    from matplotlib import pyplot as plt

    first, m = compared.results[0], len(compared.methods)
    figure, axes = plt.subplot_mosaic(
        [["time"] * m, list(range(m))], figsize=(max(8.0, 3.2 * m), 6.4), layout="constrained"
    )
    for name, found in zip(compared.methods, compared.results, strict=True):
        axes["time"].plot(found.times, found.total, label=name, linewidth=1.0)
    for low, found in enumerate(compared.results):
        axes["time"].fill_between(
            found.times,
            low / m * 0.06,
            (low + 1) / m * 0.06,
            where=found.stops != "",
            transform=axes["time"].get_xaxis_transform(),
            color=f"C{low}",
            linewidth=0.0,
        )
    axes["time"].axvline(first.times[compared.worst], color="0.5", linewidth=0.8)
    axes["time"].set_xlabel("time [s]; bars: stopped; line: the pictures below")
    axes["time"].set_ylabel("force [N]")
    axes["time"].grid(alpha=0.25)
    axes["time"].legend(frameon=False)
    top = float(np.nanmax(compared.pictures)) or 1.0
    for k, name in enumerate(compared.methods):
        shown = axes[k].imshow(compared.pictures[k], vmin=0.0, vmax=top, cmap="viridis")
        apart = compared.cell[k, compared.worst] / GRAM
        axes[k].set_title(name if k == 0 else f"{name}: {apart:.1f} g a cell apart", fontsize=10)
    figure.colorbar(shown, ax=[axes[k] for k in range(m)], label="force on a cell [N]")
    return figure
