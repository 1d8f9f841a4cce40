"""What was found wrong with a skin, as a value: which kind, how bad, where, and its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum

import numpy as np


class Severity(IntEnum):
    """What a finding does to the robot."""

    NOTE = 0  # is shown
    WARN = 1  # is shown as a warning
    FAULT = 2  # stops the robot


class Kind(str, Enum):
    """What may be wrong, in the order in which it is said; its words stand in words.py."""

    # what the board sends
    NO_PICTURE = "no picture"
    PROCESSED = "zeros"
    LOADED_AT_START = "loaded at the start"
    RISEN = "risen since the start"
    NO_SIGNAL = "no signal"
    NO_SIGNAL_OR_OFFSET = "no signal, or an offset taken off"
    STUCK_BIT = "bits"
    SATURATED = "saturation"
    # lines
    EXCHANGED = "swapped"
    ADDRESS_BIT = "address bit"
    # the circuit
    MISFIT = "misfit"
    MISFIT_KEPT = "misfit that is kept"
    ALL_CELLS = "all cells at once"
    SERIES = "circuit"
    AT_END = "end of the range"
    # the rest
    UNSTEADY = "unsteady at rest"
    ZERO_AT_REST = "zero at rest"
    NO_REST = "no rest fits"
    OTHER_FABRIC = "other fabric"
    PRESSED_AT_REST = "stuck"
    OPEN_AT_REST = "dead"
    WEAK_LINE = "lead"
    FADING_LINE = "fading lead"
    ONE_LINE = "doubled"
    # single cells
    NOISY = "noisy"
    JUMPS = "jumps"
    CONSTANT = "constant"
    CONTACT = "contact"


# What may be found as well while no rest is measured, and is not why.
BESIDE_THE_REST = {
    Kind.NO_PICTURE,
    Kind.MISFIT,
    Kind.MISFIT_KEPT,
    Kind.SERIES,
    Kind.AT_END,
    Kind.NOISY,
    Kind.CONTACT,
    Kind.ALL_CELLS,
}


_ORDER = {kind: k for k, kind in enumerate(Kind)}


@dataclass(frozen=True)
class Finding:
    """Two findings are equal if they are of one cause, whatever their numbers are by now.

    Attributes:
        kind: what is wrong.
        severity: what it does to the robot.
        rows, cols: that it is about; one of each: their crossing.
        numbers: name -> value that its words mention.
        detail: what a solver or a node said, where it has words of its own.
    """

    kind: Kind
    severity: Severity = Severity.WARN
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict, compare=False)
    detail: str = field(default="", compare=False)

    @property
    def stops(self) -> bool:
        return self.severity is Severity.FAULT

    @property
    def rank(self) -> tuple[int, int]:
        """Sorts findings, the worst first."""
        return -self.severity, _ORDER[self.kind]

    def __str__(self) -> str:
        from .words import say  # which knows this class

        return say(self)


def at(cell: Iterable[int]) -> dict[str, tuple[int, ...]]:
    """Return rows and cols of one cell, as `Finding` takes them."""
    row, col = (int(k) for k in cell)
    return {"rows": (row,), "cols": (col,)}


def largest(picture: np.ndarray) -> dict[str, tuple[int, ...]]:
    """Return rows and cols of the largest value of a (rows, cols) picture."""
    return at(np.unravel_index(np.argmax(picture), picture.shape))


def line(axis: int, *lines: int) -> dict[str, tuple[int, ...]]:
    """Return rows (axis 0) or cols (axis 1) of these lines, as `Finding` takes them."""
    return {("rows", "cols")[axis]: tuple(int(k) for k in lines)}
