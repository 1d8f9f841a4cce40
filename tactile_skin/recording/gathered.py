# SPDX-License-Identifier: Apache-2.0
"""Lines of numbers, gathered one by one into a table that takes little more than its numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .columns import MOST, is_time_name
from .tables import Rows

_AT_ONCE = 1 << 17  # numbers that are taken into the table together, 1 MiB
_GROWTH = 0.125  # share of a table that is asked for ahead; memory that is not touched is not used
_PART = 0.5  # share of a frame's fields that a damaged line holds, at least


class Line(NamedTuple):
    """A line that is not empty."""

    number: int  # from 1
    words: list[str]  # its fields
    numbers: np.ndarray  # of its fields; NaN: none
    texts: list[int]  # fields that are neither a number nor absent
    trails: bool  # whether a separator ends it
    run: int  # that it belongs to
    names: list[str]  # in front of its numbers, as of a JSON object
    is_text: bool  # whether it is no line of numbers


@dataclass
class Alike:
    """Lines of numbers with as many fields."""

    begin: int  # number of the first
    header: list[str]  # fields of the last line of text before it
    names: list[str]  # in front of the first one's numbers
    lines: int = 0
    trails: bool = True  # whether a separator ends each


class Gathered:
    """The lines of one width; what is left of a damaged one holds its place.

    Numbers are held as float32 where these are the same, but for a few columns, as of a time.

    Args:
        width: fields of a line.

    Attributes:
        widths: fields -> the lines that have so many, in the order of their first ones.
    """

    def __init__(self, width: int):
        self.widths: dict[int, Alike] = {}
        self._width, self._n = width, 0
        self._numbers: np.ndarray = np.empty((0, width), np.float32)
        self._finer: dict[int, list[np.ndarray]] = {}  # column -> what float32 does not hold
        self._words: dict[int, list[str]] = {}  # column -> its texts
        self._timed: set[int] = set()  # columns with the name of a time
        self._marks: dict[int, str] = {}  # column -> its first text
        self._waiting: list[Line] = []
        self._lines: list[np.ndarray] = []  # of number, run, damaged

    def add(self, line: Line, header: list[str]) -> None:
        """Take a line of numbers, behind a line of text with this header."""
        n = len(line.words)
        alike = self.widths.setdefault(n, Alike(line.number, header, line.names))
        if n == self._width and not alike.lines:
            self._timed = {k for k, name in enumerate(header) if is_time_name(name)}
        alike.lines += 1
        alike.trails = alike.trails and line.trails
        if n > _PART * self._width:
            self._waiting.append(line._replace(words=[line.words[k] for k in line.texts]))
            if len(self._waiting) * self._width >= _AT_ONCE:
                self._take()

    def _take(self) -> None:
        """Take the lines that wait into the table."""
        n, width, waiting = self._n, self._width, self._waiting
        numbers, lines = np.full((len(waiting), width), np.nan), np.zeros((len(waiting), 3), "i4")
        for k, line in enumerate(waiting):
            damaged = len(line.numbers) != width
            if not damaged:
                numbers[k] = line.numbers
                numbers[k, line.texts] = np.inf
                for column, word in zip(line.texts, line.words, strict=True):
                    self._marks.setdefault(column, word)
                    if MOST <= column < width - MOST - 1 and column not in self._timed:
                        continue
                    words = self._words.setdefault(column, [])
                    words += [""] * (n + k - len(words))
                    words.append(word)
            lines[k] = line.number, line.run, damaged
        with np.errstate(over="ignore"):
            short = numbers.astype(np.float32)
        finer = np.flatnonzero(~((short == numbers) | np.isnan(numbers)).all(0))
        if len(finer := np.union1d(finer, [*self._finer]).astype(int)) > min(MOST, width - 1):
            self._lengthen()
        self._n = n + len(waiting)
        if self._n > len(self._numbers):
            most = round((1.0 + _GROWTH) * self._n)
            self._numbers.resize((most, width), refcheck=False)  # in place
        self._numbers[n : self._n] = numbers
        if self._numbers.dtype == np.float32:
            for k in map(int, finer):
                before = self._finer.setdefault(k, [self._numbers[:n, k].astype(float)])
                before.append(numbers[:, k].copy())  # not the rest of its block
        self._lines.append(lines)
        self._waiting = []

    def _lengthen(self) -> None:
        """Hold all numbers as float64."""
        self._numbers = self._numbers.astype(float)
        for k, parts in self._finer.items():
            self._numbers[: self._n, k] = np.concatenate(parts)
        self._finer = {}

    def table(self, width: int, header: list[str]) -> Rows:
        """Return the lines, of `width` fields without a last one that is empty."""
        self._take()
        self._numbers.resize((self._n, self._width), refcheck=False)
        numbers = self._numbers[:, :width]
        numbered, runs, damaged = np.concatenate(self._lines).T
        texts = {}
        for k in range(width):
            words = self._words.get(k, [])
            if words or ((k < MOST or k >= width - MOST) and np.isnan(numbers[:, k]).any()):
                texts[k] = np.array([*words, *[""] * (self._n - len(words))], object)
        finer = {k: np.concatenate(parts) for k, parts in self._finer.items() if k < width}
        marks = self._marks
        return Rows(numbers, numbered, runs, damaged.astype(bool), header, texts, marks, finer)
