# SPDX-License-Identifier: Apache-2.0
"""What was found wrong with a skin, as a value: which kind, how bad, where, and its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Any, SupportsFloat, TypedDict

import numpy as np

from . import words


class Severity(IntEnum):
    """What a finding does to the robot."""

    NOTE = 0  # is shown
    WARN = 1  # is shown as a warning
    FAULT = 2  # stops the robot


class Kind(str, Enum):
    """What may be wrong."""

    # what the board sends
    LINK = "link"
    ZEROS = "zeros"
    NO_SIGNAL = "no signal"
    BITS = "bits"
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


@dataclass(frozen=True)
class Finding:
    """Two findings are equal if they are of one cause, whatever their numbers are by now."""

    kind: Kind
    form: str = ""
    severity: Severity = Severity.WARN
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()
    numbers: Mapping[str, SupportsFloat | str] = field(default_factory=dict, compare=False)
    detail: str = field(default="", compare=False)
    change: Any = field(default=None, compare=False)

    def __post_init__(self):
        words.of(self)  # there are some

    @property
    def stops(self) -> bool:
        """Whether it stops the robot."""
        return self.severity is Severity.FAULT

    @property
    def rank(self) -> tuple[int, int]:
        """Sorts findings, the worst first."""
        return -self.severity, words.rank(self)

    @property
    def where(self) -> str:
        """The place, for a person; empty if it is about no place."""
        return words.fill(self, words.of(self).where)

    @property
    def evidence(self) -> str:
        """What shows it."""
        return words.fill(self, words.of(self).evidence)

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return words.fill(self, words.of(self).remedy)

    def __str__(self) -> str:
        text = f"{self.where}: {self.evidence}" if self.where else self.evidence
        if not (remedy := self.remedy):
            return text
        return f"{text}. {remedy}" if remedy.endswith("?") else f"{text}. {remedy}."


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
