# SPDX-License-Identifier: Apache-2.0
"""Frames from a table of numbers: a frame a line, or a row of the matrix a line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from ..files import shorten
from ..physics.circuit import Circuit
from . import columns
from .columns import Column, Role

ABSENT = {"", "-", "nan", "null"}  # fields that stand for a crossing that was not read
_LINES_OF_CELLS = 8  # frames in which lines that hold a cell each are looked for
_AT_ONCE = 1024  # frames, or lines, of which something is made together
_NUMBERED = 16  # cells of which no reading looks like a header that numbers them: 0, 1, 2 ...


@dataclass
class Rows:
    """Lines of one width."""

    numbers: np.ndarray  # (n, width); NaN: nothing there; infinite: text
    numbered: np.ndarray  # (n,) lines of the file, from 1
    runs: np.ndarray  # (n,) rising, the same for lines that follow each other with nothing between
    damaged: np.ndarray  # (n,) bool, lines that stand for one of another width
    names: list[str] = field(default_factory=list)  # of the columns; empty: none
    # column -> (n,) its texts, empty where it has none, of the first and last columns that lack any
    # number, and those of times
    texts: dict[int, np.ndarray] = field(default_factory=dict)
    marks: dict[int, str] = field(default_factory=dict)  # column -> its first text
    # column -> (n,) its numbers [float64], of which `numbers` holds less
    finer: dict[int, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of_numbers(cls, numbers: np.ndarray) -> Rows:
        """Return an array's lines, of which none is damaged."""
        n = len(numbers)
        return cls(numbers, np.arange(1, n + 1), np.zeros(n, int), np.zeros(n, bool))

    def part(self, lines: slice) -> Rows:
        return replace(
            self,
            numbers=self.numbers[lines],
            numbered=self.numbered[lines],
            runs=self.runs[lines],
            damaged=self.damaged[lines],
            texts={k: words[lines] for k, words in self.texts.items()},
            finer={k: numbers[lines] for k, numbers in self.finer.items()},
        )

    def column(self, k: int, lines=slice(None)) -> Column:
        name = self.names[k] if self.names else ""
        words = list(self.texts[k][lines]) if k in self.texts else []
        numbers = self.finer.get(k, self.numbers[:, k])
        numbers = numbers[lines].astype(float)
        return Column(name, np.where(np.isinf(numbers), np.nan, numbers), words)

    def cells(self, cells: Sequence[int]) -> np.ndarray:
        """(n, cells) numbers of these columns, as a view where that is possible."""
        if finer := [k for k in self.finer if k in cells]:
            self.numbers = self.numbers.astype(float)
            for k in finer:
                self.numbers[:, k] = self.finer[k]
        inside = slice(cells[0], cells[-1] + 1)
        return self.numbers[:, inside if [*cells] == [*range(cells[0], cells[-1] + 1)] else cells]


@dataclass
class Found:
    """What a file holds."""

    values: np.ndarray  # (n, rows, cols) numbers; NaN: not read
    times: np.ndarray | None = None  # (n,) [s]; None: the file has none
    # what was assumed, repaired or dropped, in words
    notes: list[str] = field(default_factory=list)
    lost: int = 0  # frames that were dropped
    rate: float | None = None  # frames a second that its head says
    lines: np.ndarray = field(default_factory=lambda: np.zeros(0, int))  # (n,) that begin frames
    # name -> (n,) texts of a column that says whose, or of what, each frame is
    labels: dict[str, np.ndarray] = field(default_factory=dict)


class _Layout(NamedTuple):
    """How lines make a frame."""

    # cells, others: of a line, and columns besides
    cells: int
    others: int
    lines: int  # of a frame
    turned: bool = False  # whether a line is a column of the matrix


def number(word: str) -> float:
    """Return the number of a field; NaN: nothing there, or text."""
    try:
        value = np.nan if word.lower() in ABSENT else float(word)
    except ValueError:
        return np.nan
    return value if np.isfinite(value) else np.nan


def frames_of(table: Rows, circuit: Circuit) -> Found:
    """Return the frames of a table.

    Raises:
        ValueError: lines of another size, or columns that do not tell which of them are cells.
    """
    width = table.numbers.shape[1]
    if _places(table.numbers, circuit):
        raise ValueError(
            "each line names the row and column of one reading: must be a frame a line, or a row "
            "of the matrix a line. With pandas: "
            "table.pivot(index=TIME, columns=[ROW, COLUMN], values=READING).to_csv(FILE, "
            "header=False)"
        )
    cells: Sequence[int] = columns.named(table.names, circuit.rows, circuit.cols)
    layout = _Layout(len(cells), width - len(cells), 1) if cells else _layout(table, circuit)
    notes: list[str] = []
    table = _written(table, layout, notes)
    if cells:
        each = [table.column(k) for k in range(width) if k not in cells]
        roles = [columns.role_by_name(c.name, columns.counts(c.numbers)) for c in each]
    elif split := columns.split(table.column, width, layout.cells, layout.lines):
        cells, roles = range(split.front, split.front + layout.cells), [*split.roles]
    else:
        raise ValueError(
            f"{_holds(width, circuit)}, and neither its first nor its last fields show by a name, "
            "or by what they do, that they are no cells: name them in a header (time_ms, index, "
            "label)"
        )
    first = _first_lines(table.runs, layout.lines)
    lines = first[:, None] + np.arange(layout.lines)
    numbers = table.cells(cells)
    bare = len(lines) >= _LINES_OF_CELLS and (table.runs == table.runs[0]).all()
    if layout.lines > 1 and bare and not _are_rows(numbers[lines[:_AT_ONCE]]):
        raise ValueError(
            f"{_holds(width, circuit)}, and a line is as like the next one as that {layout.lines} "
            "lines later: frames of a smaller mat? An empty line after each frame shows its rows"
        )
    marks = [table.marks.get(k, "") for k in cells]
    notes += _drop_marks(numbers, lines[~table.damaged[lines].any(1)], marks)
    text = by_part(lambda part: np.isinf(part).any(1), numbers)
    bad = (table.damaged | text)[lines].any(1)
    if text.any():
        at = table.numbered[text][0]
        notes.append(f"{text.sum()} lines with text for a number: dropped (the first: line {at})")
    empty = by_part(lambda part: np.isnan(part).all(1), numbers)
    blind = ~bad & empty[lines].all(1)
    good = ~bad & ~blind
    outside = [k for k in range(width) if k not in cells]
    others = [
        (table.column(k, first[good]), role, _place(k, width))
        for k, role in zip(outside, roles, strict=True)
    ]
    if layout.lines > 1:
        notes.append(
            f"lines of {layout.cells} numbers: a {'column' if layout.turned else 'row'} of the "
            f"matrix a line, {layout.lines} lines a frame"
        )
    if lost := len(numbers) - lines.size:
        notes.append(f"{lost} lines that make no frame of {layout.lines}: dropped")
    if blind.any():
        at = table.numbered[first[blind][0]]
        notes.append(
            f"{blind.sum()} lines in which no crossing was read: dropped (the first: line {at})"
        )
    found = Found(_frames(numbers, lines[good].ravel(), layout, circuit), None, notes)
    found.lines = table.numbered[first[good]]
    found.lost = int(bad.sum() + blind.sum()) + -(-lost // layout.lines)
    if absent := int(by_part(lambda part: np.isnan(part).sum((1, 2)), found.values).sum()):
        notes.append(f"{absent} fields without a number: taken as not read")
    _describe_others(others, found)
    return found


def by_part(function, values: np.ndarray) -> np.ndarray:
    """Return what a function makes of each frame of (n, ...) values, a part of them at a time."""
    parts = range(0, max(len(values), 1), _AT_ONCE)
    return np.concatenate([function(values[k : k + _AT_ONCE]) for k in parts])


def keep(values: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return values[kept], of rising numbers, made in place of the values: a copy may not fit."""
    if len(kept) == len(values):
        return values
    for k in range(0, len(kept), _AT_ONCE):
        some = kept[k : k + _AT_ONCE]
        values[k : k + len(some)] = values[some]
    return values[: len(kept)]


def _frames(
    numbers: np.ndarray, lines: np.ndarray, layout: _Layout, circuit: Circuit
) -> np.ndarray:
    """(n, rows, cols) of the numbers of the lines that are kept."""
    values = keep(numbers, lines).reshape(-1, layout.lines, layout.cells)
    values = values.swapaxes(1, 2) if layout.turned else values
    return values.reshape(-1, *circuit.shape)


def headed(table: Rows) -> Rows:
    """Without a first line that numbers the columns, 0, 1, 2 ..., as pandas writes it: names."""
    head = table.numbers[0]
    numbered = head[np.isfinite(head)].tolist()
    n = len(numbered)
    if table.names or n < _NUMBERED or numbered not in ([*range(n)], [*range(1, n + 1)]):
        return table
    names = [table.marks.get(k, f"{number:g}") for k, number in enumerate(head)]
    return replace(table.part(slice(1, None)), names=["" if n == "nan" else n for n in names])


def _are_rows(frames: np.ndarray) -> bool:
    """Whether lines of (n, lines, cells) differ as rows: more than by chance, or than in time."""
    frames = np.where(np.isfinite(frames), frames, 0.0).astype(float)
    near, far = (np.abs(np.diff(frames, axis=axis)).mean() for axis in (1, 0))
    own, chance = frames.mean(0).var(0).mean(), frames.var(0).mean() / len(frames)
    return bool(near > 1.1 * far or own > 2.0 * chance or not near)


def _holds(width: int, circuit: Circuit) -> str:
    rows, cols = circuit.shape
    return f"most lines hold {width} numbers, the circuit is {rows} x {cols} = {rows * cols}"


def _places(numbers: np.ndarray, circuit: Circuit) -> bool:
    """Whether two columns of (n, width) numbers run through all rows and columns of the matrix."""
    (rows, cols), width = circuit.shape, numbers.shape[1]
    if min(rows, cols) < 2 or width > 3 + columns.MOST:
        return False
    lines = numbers[: _LINES_OF_CELLS * rows * cols]
    every = [np.array(list(np.ndindex(rows, cols))) + first for first in (0, 1)]
    for pair in permutations(range(width), 2):
        places, often = np.unique(lines[:, pair], axis=0, return_counts=True)
        if often.min() > 1 and any(np.array_equal(places, each) for each in every):
            return True
    return False


def _layout(table: Rows, circuit: Circuit) -> _Layout:
    """By the width, whose fewest columns are no cells."""
    width, (rows, cols) = table.numbers.shape[1], circuit.shape
    ways = [(rows * cols, 1, False), (cols, rows, False), (rows, cols, True)]
    found = [
        _Layout(cells, width - cells, lines, turned)
        for cells, lines, turned in ways
        if 0 <= width - cells <= columns.MOST and (lines == 1 or len(table.numbers) >= lines)
    ]
    if not found:
        if width % (rows * cols) == 0:
            raise ValueError(
                f"{_holds(width, circuit)}, {width // (rows * cols)} times as many: several mats "
                "on one board? Must be a file for each"
            )
        raise ValueError(
            f"{_holds(width, circuit)}: must be these, or {cols}, a row of the matrix a line, with "
            f"at most {columns.MOST} columns more for time, counter and label, or a header that "
            "names the cells (R1C1 ...); check rows and cols"
        )
    return min(found, key=lambda layout: layout.others)


def _written(table: Rows, layout: _Layout, notes: list[str]) -> Rows:
    """Without the zeros at its end that a buffer held which was never filled."""
    zero = by_part(lambda part: (part == 0.0).sum(1), table.numbers) >= layout.cells
    last = int(np.flatnonzero(~zero)[-1]) + 1 if not zero.all() else len(zero)
    last += -last % layout.lines
    if last >= len(zero) or zero[:last].reshape(-1, layout.lines).all(1).any():
        return table
    n = (len(zero) - last) // layout.lines
    notes.append(f"the last {n} frames are all 0: never written, and dropped")
    return table.part(slice(last))


def _drop_marks(numbers: np.ndarray, lines: np.ndarray, marks: Sequence[str]) -> list[str]:
    """Make text at the same cells of all frames crossings without readings; return it in words.

    Args:
        numbers: (n, cells) of lines, changed in place; infinite: text.
        lines: (frames, lines) which make a frame.
        marks: (cells,) the first text of each column; empty: none.
    """
    worded = np.array([bool(mark) and not re.search(r"\d", mark) for mark in marks])
    if not worded.any() or not len(lines):
        return []
    always = [by_part(lambda part: ~np.isinf(numbers[part]), k).sum(0) == 0 for k in lines.T]
    for r, c in np.argwhere(found := np.array(always) & worded):
        numbers[lines[:, r], c] = np.nan
    where = f"at the same {found.sum()} cells of all frames: no readings"
    return [f"{marks[int(found.any(0).argmax())]!r} {where}"] if found.any() else []


def _first_lines(runs: np.ndarray, lines: int) -> np.ndarray:
    """Return the first line of each frame."""
    # of a run with a remainder nobody knows which lines are missing, but for the last one's end
    begins = np.flatnonzero(np.diff(runs, prepend=runs[0] - 1)) if len(runs) else np.zeros(0, int)
    found: list[int] = []
    for begin, end in zip(begins, [*begins[1:], len(runs)], strict=True):
        if (end - begin) % lines == 0 or end == len(runs):
            found += range(begin, end - lines + 1, lines)
    return np.array(found, dtype=int)


def _describe_others(others: list[tuple[Column, Role | None, str]], found: Found) -> None:
    """Add to `found` times and notes from the columns that are no cells, each with its place."""
    if passed := [column.name for column, role, _ in others if role is None]:
        names = ", ".join(passed)
        found.notes.append(f"{len(passed)} columns by name no cells: passed over ({names})")
    for column, role, place in others:
        if role not in (Role.TIME, None):
            what = "counts" if role is Role.COUNTER else "is a label"
            found.notes.append(f"{place} {what}: passed over")
        if role is not Role.LABEL:
            continue
        found.labels[column.name or place] = columns.texts(column)
        seen = list(dict.fromkeys(filter(None, column.words)))
        if len(seen) > 1 and not columns.is_person(column.name):
            words = f"{len(seen)} labels, {', '.join(map(shorten, seen[: columns.MOST]))}"
            more = " ..." * (len(seen) > columns.MOST)
            found.notes.append(f"{words}{more}: `tactile-skin gestures record` makes takes of each")
    if timed := [(column, place) for column, role, place in others if role is Role.TIME]:
        found.times = columns.times([c for c, _ in timed], found.notes, [p for _, p in timed])


def _place(k: int, width: int) -> str:
    return {0: "the first column", width - 1: "the last column"}.get(k, f"column {k + 1}")
