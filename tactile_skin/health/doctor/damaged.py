# SPDX-License-Identifier: Apache-2.0
"""Findings of damaged wires and cells.

A check is a function in `CHECKS`: what is recorded, and (axis, line) of lines that earlier ones
found unusable -> findings.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...calibration.at_rest import address_bits
from ...findings.finding import Finding, Kind, at, lines, place
from ...physics.circuit import Circuit
from . import readings
from .recorded import Recorded
from .wiring import Damage

# Ohm of a crossing, below which it is no pressed cell but a short: one of 1 ohm seems to have up to
# 40 where r_ref or r_par is 10 % off.
_SHORT = 60.0

Check = Callable[[Recorded, set[tuple[int, int]]], list[Finding]]
CHECKS: list[Check] = [readings.open_lines, readings.loose_lines, readings.noisy]


def whole_lines(finding: Finding) -> set[tuple[int, int]]:
    """Return (axis, line) of each line that a finding is about; none if it is about a cell."""
    if finding.rows and finding.cols:
        return set()
    return {(0, k) for k in finding.rows} | {(1, k) for k in finding.cols}


def doubled(axis: int, count: int, pairs: list[tuple[int, int]]) -> list[Finding]:
    """Return stuck address bits of `count` lines, or the pairs of which one line is read twice."""
    if not (bits := address_bits(pairs, count)):
        return [Finding(Kind.DOUBLED, **lines(axis, *pair)) for pair in pairs]
    name, every, found = ("rows", "columns")[axis], lines(axis, *range(count)), []
    for bit in bits:
        alike = ", ".join(f"{a} and {b}" for a, b in pairs if a ^ b == 1 << bit)
        numbers, detail = {"bit": bit}, f"{name} {alike}"
        found.append(Finding(Kind.DOUBLED, "address bit", **every, numbers=numbers, detail=detail))
    return found


def damage(circuit: Circuit, damage: Damage, cell: float, ends: bool = False) -> Finding:
    """Return the finding of a damage.

    Args:
        cell: resistance of an untouched cell [ohm].
        ends: whether the cell's reading is at the ceiling.
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
    if damage.size == 0.0:
        cut = [place((row,), ())] * (col == circuit.cols - 1)
        cut += [place((), (col,))] * (row == circuit.rows - 1)
        detail = "".join(f"; {line} may be cut before it" for line in cut)
        return Finding(Kind.DEAD, **of, numbers={"usual": cell}, detail=detail)
    numbers = {"ohm": cell / damage.size, "usual": cell}
    if numbers["ohm"] < _SHORT:
        return Finding(Kind.SHORT, "cell", **of, numbers=numbers)
    return Finding(Kind.STUCK, "at the end" if ends else "", **of, numbers=numbers)
