# SPDX-License-Identifier: Apache-2.0
"""Which damage of wires and cells explains what an untouched skin reads.

A model of the wiring with equal cells is compared with the readings; the one damage that explains
most of the difference is added to it, until what is left is the fabric's scatter.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri

from ...calibration.at_rest import address_bits
from ...calibration.rest import UNLIKE
from ...findings.finding import Finding, Kind, at, lines, place
from ...physics.circuit import Circuit

# Times the usual cell's conductance, of a short: at a crossing, or between two stripes that touch,
# where it is more than a line has.
_SHORTED = 1e3
_INSULATION = 1e-7  # of a cell's conductance, between parts that nothing connects
_LEAST_SCATTER = 0.003  # log of a reading's resistance, at least, of cells and of lines
_GAIN = 60.0  # chi^2 that a damage explains at least
_LIKELY = 0.5  # share of a line's, or a cell's, misfit that it explains at least
_LEAST_LEAD = 0.03  # share of the usual resistance that a bad lead adds at least
_OF_MEDIAN = (np.pi / 2.0) ** 0.5  # standard deviation of a median over that of a mean
_OF_DEVIATIONS = 1.0 / ndtri(0.75)  # standard deviation over the median deviation, normal values
_OHM = 100.0  # ohm of a lead by which readings are tried
_MISSING = 0.05  # share of its conductance up to which a resistor is missing
_ROUNDS = 12  # in which the usual cell's resistance is found
_MOST = 6  # damages that are looked for
_OF_SIZE = 1e-6  # share to which a cell's conductance is found
_TRIED = 4  # lines, and cells, that are looked at in each turn

# Ohm of a crossing, below which it is no pressed cell but a short: one of 1 ohm seems to have up to
# 40 where r_ref or r_par is 10 % off.
_SHORT = 60.0


class Damage(NamedTuple):
    """One damage of the wiring, or of a cell."""

    # "lead" (size: ohm more), "resistor" (size: its ohm, infinite if it is missing), "broken" (at:
    # first crossing that is cut off), or "cell" (line, at: row, column; size: times the usual
    # cell's conductance)
    kind: str
    axis: int
    line: int
    at: int
    size: float
    gain: float
    std: float = 0.0  # of a lead's size [ohm], as lines and their readings scatter


@dataclass
class Wires:
    """A wiring of cells that are all alike."""

    circuit: Circuit  # as it is supposed
    cells: np.ndarray  # (rows, cols) conductance of each, the usual one 1
    cell: float  # resistance of the usual one [ohm]
    r_ref: np.ndarray  # of each sense line [ohm], infinite where it is missing
    reads: list  # for rows and columns, which line each address selects; -1: none
    lead: list  # for rows and columns, what each lead adds [ohm]
    joined: list = field(default_factory=list)  # (axis, line, line) pairs that touch
    cut: list = field(default_factory=list)  # (axis, line, first crossing behind the cut)

    @classmethod
    def sound(cls, circuit: Circuit, cell: float) -> Wires:
        return cls(
            circuit,
            circuit.populated.astype(float),
            cell,
            np.full(circuit.shape[1 - circuit.sense_axis], circuit.r_ref),
            reads=[np.arange(n) for n in circuit.shape],
            lead=[np.zeros(n) for n in circuit.shape],
        )

    def with_one(self, damage: Damage) -> Wires:
        """Return the same wiring with one more damage."""
        axis, line, size = damage.axis, damage.line, damage.size
        if damage.kind == "cell":
            cells = self.cells.copy()
            cells[line, damage.at] = size
            return replace(self, cells=cells)
        if damage.kind == "broken":
            return replace(self, cut=[*self.cut, (axis, line, damage.at)])
        if damage.kind == "resistor":
            r_ref = self.r_ref.copy()
            r_ref[line] = size
            return replace(self, r_ref=r_ref)
        lead = [ohm.copy() for ohm in self.lead]
        lead[axis][line] += size
        return replace(self, lead=lead)

    def reading(self, axis: int, line: int, other: int) -> Wires:
        """Return the same where an address selects another line, or none, -1."""
        reads = [lines.copy() for lines in self.reads]
        reads[axis][line] = other
        return replace(self, reads=reads)

    def resistance(self) -> np.ndarray:
        """Return (rows, cols) [ohm] that a divider of r_ref and r_par would read so.

        It is the two-terminal resistance of a floating matrix.
        """
        rows, cols = self.cells.shape
        indices = np.indices(self.cells.shape)
        nodes = rows + cols
        on_row, on_col = indices[0], indices[1] + rows
        for axis, line, first in self.cut:
            part = on_row[line, first:] if axis == 0 else on_col[first:, line]
            part[:] = nodes
            nodes += 1
        laplacian = np.zeros((nodes, nodes))
        g = self.cells + _INSULATION
        np.add.at(laplacian, (on_row, on_col), -g)
        laplacian += laplacian.T
        for axis, a, b in self.joined:
            a, b = a + axis * rows, b + axis * rows
            laplacian[[a, b], [b, a]] -= _SHORTED
        laplacian[np.diag_indices(nodes)] = -laplacian.sum(1)
        of_rows, of_cols = self.reads
        lines = of_rows, np.where(of_cols < 0, of_cols, of_cols + rows)
        adc = self.circuit.readout_class.of_network(
            self.circuit, laplacian / self.cell, lines, self.lead, self.r_ref
        )
        return measured_resistance(self.circuit, adc)

    def fitted(self, rho: np.ndarray, known: np.ndarray) -> tuple[Wires, np.ndarray, np.ndarray]:
        """Return the same with the resistance of the usual cell that the readings give.

        Returns:
            It, its resistance() and (rows, cols) log of what is read over that, NaN: not known.
        """
        wires, model = self, self.resistance()
        for _ in range(_ROUNDS):
            off = np.where(known, np.log(rho / model), np.nan)
            level = float(np.nanmedian(off)) if known.any() else 0.0
            if abs(level) < 0.1 * _LEAST_SCATTER:
                break
            wires = replace(wires, cell=wires.cell * float(np.exp(level)))
            model = wires.resistance()
        return wires, model, off


def measured_resistance(circuit: Circuit, adc: np.ndarray) -> np.ndarray:
    """`Wires.resistance` of readings (rows, cols) [ADC ratio], half a step at least."""
    return np.maximum(circuit.two_terminal(np.maximum(adc, 0.5 / circuit.full_scale)), 1.0)


def search(circuit: Circuit, rho: np.ndarray, known: np.ndarray, wires: Wires):
    """Return the damages that explain a rest, and the wiring with them.

    Args:
        rho: (rows, cols) resistance that was measured, as `measured_resistance` [ohm].
        known: (rows, cols) bool, where it was.
        wires: what is known of the wiring.
    """
    found: list[Damage] = []
    while True:
        fit = _Fit(wires, rho, known)
        best = fit.best() if len(found) < _MOST else None
        if best is None:
            return found, fit.wires
        found = [d for d in found if d.kind != "cell" or d[:4] != best[:4]] + [best]
        wires = fit.wires.with_one(best)


class _Fit:
    """The measured rest beside a wiring's."""

    def __init__(self, wires: Wires, rho: np.ndarray, known: np.ndarray):
        self.known, self.measured = known, rho
        self.wires, self.model, self.off = wires.fitted(rho, known)
        self.row, self.col, self.left = _polished(self.off)
        self.scatter = max(_OF_DEVIATIONS * np.nanmedian(np.abs(self.left)), _LEAST_SCATTER)
        apart = [np.abs(of - np.median(of)) for of in (self.row, self.col)]
        self.of_lines = [max(_OF_DEVIATIONS * np.median(of), _LEAST_SCATTER) for of in apart]

    def best(self) -> Damage | None:
        found = [*self._lines(), *self._cells()]
        best = max(found, key=lambda d: d.gain, default=None)
        return best if best and best.gain > _GAIN else None

    def _cost(self, axis: int, off: np.ndarray) -> float:
        """chi^2 of a line's (n,) differences from the others: a common one, and one of each."""
        off = off[np.isfinite(off)]
        n, s2, c2 = len(off), self.scatter**2, self.of_lines[axis] ** 2
        total = off.sum()
        return float((off @ off - c2 / (s2 + n * c2) * total**2) / s2)

    def _lines(self):
        """Bad leads and cuts of the lines that differ most."""
        for axis in (0, 1):
            other = self.col if axis == 0 else self.row
            off = (self.off if axis == 0 else self.off.T) - other
            costs = np.array([self._cost(axis, line) for line in off])
            for line in np.argsort(costs)[::-1][:_TRIED]:
                if costs[line] < _GAIN:
                    break
                yield from self._of_line(axis, int(line), off[line], float(costs[line]))

    def _of_line(self, axis: int, line: int, off: np.ndarray, before: float):
        if any(c[:2] == (axis, line) for c in self.wires.cut):
            return  # the few cells before a cut scatter more
        model, cells = (of if axis == 0 else of.T for of in (self.model, self.wires.cells))
        # Two stripes that touch read half as much: there another r_par, r_ref or supply shows, too.
        joined = any(a == axis and line in pair for a, *pair in self.wires.joined)
        # Voltage over reading grows by what a lead adds, and with the conductance of its resistor,
        # in proportion.
        kinds = ("lead", "resistor") if self._has_resistor(axis, line) else ("lead",)
        for kind in () if joined else kinds:
            whole = Damage(kind, axis, line, -1, _OHM if kind == "lead" else np.inf, 0.0)
            slope = self._line(axis, line, self.wires.with_one(whole)) - model[line]
            told = np.isfinite(off) & (slope != 0.0)
            if not told.any():
                continue
            share = float(np.median((model[line] * np.expm1(off))[told] / slope[told]))
            added = np.median(slope) * share
            if share <= 0.0 or abs(added) < _LEAST_LEAD * np.median(model[line]):
                continue
            share = share if kind == "lead" else min(share, 1.0)
            reads = np.maximum(model[line] + share * slope, 1.0)
            gain = before - self._cost(axis, off - np.log(reads / model[line]))
            if gain <= _LIKELY * before:
                continue
            if kind == "resistor":
                left = 1.0 - share
                size = self.wires.r_ref[line] / left if left > _MISSING else np.inf
                yield whole._replace(size=size, gain=gain)
            else:
                n = np.count_nonzero(np.isfinite(off))
                log = np.hypot(self.of_lines[axis], _OF_MEDIAN * self.scatter / n**0.5)
                std = float(log * np.median(model[line]) * _OHM / np.median(slope))
                yield whole._replace(size=_OHM * share, gain=gain, std=std)
        if cells[line].max() > _SHORTED:  # the rest of the line says nothing beside a short
            return
        crossings = np.flatnonzero(cells[line] > 0.0)
        for first in crossings[1:-1]:  # a cut before the last cell reads like a dead cell
            damage = Damage("broken", axis, line, int(first), 0.0, 0.0)
            cut = self._line(axis, line, self.wires.with_one(damage))
            gain = before - self._cost(axis, off - np.log(cut / model[line]))
            if gain > _LIKELY * before:
                yield damage._replace(gain=gain)

    def _has_resistor(self, axis: int, line: int) -> bool:
        circuit = self.wires.circuit
        there = not circuit.readout_class.two_terminal and axis != circuit.sense_axis
        return there and np.isfinite(self.wires.r_ref[line])

    @staticmethod
    def _line(axis: int, line: int, wires: Wires) -> np.ndarray:
        resistance = wires.resistance()
        return resistance[line] if axis == 0 else resistance[:, line]

    def _cells(self):
        """Cells that conduct much less or more than the others."""
        off = np.where(self.wires.cells > 0.0, np.nan_to_num(self.left), 0.0)
        for k in np.argsort(-np.abs(off), axis=None)[:_TRIED]:
            row, col = np.unravel_index(k, off.shape)
            if self.known[row, col] and self.wires.cells[row, col] > 0.0:
                yield from self._of_cell(int(row), int(col))

    def _of_cell(self, row: int, col: int):
        damage = Damage("cell", 0, row, col, 0.0, 0.0)
        size = self._size(damage)
        if 1.0 / UNLIKE < size < UNLIKE:
            return
        damage = damage._replace(size=0.0 if size < 1.0 else size)
        now = self.wires.with_one(damage).resistance()
        after = self.off - np.log(now / self.model)
        after -= np.nanmedian(after)
        before = self._around(self.off, row, col)
        gain = before - self._around(after, row, col)
        if gain > _LIKELY * before:
            yield damage._replace(gain=gain)

    def _size(self, damage: Damage) -> float:
        """Return what a cell conducts at least, times the usual one, if it reads as it does."""
        cell, most = (damage.line, damage.at), 10.0 * _SHORTED

        def off(size: float) -> float:
            read = self.wires.with_one(damage._replace(size=size)).resistance()
            return float(np.log(read[cell] / self.measured[cell])) - _OF_SIZE

        if off(0.0) <= 0.0:
            return 0.0
        return float(brentq(off, 0.0, most, rtol=_OF_SIZE)) if off(most) < 0.0 else most

    def _around(self, off: np.ndarray, row: int, col: int) -> float:
        """chi^2 of a cell's row and column."""
        return self._cost(0, off[row] - self.col) + self._cost(1, off[:, col] - self.row)


def _polished(off: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Medians of rows, of columns, and what is left of a picture with NaN."""
    row, col = np.zeros(off.shape[0]), np.zeros(off.shape[1])
    for _ in range(3):
        row = _median(off - col, 1)
        col = _median(off - row[:, None], 0)
    return row, col, off - row[:, None] - col


def _median(values: np.ndarray, axis: int) -> np.ndarray:
    """Median along an axis; 0 where there is no value."""
    empty = np.isnan(values).all(axis, keepdims=True)
    return np.nanmedian(np.where(empty, 0.0, values), axis=axis)


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


def finding_of(circuit: Circuit, damage: Damage, cell: float, ends: bool = False) -> Finding:
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
