"""Lines that read alike, and lines in the wrong order: what the touches in a recording tell.

A touch covers neighbouring cells. Read in the right order its picture rises once and falls once;
with two lines exchanged it is torn, and varies more from line to line. Each touch has one vote, of
the size by which another order would be smoother than this one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .recorded import Recorded

# RMS by which two lines that read alike differ at rest: times the noise of a mean, and ADC steps.
_EQUAL = 4.0
_ROUNDING = 0.15
_DIRECTLY = 0.25  # share of the most raised line's rise: less comes through the others
_TOUCHED = 8.0  # times the noise by which a touch raises a line
# Touches that it takes: where the rest shows that the two are one, and where it is too noisy for
# that, as of a short recording: a palm raises two lines alike.
_TOUCHES = 3
_TOUCHES_ALONE = 8
_ONE = 0.3  # of the usual pair's difference at rest, which shows that two are one
# Largest difference under a touch, as share of what it raises (lines are read in turn), and times
# the noise; share of the touches in which it is below that.
_ALIKE = 0.03
_APART = 5.0
_ALWAYS = 0.8
# Share saved by the exchange of a line one of whose cells conducts at rest: it carries to one line
# what touches the other. Up to 0.03 with nothing exchanged, 0.14 or more with that line (seeds
# 175000 to 175223).
_PRESSED_GAIN = 0.08
_FEWEST = 5  # touches that speak for another order, or against it
_SPEAKS = 0.02  # share of a touch's variation by which one does
_MAJORITY = 0.5  # of the votes' sum over the sum of their sizes
_GAIN = 0.06  # share of all variation that the other order saves at least, of one touch
_LIGHT = 0.03  # share of the picture's largest value below which a cell counts as untouched
_FEWEST_LINES = 4  # whose order the touches tell


def equal_lines(seen: Recorded, skip) -> list[tuple[int, int, int]]:
    """(axis, line, line) pairs whose readings are equal, at rest and under every touch."""
    found = []
    for axis in (0, 1):
        base = seen.turned(axis, seen.base)
        raised = seen.turned(axis, seen.steps[seen.touches]) - base
        touch = raised.max(2)  # (touches, lines)
        # Of a line that is only crossed few readings are raised. Where lines are driven, a touch
        # raises its own cells only.
        floating = seen.circuit.readout == "floating"
        level = np.median(raised, axis=2) if floating else touch
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
            if when.sum() >= (_TOUCHES if shown else _TOUCHES_ALONE) and alike.mean() > _ALWAYS:
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


def misplaced(seen: Recorded, skip, cells=(), pressed=()) -> list[Misplaced]:
    """Lines in the wrong order, if the touches tell.

    Args:
        skip: (axis, line) of lines that are faulty in another way.
        cells: (row, column) of cells that are faulty: their lines are compared without.
        pressed: those of them that conduct at rest as if they were pressed.
    """
    pictures = _pictures(seen)
    if not len(pictures):
        return []
    found = []
    for axis in (0, 1):
        lines = seen.circuit.shape[axis]
        used = np.array([k for k in range(lines) if (axis, k) not in skip])
        beside = {line for a, line in skip if a != axis} | {cell[1 - axis] for cell in cells}
        across = [k for k in range(seen.circuit.shape[1 - axis]) if k not in beside]
        turned = seen.turned(axis, pictures)[:, used][:, :, across]
        best = exchanged(distances(turned))
        shifted = None if skip or cells else _shifted(seen, pictures, axis)
        if shifted and (best is None or shifted.share > best[1].share):
            found.append(shifted)
        elif best is not None:
            (a, b), votes = best
            pair = int(used[a]), int(used[b])
            if votes.share > _PRESSED_GAIN or not {cell[axis] for cell in pressed} & {*pair}:
                found.append(Misplaced(axis, pair, votes.touches, votes.share))
    return sorted(found, key=lambda f: -f.share)[:1]


def _pictures(seen: Recorded) -> np.ndarray:
    """(touches, rows, cols) what each touch adds to the cells' conductance, without the inverse."""
    circuit, full = seen.circuit, seen.circuit.full_scale
    base = circuit.two_terminal(np.maximum(seen.base, 1.0) / full) + 1.0
    steps = np.maximum(seen.steps[seen.touches], 1.0)
    picture = np.maximum(1.0 / (circuit.two_terminal(steps / full) + 20.0) - 1.0 / base, 0.0)
    return smooth_picture(picture)


def _shifted(seen: Recorded, pictures: np.ndarray, axis: int) -> Misplaced | None:
    """All samples one place late: the first column holds the last one's, a row further down."""
    if axis == 0:
        return None
    moved = np.roll(pictures.reshape(len(pictures), -1), -1, axis=1).reshape(pictures.shape)
    edges = (0, 0), (0, 0), (1, 1)
    now, other = (np.abs(np.diff(np.pad(p, edges))).sum((1, 2)) for p in (pictures, moved))
    votes = vote(now, other)
    return Misplaced(axis, (-1, -1), votes.touches, votes.share) if votes else None


def transposed(seen: Recorded) -> Vote | None:
    """The touches' vote if the samples come column by column, or the rows are the
    columns; None: they do not.

    On a square skin that is another touch's picture, and no reading tells.
    """
    rows, cols = seen.circuit.shape
    if rows == cols or min(rows, cols) == 1 or not seen.circuit.populated.all():
        return None
    pictures = _pictures(seen)
    other = pictures.reshape(-1, cols, rows).swapaxes(1, 2)
    return vote(_variation(pictures), _variation(other))


def _variation(pictures: np.ndarray) -> np.ndarray:
    """(n,) of (n, rows, cols), from line to line both ways; nothing is touched beyond the edges."""
    padded = np.pad(pictures, ((0, 0), (1, 1), (1, 1)))
    return sum(np.abs(np.diff(padded, axis=axis)).sum((1, 2)) for axis in (1, 2))


def smooth_picture(values: np.ndarray) -> np.ndarray:
    """(..., rows, cols) of sum 1, of what each cell gains under touches: the order's evidence."""
    picture = np.sqrt(np.maximum(values, 0.0))
    picture = np.maximum(picture - _LIGHT * picture.max((-2, -1), keepdims=True), 0.0)
    return picture / np.maximum(picture.sum((-2, -1), keepdims=True), 1e-12)


def distances(pictures: np.ndarray) -> np.ndarray:
    """(touches, lines + 2, lines + 2) how much any two lines differ; nothing is touched beyond.

    Args:
        pictures: (touches, lines, cells of a line).
    """
    padded = np.pad(pictures, ((0, 0), (1, 1), (0, 0)))
    return np.abs(padded[:, :, None] - padded[:, None]).sum(3)


class Vote(NamedTuple):
    """Attributes:
    touches: that were counted.
    share: of the variation that the other order saves.
    agreement: sum of the votes over the sum of their sizes.
    """

    touches: int
    share: float
    agreement: float


def vote(now: np.ndarray, other: np.ndarray) -> Vote | None:
    """What touches, of (touches,) variation in this order and in the other, prefer; None: this."""
    found = best_vote(now, (now - other)[:, None])
    return found and found[1]


def best_vote(now: np.ndarray, saved: np.ndarray) -> tuple[int, Vote] | None:
    """The order that most touches prefer, and by how much; None: there is none.

    Args:
        now: (touches,) variation in this order.
        saved: (touches, orders) what each other order saves of it.
    """
    speaks = np.abs(saved) > _SPEAKS * now[:, None]
    size, count = (np.abs(saved) * speaks).sum(0), speaks.sum(0)
    share = saved.sum(0) / max(now.sum(), 1e-12)
    agreement = (saved * speaks).sum(0) / np.maximum(size, 1e-12)
    wins = (count >= _FEWEST) & (agreement >= _MAJORITY)
    wins &= share > _GAIN / max(len(now), 1) ** 0.5
    if not wins.any():
        return None
    k = int(np.where(wins, share, -np.inf).argmax())
    return k, Vote(int(count[k]), float(share[k]), float(agreement[k]))


def exchanged(apart: np.ndarray) -> tuple[tuple[int, int], Vote] | None:
    """The two lines without whose exchange the touches are smoother; None: there are none.

    Args:
        apart: as `distances` has it.
    """
    lines = apart.shape[1] - 2
    if lines < _FEWEST_LINES or len(apart) < _FEWEST:
        return None
    before, here, after = (slice(k, k + lines) for k in range(3))
    k = np.arange(lines)
    beside = apart[:, k, k + 1] + apart[:, k + 1, k + 2]  # (touches, lines), of each to both sides
    there = apart[:, before, here] + apart[:, after, here]  # line b in the place of line a
    saved = beside[:, :, None] + beside[:, None] - there - there.swapaxes(1, 2)
    a, b = np.triu_indices(lines, 1)
    saved = saved[:, a, b] - np.where(b == a + 1, 2.0 * apart[:, a + 1, b + 1], 0.0)
    every = np.arange(lines + 1)
    found = best_vote(apart[:, every, every + 1].sum(1), saved)
    return found and ((int(a[found[0]]), int(b[found[0]])), found[1])
