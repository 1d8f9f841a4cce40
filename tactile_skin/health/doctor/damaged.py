"""Findings of damaged wires and cells.

A check of a recording is a function in `CHECKS`: what is recorded, and (axis, line) of lines that
earlier ones found unusable -> findings. Its words stand in findings/words.csv.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...findings.finding import Finding, Kind, at, lines
from ...physics.circuit import Circuit
from . import readings
from .recorded import Recorded, line_name
from .wiring import Damage

# Ohm of a crossing, below which it is no pressed cell but a short: one of 1 ohm seems to have up to
# 40 where r_ref or r_par is 10 % off.
_SHORT = 60.0
_LOOSE = 0.25  # of all lines at most come and go: more are touches on a skin that never rests


def open_lines(seen: Recorded, skip: set) -> list[Finding]:
    """Return lines of which no reading rises."""
    found = []
    for axis, line, high, usual in readings.open_lines(seen):
        count = np.count_nonzero(seen.turned(axis, seen.read)[line])
        numbers = {"count": int(count), "most": high, "usual": usual}
        found.append(Finding(Kind.OPEN, **lines(axis, line), numbers=numbers))
    return found


def loose_lines(seen: Recorded, skip: set) -> list[Finding]:
    """Return lines that are open in some frames."""
    loose = readings.loose_lines(seen)
    if len(loose) > _LOOSE * sum(seen.circuit.shape):
        return []
    return [
        Finding(Kind.CONTACT, "line", **lines(axis, line), numbers={"share": share})
        for axis, line, share in loose
        if (axis, line) not in skip
    ]


def noisy(seen: Recorded, skip: set) -> list[Finding]:
    """Return lines and cells with much more noise than the others."""
    in_lines, in_cells = readings.noisy(seen, skip)
    places = [("line", lines(axis, line), noise) for axis, line, noise in in_lines]
    places += [("cell", {"rows": (r,), "cols": (c,)}, noise) for r, c, noise in in_cells]
    return [
        Finding(Kind.NOISY, form, **of, numbers={"noise": noise, "usual": seen.usual_noise})
        for form, of, noise in places
    ]


Check = Callable[[Recorded, set[tuple[int, int]]], list[Finding]]
CHECKS: list[Check] = [open_lines, loose_lines, noisy]


def whole_lines(finding: Finding) -> set[tuple[int, int]]:
    """Return (axis, line) of each line that a finding is about; none if it is about a cell."""
    if finding.rows and finding.cols:
        return set()
    return {(0, k) for k in finding.rows} | {(1, k) for k in finding.cols}


def doubled(axis: int, count: int, pairs: list[tuple[int, int]]) -> list[Finding]:
    """Return address bits that are stuck, or the pairs of lines of which one is read twice.

    Args:
        count: of lines.
    """
    found = []
    for bit in range((count - 1).bit_length()):
        apart = 1 << bit
        expected = {(k, k | apart) for k in range(count) if not k & apart and k | apart < count}
        if len(pairs) > 1 and expected <= set(pairs):
            name = ("rows", "columns")[axis]
            alike = f"{name} {', '.join(f'{a} and {b}' for a, b in sorted(expected))}"
            of = lines(axis, *range(count))
            found.append(
                Finding(Kind.DOUBLED, "address bit", **of, numbers={"bit": bit}, detail=alike)
            )
    return found or [Finding(Kind.DOUBLED, **lines(axis, *pair)) for pair in pairs]


def damage(circuit: Circuit, damage: Damage, cell: float, ends: bool = False) -> Finding:
    """Return the finding of a damage.

    Args:
        cell: resistance of an untouched cell [ohm].
        ends: whether the cell's reading is at the ceiling, so that it may conduct more.
    """
    if damage.kind == "cell":
        return _cell(circuit, damage, cell, ends)
    of = lines(damage.axis, damage.line)
    if damage.kind == "lead":
        return Finding(Kind.LEAD, **of, numbers={"ohm": damage.size, "std": damage.std})
    if damage.kind == "broken":
        return Finding(Kind.BROKEN, **of, numbers={"before": damage.at, "last": damage.at - 1})
    if not np.isfinite(damage.size):
        return Finding(Kind.RESISTOR, "missing", **of)
    return Finding(Kind.RESISTOR, **of, numbers={"ohm": damage.size, "supposed": circuit.r_ref})


def _cell(circuit: Circuit, damage: Damage, cell: float, ends: bool) -> Finding:
    row, col = damage.line, damage.at
    of = at((row, col))
    ohm = cell / max(damage.size, 1e-9)
    if damage.size == 0.0:
        last = [
            f"; {line_name(axis, line)} may be cut before it"
            for axis, line, k, end in ((0, row, col, circuit.cols), (1, col, row, circuit.rows))
            if k == end - 1
        ]
        return Finding(Kind.DEAD, **of, numbers={"usual": cell}, detail="".join(last))
    kind, form = (Kind.STUCK, "at the end" if ends else "")
    if ohm < _SHORT:
        kind, form = Kind.SHORT, "cell"
    return Finding(kind, form, **of, numbers={"ohm": ohm, "usual": cell})
