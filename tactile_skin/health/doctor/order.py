# SPDX-License-Identifier: Apache-2.0
"""Lines that read alike, and lines in the wrong order: what the touches in a recording tell.

A touch covers neighbouring cells. Read in the right order its picture rises once and falls once;
with two lines exchanged it is torn, and varies more from line to line. Each touch has one vote, of
the size by which another order would be smoother than this one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...calibration import at_rest
from ...findings.finding import Finding, Kind, lines
from .recorded import FEW_TOUCHES, Recorded

# Share saved by the exchange of a line one of whose cells conducts at rest: it carries to one line
# what touches the other. Up to 0.03 with nothing exchanged, 0.14 or more with that line (seeds
# 175000 to 175223).
_PRESSED_GAIN = 0.08
_SPEAKS = 0.02  # share of a touch's variation by which one does
_MAJORITY = 0.5  # of the votes' sum over the sum of their sizes
_GAIN = 0.06  # share of all variation that the other order saves at least, of one touch
_LIGHT = 0.03  # share of the picture's largest value below which a cell counts as untouched
_FEWEST_LINES = 4  # whose order the touches tell
_MORE = 1.5  # times what the best exchange saves, that another order does
_NO_GAIN = 1e-3  # share of the variation by which an order is no better
_STRETCH = 3  # lines that are moved together


def equal_lines(seen: Recorded, skip) -> list[tuple[int, int, int]]:
    """Return (axis, line, line) pairs whose readings are equal, at rest or under touches."""
    cells, steps = seen.without(seen.cells, skip), seen.base.astype(float)
    noise = seen.usual_noise / np.count_nonzero(seen.quiet) ** 0.5
    return sorted({*at_rest.equal_lines(steps, noise, cells), *_under_touches(seen, cells)})


def _under_touches(seen: Recorded, cells: np.ndarray) -> Iterator[tuple[int, int, int]]:
    """Yield the pairs that read alike, to the noise, in some touches that press them most.

    A touch joins the lines below it: where neighbours usually read nearly alike, none is named.
    """
    steps = np.where(cells, seen.steps[seen.touches], 0.0)
    by_noise = 2.0 * seen.usual_noise**2
    for axis in (0, 1):
        there, touches = seen.turned(axis, cells), seen.turned(axis, steps)
        pressed = touches.max(2).argmax(1)
        apart: dict[tuple[int, int], float] = {}  # squared difference of two lines
        for a, b in combinations(np.flatnonzero(there.any(1)).tolist(), 2):
            both, on = there[a] & there[b], touches[np.isin(pressed, (a, b))]
            if len(on) >= FEW_TOUCHES and both.any():
                apart[a, b] = float(np.square(on[:, a, both] - on[:, b, both]).mean())
        neighbours = [of for (a, b), of in apart.items() if b == a + 1]
        most = at_rest.ALIKE * float(np.median(neighbours)) if neighbours else 0.0
        if most < by_noise:
            continue
        for pair, of in apart.items():
            if of < min(most, at_rest.OF_NOISE * by_noise):
                yield axis, *pair


def misplaced(seen: Recorded, skip, cells=(), pressed=()) -> list[Finding]:
    """Return the lines in the wrong order, if the touches show any.

    Args:
        skip: (axis, line) of lines that are faulty in another way.
        cells: (row, column) of cells that are faulty: their lines are compared without.
        pressed: those of them that conduct at rest as if they were pressed.
    """
    pictures = _pictures(seen)
    found: list[tuple[float, Finding]] = []  # share of the variation that the order saves
    if not (skip or cells):
        late = _one_late(pictures)
        found += [(late.share, Finding(Kind.SHIFTED, numbers=late._asdict()))] if late else []
    for axis in (0, 1):
        used = [k for k in range(seen.circuit.shape[axis]) if (axis, k) not in skip]
        beside = {line for a, line in skip if a != axis} | {cell[1 - axis] for cell in cells}
        across = [k for k in range(seen.circuit.shape[1 - axis]) if k not in beside]
        turned = seen.turned(axis, pictures)[:, used][:, :, across]
        # an order is entered with all lines
        if len(used) == seen.circuit.shape[axis] and (ordered := reordered(turned)):
            order, votes = ordered
            of, words = lines(axis, *order), " ".join(map(str, order))
            numbers = votes._asdict()
            finding = Finding(Kind.SWAPPED, "order", **of, numbers=numbers, detail=words)
            found.append((votes.share, finding))
            continue
        if (best := _exchanged(turned)) is None:
            continue
        pair, votes = (used[k] for k in best[0]), best[1]
        of = lines(axis, *pair)
        odd = {cell[axis] for cell in pressed} & {*of.get("rows", ()), *of.get("cols", ())}
        if votes.share > _PRESSED_GAIN or not odd:
            found.append((votes.share, Finding(Kind.SWAPPED, **of, numbers=votes._asdict())))
    found.sort(key=lambda pair: -pair[0])
    first = [finding for _, finding in found[:1]]
    # rows and columns may both be in another order
    also = [f for _, f in found[1:] if f.form == "order" == first[0].form]
    return first + also


def _pictures(seen: Recorded) -> np.ndarray:
    """(touches, rows, cols) of sum 1: the root of what a touch adds to the conductance, nearly."""
    circuit, full = seen.circuit, seen.circuit.full_scale
    base = circuit.two_terminal(np.maximum(seen.base, 1.0) / full) + 1.0
    steps = np.maximum(seen.steps[seen.touches], 1.0)
    added = 1.0 / (circuit.two_terminal(steps / full) + 20.0) - 1.0 / base
    picture = np.sqrt(np.maximum(added, 0.0))
    picture = np.maximum(picture - _LIGHT * picture.max((-2, -1), keepdims=True), 0.0)
    return picture / np.maximum(picture.sum((-2, -1), keepdims=True), 1e-12)


def _one_late(pictures: np.ndarray) -> Vote | None:
    """All samples one place late: the first column holds the last one's, a row further down."""
    _, rows, cols = pictures.shape
    moved = np.roll(pictures.reshape(-1, rows * cols), -1, axis=1).reshape(pictures.shape)
    now, other = (_variation(p.swapaxes(1, 2)) for p in (pictures, moved))
    return _only(now, other)


def transposed(seen: Recorded) -> Vote | None:
    """Return the touches' vote if the samples' rows and columns are exchanged; None: they are not.

    On a square skin that is another touch's picture, and no reading tells.
    """
    rows, cols = seen.circuit.shape
    if rows == cols or min(rows, cols) == 1 or not seen.circuit.populated.all():
        return None
    pictures = _pictures(seen)
    other = pictures.reshape(-1, cols, rows)
    now, exchanged = (_variation(p) + _variation(p.swapaxes(1, 2)) for p in (pictures, other))
    return _only(now, exchanged)


def _variation(pictures: np.ndarray) -> np.ndarray:
    """(n,) of (n, lines, cells), from line to line; nothing is touched beyond the edges."""
    return np.abs(np.diff(pictures, axis=1, prepend=0.0, append=0.0)).sum((1, 2))


class Vote(NamedTuple):
    """What touches prefer."""

    touches: int  # that were counted
    share: float  # of the variation that the other order saves


def _only(now: np.ndarray, other: np.ndarray) -> Vote | None:
    """Return the touches' vote for the only other order, by (touches,) variation in each."""
    found = _vote(now, (now - other)[:, None])
    return found and found[1]


def _vote(now: np.ndarray, saved: np.ndarray) -> tuple[int, Vote] | None:
    """Return the order that saves most of the variation `now`, and the vote; None: none does."""
    speaks = np.abs(saved) > _SPEAKS * now[:, None]
    size, count = (np.abs(saved) * speaks).sum(0), speaks.sum(0)
    share = saved.sum(0) / max(now.sum(), 1e-12)
    agreement = (saved * speaks).sum(0) / np.maximum(size, 1e-12)
    wins = (count >= FEW_TOUCHES) & (agreement >= _MAJORITY)
    wins &= share > _GAIN / max(len(now), 1) ** 0.5
    if not wins.any():
        return None
    k = int(np.where(wins, share, -np.inf).argmax())
    return k, Vote(int(count[k]), float(share[k]))


def _exchanged(pictures: np.ndarray) -> tuple[tuple[int, int], Vote] | None:
    """Return the two lines without whose exchange touches are smoother; None: there are none."""
    count = pictures.shape[1]
    if count < _FEWEST_LINES or len(pictures) < FEW_TOUCHES:
        return None
    now, pairs = _variation(pictures), list(combinations(range(count), 2))
    saved = np.empty((len(pictures), len(pairs)))
    for k, (a, b) in enumerate(pairs):
        order = np.arange(count)
        order[[a, b]] = b, a
        saved[:, k] = now - _variation(pictures[:, order])
    found = _vote(now, saved)
    return found and (pairs[found[0]], found[1])


def reordered(pictures: np.ndarray) -> tuple[list[int], Vote] | None:
    """Return the order of lines in which touches are smoothest; None: at most two are out of place.

    An order that half of the touches choose is voted on by the other half.
    """
    count = pictures.shape[1]
    if count <= _FEWEST_LINES or len(pictures) < 2 * FEW_TOUCHES:
        return None
    order = _smoothest(pictures)
    if np.count_nonzero(np.array(order) != np.arange(count)) <= 2:
        return None
    saved = np.empty((len(pictures), 1))
    for k in (0, 1):
        voting, chosen = pictures[k::2], _smoothest(pictures[1 - k :: 2])
        saved[k::2, 0] = _variation(voting) - _variation(voting[:, chosen])
    found = _vote(_variation(pictures), saved)
    exchange = _exchanged(pictures)
    if found is None or (exchange and exchange[1].share * _MORE > found[1].share):
        return None
    return order, found[1]


def _smoothest(pictures: np.ndarray) -> list[int]:
    """Return an order of the lines of (touches, lines, cells) that varies least from one to next.

    Stretches of it are turned round, and moved, while that saves something (Lin and Kernighan 1973;
    Or 1976), from the order as it is and from that of the second eigenvector of how alike lines are
    (Fiedler 1975); the former, unless the latter saves `_GAIN` more.
    """
    count = pictures.shape[1]
    bare = np.zeros((len(pictures), 1, pictures.shape[2]))  # beyond the edges
    flat = np.concatenate([pictures, bare], 1).swapaxes(0, 1).reshape(count + 1, -1)
    apart = np.array([np.abs(flat - line).sum(1) for line in flat])
    between = apart[:-1, :-1]
    alike = np.exp(-between / max(float(between.max()), np.finfo(float).tiny))
    _, vectors = np.linalg.eigh(np.diag(alike.sum(1)) - alike)
    spectral = np.argsort(vectors[:, 1]).tolist()
    if np.corrcoef(spectral, np.arange(count))[0, 1] < 0.0:
        spectral.reverse()
    found = [_shortest(order, apart) for order in (list(range(count)), spectral)]
    lengths = [_length(order, apart) for order in found]
    order = found[lengths[1] < (1.0 - _GAIN) * lengths[0]]
    return order[::-1] if np.corrcoef(order, np.arange(count))[0, 1] < 0.0 else order


def _length(order: list[int], apart: np.ndarray) -> float:
    """Return the variation along a path through all lines, from and to beyond the edges."""
    path = [-1, *order, -1]
    return float(apart[path[:-1], path[1:]].sum())


def _shortest(order: list[int], apart: np.ndarray) -> list[int]:
    """Return a path that no stretch of lines shortens, turned round or moved."""
    count, best = len(order), _length(order, apart)
    least = _NO_GAIN * best
    improved = True
    while improved:
        improved = False
        for a, b in combinations(range(count + 1), 2):
            rest, stretch, places = order[:a] + order[b:], order[a:b], [a]
            if b - a <= _STRETCH:
                places = list(range(len(rest) + 1))
            paths = [rest[:k] + way + rest[k:] for k in places for way in (stretch, stretch[::-1])]
            lengths = [_length(path, apart) for path in paths]
            k = int(np.argmin(lengths))
            if lengths[k] < best - least:
                order, best, improved = paths[k], lengths[k], True
    return order
