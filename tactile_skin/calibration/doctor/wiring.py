"""Which damage of wires and cells explains what an untouched skin reads.

The fabric's cells are alike but for their scatter. A model of the wiring with equal cells is
compared with the readings; the one damage that explains most of the difference is added to it, and
the search goes on with what is left, until nothing exceeds the scatter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...physics.circuit import Circuit

_TIE = 1e3  # times a cell's conductance, between two stripes that touch: more than a line has
_INSULATION = 1e-7  # of a cell's conductance, between parts that nothing connects
_LEAST_SCATTER = 0.002, 0.003  # log of a reading's resistance, at least: of cells, of lines
_GAIN = 60.0  # chi^2 that a damage explains at least
_LIKELY = 0.5  # share of a line's, or a cell's, misfit that it explains at least
_LEAST_LEAD = 0.03  # share of the usual resistance that a bad lead adds at least
_OF_MEDIAN = 1.25  # standard deviation of a median over that of a mean
_DEAD, _PRESSED = 0.35, 4.0  # times the usual cell's conductance, below and above
_SHORTED = 1000.0  # times the same, of a crossing that is shorted
_MOST = 6  # damages that are looked for
_TRIED = 4  # lines, and cells, that are looked at in each turn


class Damage(NamedTuple):
    """Attributes:
    kind: "lead" (size: ohm), "broken" (at: first crossing that is cut off), or "cell" (line, at:
        row, column; size: times the usual cell's conductance).
    std: of a lead's size [ohm], as lines and their readings scatter.
    """

    kind: str
    axis: int
    line: int
    at: int
    size: float
    gain: float
    std: float = 0.0


@dataclass
class Wires:
    """A wiring of cells that are all alike.

    Attributes:
        cells: (rows, cols) conductance of each, the usual one 1.
        joined: (axis, line, line) pairs that touch.
        reads: for rows and columns, which line each address selects.
        cut: (axis, line, first crossing behind the cut).
        lead: for rows and columns, what each lead adds, in units of the usual cell's resistance.
    """

    cells: np.ndarray
    joined: list = field(default_factory=list)
    reads: list = field(default_factory=list)
    cut: list = field(default_factory=list)
    lead: list = field(default_factory=list)

    @classmethod
    def sound(cls, circuit: Circuit) -> Wires:
        cells = circuit.populated.astype(float)
        return cls(
            cells,
            reads=[np.arange(n) for n in circuit.shape],
            lead=[np.zeros(n) for n in circuit.shape],
        )

    def resistance(self) -> np.ndarray:
        """(rows, cols) between two leads, all others open; the usual cell's is 1."""
        rows, cols = self.cells.shape
        on_row, on_col = np.indices(self.cells.shape)
        nodes = rows + cols
        on_col = on_col + rows
        for axis, line, at in self.cut:
            part = on_row[line, at:] if axis == 0 else on_col[at:, line]
            part[:] = nodes
            nodes += 1
        laplacian = np.zeros((nodes, nodes))
        g = self.cells + _INSULATION
        np.add.at(laplacian, (on_row, on_col), -g)
        laplacian += laplacian.T
        for axis, a, b in self.joined:
            a, b = a + axis * rows, b + axis * rows
            laplacian[[a, b], [b, a]] -= _TIE
        laplacian[np.diag_indices(nodes)] = -laplacian.sum(1)
        k = np.linalg.inv(laplacian + 1.0 / nodes)
        own = k.diagonal()
        a, b = self.reads[0], rows + self.reads[1]
        rho = own[a][:, None] + own[b] - 2.0 * k[np.ix_(a, b)]
        return rho + self.lead[0][:, None] + self.lead[1]


def search(circuit: Circuit, rho: np.ndarray, known: np.ndarray, wires: Wires):
    """The damages that explain a rest.

    Args:
        rho: (rows, cols) two-terminal resistance that was measured [ohm].
        known: (rows, cols) bool, where it was.
        wires: what is known of the wiring; damages are added to it.

    Returns:
        The list of damages, and the usual cell's resistance [ohm].
    """
    found: list[Damage] = []
    while True:
        fit = _Fit(wires, rho, known)
        best = fit.best() if len(found) < _MOST else None
        if best is None:
            return found, fit.cell
        found = [d for d in found if not _same(d, best)] + [best]
        if best.kind == "lead":
            wires.lead[best.axis][best.line] += best.size / fit.cell
        elif best.kind == "broken":
            wires.cut.append((best.axis, best.line, best.at))
        else:
            wires.cells[best.line, best.at] = best.size


def _same(a: Damage, b: Damage) -> bool:
    return a.kind == b.kind == "cell" and (a.line, a.at) == (b.line, b.at)


class _Fit:
    """The measured rest beside a wiring's."""

    def __init__(self, wires: Wires, rho: np.ndarray, known: np.ndarray):
        self.wires, self.known, self.measured = wires, known, rho
        self.model = wires.resistance()
        log = np.where(known, np.log(np.maximum(rho, 1.0) / self.model), np.nan)
        level = float(np.nanmedian(log))
        self.cell = float(np.exp(level))  # ohm
        self.off = log - level
        self.row, self.col, self.left = _polished(self.off)
        self.scatter = max(1.48 * np.nanmedian(np.abs(self.left)), _LEAST_SCATTER[0])
        self.of_lines = [
            max(1.48 * float(np.nanmedian(np.abs(e - np.nanmedian(e)))), _LEAST_SCATTER[1])
            for e in (self.row, self.col)
        ]

    def best(self) -> Damage | None:
        found = [*self._lines(), *self._cells()]
        best = max(found, key=lambda d: d.gain, default=None)
        return best if best is not None and best.gain > _GAIN else None

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
        model = self.model if axis == 0 else self.model.T
        # What a lead adds is the same in all readings of the line; what one more adds is log-like.
        added = np.nanmedian(model[line] * np.expm1(off))
        # Two stripes that touch read half as much: there another r_par, r_ref or supply shows, too.
        joined = any(a == axis and line in pair for a, *pair in self.wires.joined)
        if added > _LEAST_LEAD * np.median(model[line]) and not joined:
            with_lead = np.log1p(added / model[line])
            gain = before - self._cost(axis, off - with_lead)
            if gain > _LIKELY * before:
                n = np.count_nonzero(np.isfinite(off))
                log = np.hypot(self.of_lines[axis], _OF_MEDIAN * self.scatter / n**0.5)
                std = float(log * np.median(model[line]) * self.cell)
                yield Damage("lead", axis, line, -1, float(added * self.cell), gain, std)
        cells = self.wires.cells if axis == 0 else self.wires.cells.T
        if cells[line].max() > _SHORTED:  # the rest of the line says nothing beside a short
            return
        crossings = np.flatnonzero(cells[line] > 0.0)
        for at in crossings[1:-1]:  # a cut before the last cell reads like a dead cell
            cut = Wires(
                self.wires.cells,
                self.wires.joined,
                self.wires.reads,
                [*self.wires.cut, (axis, line, int(at))],
                self.wires.lead,
            ).resistance()
            cut = cut if axis == 0 else cut.T
            gain = before - self._cost(axis, off - np.log(cut[line] / model[line]))
            if gain > _LIKELY * before:
                yield Damage("broken", axis, line, int(at), 0.0, gain)

    def _cells(self):
        """Cells that conduct much less or more than the others."""
        off = np.where(self.wires.cells > 0.0, np.nan_to_num(self.left), 0.0)
        own = np.nan_to_num(np.square(self.off))
        for pick in (np.argsort(-np.abs(off), axis=None), np.argsort(-own, axis=None)):
            for k in pick[:_TRIED]:
                row, col = np.unravel_index(k, off.shape)
                if self.known[row, col] and self.wires.cells[row, col] > 0.0:
                    yield from self._of_cell(int(row), int(col))

    def _of_cell(self, row: int, col: int):
        g, model = self.wires.cells[row, col], self.model[row, col]
        measured = self.measured[row, col] / self.cell
        size = max(g + 1.0 / max(measured, 1e-4) - 1.0 / model, 0.0)
        if _DEAD < size < _PRESSED:
            return
        size = 0.0 if size < _DEAD else size
        cells = self.wires.cells.copy()
        cells[row, col] = size
        now = Wires(
            cells, self.wires.joined, self.wires.reads, self.wires.cut, self.wires.lead
        ).resistance()
        after = self.off - np.log(now / self.model)
        after -= np.nanmedian(after)
        before = self._around(self.off, row, col)
        gain = before - self._around(after, row, col)
        if gain > _LIKELY * before or self._alone(row, col, after, gain):
            yield Damage("cell", 0, row, col, size, gain)

    def _around(self, off: np.ndarray, row: int, col: int) -> float:
        """chi^2 of a cell's row and column."""
        return self._cost(0, off[row] - self.col) + self._cost(1, off[:, col] - self.row)

    def _alone(self, row: int, col: int, after: np.ndarray, gain: float) -> bool:
        """Whether the cell's own reading, of all on its lines, is what the change explains."""
        return (
            abs(self.left[row, col]) > 6.0 * self.scatter
            and gain > _GAIN
            and bool(
                abs(after[row, col] - self.row[row] - self.col[col])
                < 0.5 * abs(self.left[row, col])
            )
        )


def _polished(off: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Medians of rows, of columns, and what is left of a picture with NaN."""
    row, col = np.zeros(off.shape[0]), np.zeros(off.shape[1])
    with np.errstate(all="ignore"):
        for _ in range(3):
            row = np.nan_to_num(_median(off - col, 1))
            col = np.nan_to_num(_median(off - row[:, None], 0))
    return row, col, off - row[:, None] - col


def _median(values: np.ndarray, axis: int) -> np.ndarray:
    """Median along an axis; 0 where there is no value."""
    empty = np.isnan(values).all(axis, keepdims=True)
    return np.nanmedian(np.where(empty, 0.0, values), axis=axis)
