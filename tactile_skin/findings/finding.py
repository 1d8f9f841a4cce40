# SPDX-License-Identifier: Apache-2.0
"""What was found wrong with a skin, as a value: which kind, how bad, where, and its numbers.

words.csv holds all words, in the order in which findings are said.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, NamedTuple, SupportsFloat, TypedDict

import numpy as np

_NAMED = 4  # lines, or cells, that are named one by one


class Severity(IntEnum):
    """What a finding does to the robot."""

    WARN = 1  # is shown
    FAULT = 2  # stops the robot


class Kind(str, Enum):
    """What may be wrong."""

    # what the board sends
    LINK = "link"
    ZEROS = "zeros"
    NO_SIGNAL = "no signal"
    BITS = "bits"
    HUM = "hum"
    SATURATION = "saturation"
    POLARITY = "polarity"
    NO_PICTURE = "no picture"
    # the circuit
    MISFIT = "misfit"
    READOUT = "readout"
    CIRCUIT = "circuit"
    ALL_CELLS = "all cells"
    # the order of lines and samples
    TRANSPOSED = "transposed"
    SHIFTED = "shifted"
    SWAPPED = "swapped"
    DOUBLED = "doubled"
    # lines
    OPEN = "open"
    BROKEN = "broken"
    LEAD = "lead"
    RESISTOR = "resistor"
    SHORT = "short"
    # cells
    DEAD = "dead"
    STUCK = "stuck"
    NOISY = "noisy"
    CONTACT = "contact"
    # the rest
    LOADED = "loaded"
    FABRIC = "fabric"
    UNSTEADY = "unsteady"
    TOO_LITTLE_SEEN = "too little seen"


# What may be found as well while no rest is measured, and is not why.
BESIDE_THE_REST = {Kind.NO_PICTURE, Kind.MISFIT, Kind.CIRCUIT, Kind.ALL_CELLS}


class Words(NamedTuple):
    """How a finding is worded.

    Templates: {at} is the lines or cells, {line} "row" or "column", {detail} and the numbers are
    the finding's.
    """

    where: str
    evidence: str
    remedy: str


def _load() -> dict[tuple[str, str], Words]:
    text = Path(__file__).with_name("words.csv").read_text(encoding="utf-8")
    _, *lines = csv.reader(text.splitlines())
    return {(kind, form): Words(*words) for kind, form, *words in lines}


WORDS = _load()  # (kind, form): words


@dataclass(frozen=True)
class Finding:
    """Two findings are equal if they are of one cause, whatever their numbers are by now.

    Attributes:
        kind: what is wrong.
        form: how it shows; kind and form have their words in words.csv.
        severity: what it does to the robot.
        rows, cols: that it is about; one of each: their crossing.
        numbers: name -> value that its words mention.
        detail: a part of its words that somebody else worked out, as an error's text.
        change: what to enter, where the frames leave no other explanation; None: nothing.
    """

    kind: Kind
    form: str = ""
    severity: Severity = Severity.WARN
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()
    numbers: Mapping[str, SupportsFloat | str] = field(default_factory=dict, compare=False)
    detail: str = field(default="", compare=False)
    change: Any = field(default=None, compare=False)

    def __post_init__(self):
        WORDS[self._key]  # KeyError: there are none

    @property
    def stops(self) -> bool:
        """Whether it stops the robot."""
        return self.severity is Severity.FAULT

    @property
    def rank(self) -> tuple[int, int]:
        """Sorts findings, the worst first."""
        return -self.severity, list(WORDS).index(self._key)

    @property
    def where(self) -> str:
        """The place, for a person; empty if it is about no place."""
        return self._filled(WORDS[self._key].where)

    @property
    def evidence(self) -> str:
        """What shows it."""
        return self._filled(WORDS[self._key].evidence)

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return self._filled(WORDS[self._key].remedy)

    def __str__(self) -> str:
        text = f"{self.where}: {self.evidence}" if self.where else self.evidence
        if not (remedy := self.remedy):
            return text
        return f"{text}. {remedy}" if remedy.endswith("?") else f"{text}. {remedy}."

    @property
    def _key(self) -> tuple[str, str]:
        return self.kind.value, self.form

    def _filled(self, template: str) -> str:
        return template.format(
            at=place(self.rows, self.cols),
            line="row" if self.rows else "column",
            across="column" if self.rows else "row",
            bits=_bits(self.rows or self.cols),
            detail=self.detail,
            **self.numbers,
        )


class Where(TypedDict, total=False):
    """Holds the lines that a finding is about, as `Finding` takes them."""

    rows: tuple[int, ...]
    cols: tuple[int, ...]


def at(cell: Iterable[int]) -> Where:
    """Return rows and cols of one cell, as `Finding` takes them."""
    row, col = (int(k) for k in cell)
    return {"rows": (row,), "cols": (col,)}


def largest(picture: np.ndarray) -> Where:
    """Return rows and cols of the largest value of a (rows, cols) picture."""
    return at(int(k) for k in np.unravel_index(np.argmax(picture), picture.shape))


def lines(axis: int, *of: int) -> Where:
    """Return rows (axis 0) or cols (axis 1) of these lines, as `Finding` takes them."""
    found = tuple(int(k) for k in of)
    return {"cols": found} if axis else {"rows": found}


def whole_lines(finding: Finding) -> set[tuple[int, int]]:
    """Return (axis, line) of each line that a finding is about; none if it is about a cell."""
    if finding.rows and finding.cols:
        return set()
    return {(0, k) for k in finding.rows} | {(1, k) for k in finding.cols}


def place(rows: tuple[int, ...], cols: tuple[int, ...]) -> str:
    """Return the name of lines, or of cells if there are as many rows as columns."""
    if rows and cols:
        return _list([f"row {r}, column {c}" for r, c in zip(rows, cols, strict=True)])
    name, lines = ("row", rows) if rows else ("column", cols)
    if len(lines) == 1:
        return f"{name} {lines[0]}"
    return f"{name}s {_list([str(k) for k in lines])}"


def _list(names: list[str]) -> str:
    if len(names) > _NAMED:
        names = [*names[: _NAMED - 1], f"{len(names) - _NAMED + 1} more"]
    return " and ".join(names)


def _bits(lines: tuple[int, ...]) -> str:
    """Return which address bits: lines that differ in one of them only are the first and 2^bit."""
    bits = [str(k.bit_length() - 1) for k in lines[1:]]
    return f"bit{'s' if bits[1:] else ''} {_list(bits)}"
