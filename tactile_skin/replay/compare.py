"""Methods side by side over one recording: a table, and a picture."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..middleware.threads import one_thread
from ..physics.curve import GRAM
from .results import STATUS, Job, Results

_WIDTH = 100  # characters of a line
_BARS = 0.07  # height of the bars, share of the picture's
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
                into.append(step.without_picture())
        cpu = time.process_time() - begun
    if pictures is None:
        raise ValueError(f"{job.path}: holds no reading")
    found = [Results.of(k, cpu, r.notes) for k, r in zip(kept, replays, strict=True)]
    return Compared(list(methods), found, np.array(cell).T, worst, pictures)


def table(compared: Compared) -> str:
    """What is compared, and a line for each method."""
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


def draw(compared: Compared):
    """Total force over time, and the reading in which the methods differ most."""
    from matplotlib import pyplot as plt

    first, m = compared.results[0], len(compared.methods)
    figure, axes = plt.subplot_mosaic(
        [["time"] * m, list(range(m))], figsize=(max(8.0, 3.2 * m), 6.4), layout="constrained"
    )
    for name, found in zip(compared.methods, compared.results, strict=True):
        axes["time"].plot(found.times, found.total, label=name, linewidth=1.0)
    axes["time"].set_ylim(bottom=-_BARS * axes["time"].get_ylim()[1])
    for low, found in enumerate(compared.results):
        axes["time"].fill_between(
            found.times,
            low / m * 0.8 * _BARS,
            (low + 1) / m * 0.8 * _BARS,
            where=found.stops != "",
            transform=axes["time"].get_xaxis_transform(),
            color=f"C{low}",
            linewidth=0.0,
        )
    axes["time"].axvline(first.times[compared.worst], color="0.5", linewidth=0.8)
    axes["time"].set_title("The same readings, by each method")
    axes["time"].set_xlabel(
        "time [s]  (bars: the robot would be stopped; line: the reading below, "
        "in which the methods differ most)"
    )
    axes["time"].set_ylabel("force of all cells [N]")
    axes["time"].grid(alpha=0.25)
    axes["time"].legend(frameon=False)
    top = float(np.nanmax(compared.pictures)) or 1.0
    for k, name in enumerate(compared.methods):
        shown = axes[k].imshow(compared.pictures[k], vmin=0.0, vmax=top, cmap="viridis")
        apart = compared.cell[k, compared.worst] / GRAM
        title = f"{name}, {first.times[compared.worst]:.2f} s"
        if k:
            title = f"{name}: {apart:.1f} g a cell from {compared.methods[0]}"
        axes[k].set_title(title, fontsize=10)
        axes[k].set_xlabel("column")
    axes[0].set_ylabel("row")
    figure.colorbar(shown, ax=[axes[k] for k in range(m)], label="force on a cell [N]")
    return figure
