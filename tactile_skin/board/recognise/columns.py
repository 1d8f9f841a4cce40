# SPDX-License-Identifier: Apache-2.0
"""What the columns of lines of numbers are: readings, places, times, counters, classes."""

from __future__ import annotations

import numpy as np

FEW = 4  # whole frames, at least, in a sample that makes sure
STEADY = 0.95  # share of the steps of a counter that go up, or on by one
_LONGEST_CYCLE = 4096  # cells of a frame
_RISING = 8  # lines from which on chance makes no number rise all the time
_MOST_IN_FRONT = 3  # numbers in front of readings, or behind them, that are none
EVEN = 0.5  # rows over columns of most boards, at least
_CLASSES = 12  # numbers below it, and below all readings, may be classes
_JUMPS = 2.0  # times as far as those of the other cells jumps what is no reading


def cycle(column: np.ndarray) -> int:
    """How many numbers a column counts through, again and again from 0 or 1; 0: it does not."""
    if np.isnan(column).any() or (column % 1).any():
        return 0
    low, high = column.min(), column.max()
    size = int(high - low) + 1
    if low not in (0, 1) or not 2 <= size <= _LONGEST_CYCLE or len(column) < size + 2:
        return 0
    steps = np.diff(column)
    good = (steps == 1) | ((column[1:] == low) & (column[:-1] == high))
    return size if good.mean() >= STEADY else 0


def _rises(column: np.ndarray) -> bool:
    """Whether a column is a time, or a counter, which may begin again from 0 or 1."""
    steps = np.diff(column)
    equal = len(np.unique(steps)) == 2 and np.median(steps) > 0  # but where it begins again
    again = equal and column.min() in (0, 1) and steps.min() == -np.ptp(column)
    return bool(len(steps) >= FEW and (again or (steps > 0).mean() >= STEADY))


def _rises_in_front(column: np.ndarray) -> bool:
    """Whether a column is a time or a counter: of lines, or of frames of equally many lines."""
    steps = np.diff(column)
    at = np.flatnonzero(steps)
    if _rises(column) or len(at) < FEW:
        return _rises(column)
    lines = np.diff(at)  # of a frame
    return bool(_rises(column[at]) and (lines == np.median(lines)).mean() >= STEADY)


def roles(
    lead: np.ndarray, readings: int, cells: int = 0
) -> tuple[list[str], int, tuple[int, ...], bool]:
    """Return what each number in front of the readings is.

    Args:
        lead: (lines, k) numbers.
        readings: behind them in a line.
        cells: of a frame, if that is known: no number of a line that holds one counts its rows.

    Returns:
        row, col, index or skip for each; the first number of a place; how many rows, or (rows,
        cols), or cells they count; whether each is known.
    """
    k = lead.shape[1]
    for a in range(k - 1 if readings == 1 else 0):
        row, col = lead[:, a], lead[:, a + 1]
        first = min(row.min(), col.min())
        rows, cols = row.max() - first + 1, col.max() - first + 1
        outer, inner = (row - first) * cols + col - first, (col - first) * rows + row - first
        if first in (0, 1) and rows * cols in (cycle(outer), cycle(inner)) and cols > 1 < rows:
            names = ["skip"] * k
            names[a : a + 2] = "row", "col"
            return names, int(first), (int(rows), int(cols)), True
    names, sure, first = [], True, 0
    size: tuple[int, ...] = ()
    for column in lead.T:
        n = cycle(column)
        if n and readings == cells > 1:
            names.append("skip")
        elif n and not size:
            names.append("row" if readings > 1 else "index")
            first, size = int(column.min()), (n,)
        else:
            names.append("skip")
            sure = sure and (_rises_in_front(column) or bool((column == column[0]).all()))
    return names, first, size, sure


def in_front(values: np.ndarray) -> tuple[int, bool]:
    """How many numbers in front of a line are no readings, and whether that is sure."""
    n, front = values.shape[1], 0
    while front < min(_MOST_IN_FRONT, n - 1):
        place = roles(values[:, front : front + 2], 1)[2] if n - front >= 3 else ()
        if len(place) == 2:
            return front + 2, True
        if not (_rises_in_front(values[:, front]) or cycle(values[:, front])):
            break
        front += 1
    return front, not front or len(values) > _RISING


def more_in_front(values: np.ndarray, cells: int) -> tuple[int, bool]:
    """How many of the numbers that are more than the cells stand in front, and whether it shows.

    Those in the middle are readings. Where the numbers at no end, or at more than one, show that
    they are none, those are left out that differ most from the middle.

    Args:
        values: (lines, n) numbers.
        cells: of a frame; 0: unknown.
    """
    n = values.shape[1]
    others = n - cells
    if not (cells and 0 < others <= _MOST_IN_FRONT):
        return 0, True
    if n < 3 * others:
        return 0, False
    inner = values[:, others : n - others]
    usual = np.median(inner)
    found = []
    for front in range(others + 1):
        outside = np.delete(values, np.s_[front : front + cells], axis=1)
        shows = [_is_none(column, inner) for column in outside.T]
        far = float(np.abs(np.median(outside, axis=0) - usual).sum())
        found.append((sum(shows), far, -front))
    most, _, front = max(found)
    return -front, most == others and sum(each[0] == others for each in found) == 1


def may_be_less(values: np.ndarray) -> bool:
    """Whether a first or last number of lines shows that it may be none of the readings."""
    n = values.shape[1]
    k = min(2, (n - 2) // 2)  # numbers at each end that are looked at
    if k < 1 or len(values) < FEW:
        return False
    jumps = np.median(np.nan_to_num(np.abs(np.diff(values, axis=0))), axis=0)
    inner, constant = values[:, k:-k], (values == values[0]).all(0)
    for at in (*range(k), *range(n - k, n)):
        column, others = values[:, at], values[:, at + 1 :] if at < k else values[:, :at]
        if constant[at]:
            if not (inner[:, constant[k:-k]] == column[:1]).any():
                return True
        elif (
            jumps[at] > _JUMPS * max(jumps[k:-k].max(), 1.0)
            or _derived(column, others)
            or column.max() < min(inner.min(), _CLASSES)
        ):
            return True
    return False


def _derived(column: np.ndarray, readings: np.ndarray) -> bool:
    """Whether numbers are what sketches print of a frame: its extremes, its sum or its mean."""
    mean = readings.mean(1)
    kinds = readings.max(1), readings.min(1), readings.sum(1), np.floor(mean), np.rint(mean), mean
    return any(np.allclose(kind, column, rtol=1e-6, atol=1e-2) for kind in kinds)


def likely_less(numbers: int) -> bool:
    """Whether one or two numbers less than these are the cells of a more usual mat."""
    even = [
        rows >= EVEN * cols for rows, cols in map(sides, range(max(1, numbers - 2), numbers + 1))
    ]
    return any(even) and not even[-1]


def _is_none(column: np.ndarray, readings: np.ndarray) -> bool:
    """Whether a column of numbers shows that it is no reading."""
    if _rises(column) or np.allclose(readings.sum(1), column):
        return True
    if (column == column[0]).all() and not (readings == readings[0]).all(0).any():
        return True
    return bool((column % 1).any() and not (readings % 1).any())


def more_behind(values: np.ndarray, cells: int) -> tuple[int, bool]:
    """How many numbers behind a line are no readings, and whether that is sure."""
    n, last = values.shape[1], values[:, -1]
    if n < 3:
        return 0, True
    if 0 < n - cells <= _MOST_IN_FRONT and cells:
        return n - cells, True
    if n == cells:
        return 0, True
    if _rises(last) or np.allclose(values[:, :-1].sum(1), last):
        return 1, len(values) > _RISING
    return 0, True


def sides(cells: int) -> tuple[int, int]:
    """Return the (rows, columns) of so many cells whose shape is nearest to a square."""
    rows = next(n for n in range(int(cells**0.5), 0, -1) if cells % n == 0)
    return rows, cells // rows
