"""Lines that read alike, and lines in the wrong order: what the touches in a recording tell.

A touch covers neighbouring cells. Read in the right order its picture rises once and falls once;
with two lines swapped it varies more from line to line. Each touch has one vote, of the size by
which another order would be smoother than this one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .recorded import Recorded

# RMS by which two lines that read alike differ at rest: times the noise of a mean, and ADC steps.
_EQUAL, _ROUNDING = 4.0, 0.15
_DIRECTLY = 0.25  # share of the most raised line's rise: less comes through the others
_TOUCHED = 8.0  # times the noise by which a touch raises a line
# Touches that it takes: where the rest shows that the two are one, and where it is too noisy for
# that, as of a short recording: a palm raises two lines alike. Share of the usual pair's
# difference at rest that shows it.
_TOUCHES, _ONE = (3, 8), 0.3
# Largest difference under a touch, as share of what it raises (lines are read in turn), and times
# the noise; share of the touches in which it is below that.
_ALIKE, _APART, _ALWAYS = 0.03, 5.0, 0.8
_FEWEST = 5  # touches that speak for another order, or against it
_SPEAKS = 0.02  # share of a touch's variation by which one does
_MAJORITY = 0.5  # of the votes' sum over the sum of their sizes
_GAIN = 0.06  # share of all variation that the other order saves at least
_LIGHT = 0.03  # share of the picture's largest value below which a cell counts as untouched


def equal_lines(seen: Recorded, skip) -> list[tuple[int, int, int]]:
    """(axis, line, line) pairs whose readings are equal, at rest and under every touch."""
    found = []
    for axis in (0, 1):
        base = seen.turned(axis, seen.base)
        raised = seen.turned(axis, seen.steps[seen.touches]) - base
        touch = raised.max(2)  # (touches, lines)
        level = np.median(raised, axis=2)  # of a line that is only crossed, few are raised
        touched = level > _TOUCHED * seen.usual_noise
        touched &= level > _DIRECTLY * level.max(1, initial=0.0)[:, None]
        limit = _EQUAL * seen.usual_noise / np.count_nonzero(seen.quiet) ** 0.5 + _ROUNDING
        used = [k for k in range(len(base)) if (axis, k) not in skip]
        pairs = [(a, b) for b in used for a in used if a < b]
        differ = np.array([np.square(base[a] - base[b]).mean() ** 0.5 for a, b in pairs])
        one = differ < _ONE * np.median(differ) if pairs else differ
        for (a, b), apart_at_rest, shown in zip(pairs, differ, one, strict=True):
            if apart_at_rest > limit:
                continue
            when = touched[:, a] | touched[:, b]
            apart = np.abs(raised[when, a] - raised[when, b]).max(1)
            alike = apart < _ALIKE * touch[when][:, [a, b]].max(1) + _APART * seen.usual_noise
            if when.sum() >= _TOUCHES[0 if shown else 1] and alike.mean() > _ALWAYS:
                found.append((axis, a, b))
    return found


class Misplaced(NamedTuple):
    """Attributes:
    axis, lines: two lines that are exchanged; all lines are late by one where `lines` is (-1, -1).
    touches: that were counted.
    share: of the variation that the other order saves.
    """

    axis: int
    lines: tuple[int, int]
    touches: int
    share: float


def misplaced(seen: Recorded, skip, cells=()) -> list[Misplaced]:
    """Lines in the wrong order, if the touches tell.

    Args:
        skip: (axis, line) of lines that are faulty in another way.
        cells: (row, column) of cells that are, dead or noisy: their lines are compared without.
    """
    if len(seen.touches) < _FEWEST:
        return []
    pictures = _pictures(seen)
    found = []
    for axis in (0, 1):
        lines = seen.circuit.shape[axis]
        used = np.array([k for k in range(lines) if (axis, k) not in skip])
        if len(used) < 4:
            continue
        beside = {line for a, line in skip if a != axis} | {cell[1 - axis] for cell in cells}
        across = [k for k in range(seen.circuit.shape[1 - axis]) if k not in beside]
        turned = seen.turned(axis, pictures)[:, used][:, :, across]
        turned = np.pad(turned, ((0, 0), (1, 1), (0, 0)))  # nothing is touched beyond the edges
        apart = np.abs(turned[:, :, None] - turned[:, None]).sum(3)  # (touches, lines, lines)
        order = np.arange(len(used) + 2)
        now = apart[:, order[:-1], order[1:]].sum(1)
        best = None
        for a in range(len(used)):
            for b in range(a + 1, len(used)):
                other = order.copy()
                other[[a + 1, b + 1]] = b + 1, a + 1
                vote = _vote(now, apart[:, other[:-1], other[1:]].sum(1))
                if vote and (best is None or vote[1] > best[0][1]):
                    best = vote, (int(used[a]), int(used[b]))
        shifted = None if skip or cells else _shifted(seen, pictures, axis)
        if shifted and (best is None or shifted.share > best[0][1]):
            found.append(shifted)
        elif best is not None:
            found.append(Misplaced(axis, best[1], *best[0]))
    return sorted(found, key=lambda f: -f.share)[:1]


def _pictures(seen: Recorded) -> np.ndarray:
    """(touches, rows, cols) what each touch adds to the cells' conductance, without the inverse."""
    circuit, full = seen.circuit, seen.circuit.full_scale
    base = circuit.two_terminal(np.maximum(seen.base, 1.0) / full) + 1.0
    steps = np.maximum(seen.steps[seen.touches], 1.0)
    picture = np.maximum(1.0 / (circuit.two_terminal(steps / full) + 20.0) - 1.0 / base, 0.0)
    picture = np.sqrt(picture)
    top = picture.max((1, 2), keepdims=True)
    picture = np.maximum(picture - _LIGHT * top, 0.0)
    return picture / np.maximum(picture.sum((1, 2), keepdims=True), 1e-12)


def _vote(now: np.ndarray, other: np.ndarray) -> tuple[int, float] | None:
    """Touches counted and variation saved, where most of them prefer the other order."""
    saved = now - other
    speaks = np.abs(saved) > _SPEAKS * now
    size = np.abs(saved[speaks]).sum()
    share = float(saved.sum() / max(now.sum(), 1e-12))
    if np.count_nonzero(speaks) < _FEWEST or saved[speaks].sum() < _MAJORITY * size:
        return None
    return (int(np.count_nonzero(speaks)), share) if share > _GAIN / len(now) ** 0.5 else None


def _shifted(seen: Recorded, pictures: np.ndarray, axis: int) -> Misplaced | None:
    """All samples one place late: the first column holds the last one's, a row further down."""
    if axis == 0:
        return None
    moved = np.roll(pictures.reshape(len(pictures), -1), -1, axis=1).reshape(pictures.shape)
    edges = (0, 0), (0, 0), (1, 1)
    now, other = (np.abs(np.diff(np.pad(p, edges))).sum((1, 2)) for p in (pictures, moved))
    vote = _vote(now, other)
    return Misplaced(axis, (-1, -1), *vote) if vote else None


def transposed(seen: Recorded) -> tuple[int, float] | None:
    """Touches counted and variation saved if the samples come column by column, or the rows are the
    columns; None: they do not.

    On a square skin that is another touch's picture, and no reading tells.
    """
    rows, cols = seen.circuit.shape
    if rows == cols or min(rows, cols) == 1 or not seen.circuit.populated.all():
        return None
    pictures = _pictures(seen)
    other = pictures.reshape(-1, cols, rows).swapaxes(1, 2)
    return _vote(_variation(pictures), _variation(other))


def _variation(pictures: np.ndarray) -> np.ndarray:
    """(n,) of (n, rows, cols), from line to line both ways; nothing is touched beyond the edges."""
    padded = np.pad(pictures, ((0, 0), (1, 1), (1, 1)))
    return sum(np.abs(np.diff(padded, axis=axis)).sum((1, 2)) for axis in (1, 2))
