# SPDX-License-Identifier: Apache-2.0
"""What a replay gave, in arrays; a long one, or many, in several processes."""

from __future__ import annotations

import functools
import itertools
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..extras import each
from ..middleware.threads import one_thread
from ..physics.curve import GRAM
from ..recording import Recording
from ..recording.reader import EVER
from .replay import Replay, Step

_WIDTH = 100  # characters of a line
_TOUCHED = 0.2  # N on a cell from which on a reading counts as touched: gesture_feature's own
STATUS = ("ok", "suspect", "failed")
LEAD = 10.0  # s that a part begins before it counts: the rest is measured, the stop settles
PART = 300.0  # s of one, where several processes share a recording


@dataclass
class Results:
    """Of n readings."""

    stamps: np.ndarray  # (n,) int64 [ns since 1970]
    # total, peak: (n,) force of all cells, and of the most loaded one [N]; NaN: it failed
    total: np.ndarray
    peak: np.ndarray
    status: np.ndarray  # (n,) index in STATUS
    stops: np.ndarray  # (n,) reasons; empty while the robot is free
    seconds: np.ndarray  # (n,) that compensation, features and stop took
    notes: list[str]  # what was left out of the recording, in words

    @classmethod
    def of(cls, steps: list[Step], notes: list[str]) -> Results:
        return cls(
            np.array([s.stamp for s in steps], np.int64),
            np.array([s.total for s in steps]),
            np.array([s.peak for s in steps]),
            np.array([STATUS.index(s.status) for s in steps], int),
            np.array([s.stop for s in steps], object),
            np.array([s.seconds for s in steps]),
            notes,
        )

    @property
    def times(self) -> np.ndarray:
        """(n,) seconds since the first reading."""
        return (self.stamps - self.stamps[0]) * 1e-9

    @property
    def stop_begins(self) -> np.ndarray:
        """Indices of the readings with which a stop began."""
        stopped = self.stops != ""
        return np.flatnonzero(stopped[1:] & ~stopped[:-1]) + 1


@dataclass(frozen=True)
class Job:
    """What to replay: arguments of Recording and Replay; `out`: recording to make of it."""

    path: str
    namespace: str = ""
    method: str = ""
    config: str = ""
    out: str = ""

    def replay(self, begin: int = 0, end: int = EVER) -> Replay:
        source = Recording(self.path, self.namespace)
        replay = Replay(source, self.method, self.config or None, begin=begin, end=end)
        if self.out:
            replay.record(self.out)
        return replay


def collect(
    job: Job, jobs: int = 1, track: Callable[[Iterable, int], Iterable] | None = None
) -> Results:
    """Replay a recording as fast as possible.

    Args:
        jobs: processes. Several take parts of five minutes, each begun 10 s early, anew: near the
            results of one, which are the robot's, but not the same to the bit.
        track: of an iterable and its length, shows how far it is.

    Raises:
        ValueError: as Recording and Replay, or there is no reading.
    """
    track = track or (lambda items, total: items)
    source = Recording(job.path, job.namespace)
    first, last = source.span
    if jobs == 1:
        n = source.topics[source.adc_topic].count
        parts = [_part(job, (0, EVER), lambda steps: track(steps, n))]
    else:
        n = max(jobs, round((last - first) * 1e-9 / PART))
        edges = [first + (last + 1 - first) * k // n for k in range(n + 1)]
        part = functools.partial(_part, job)
        parts = list(each(part, track(itertools.pairwise(edges), n), jobs))
    steps = [step for part, _ in parts for step in part]
    if not steps:
        raise ValueError(f"{job.path}: holds no reading")
    return Results.of(steps, list(dict.fromkeys(note for _, notes in parts for note in notes)))


def _part(
    job: Job, edges: tuple[int, int], track=lambda steps: steps
) -> tuple[list[Step], list[str]]:
    """Return the steps of what was recorded between two times [ns since 1970], and notes."""
    begin, end = edges
    with one_thread():
        replay = job.replay(max(0, begin - round(LEAD * 1e9)), end)
        kept = [step.without_picture() for step in track(replay) if step.stamp >= begin]
    return kept, replay.notes


# --- methods side by side ---


@dataclass
class Compared:
    """Of m methods over n readings; differences are to the first method."""

    methods: list[str]
    results: list[Results]  # of each method
    cell: np.ndarray  # (m, n) mean absolute difference of a cell [N]


def compare(
    job: Job, methods: list[str], track: Callable[[Iterable], Iterable] = lambda steps: steps
) -> Compared:
    """Replay a recording with each of two methods or more (else ValueError), reading by reading."""
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
        *("method", *STATUS, "stops", "time stopped", "total while touched"),
        *(f"a cell from {reference}", "solved in, p50", "p99"),
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
