# SPDX-License-Identifier: Apache-2.0
"""Kirchhoff's laws for any wiring of a matrix: damaged stripes, leads, multiplexers, resistors.

It shares no code with the solvers' `circuit`. The cells' currents i are the unknowns of a frame:
with B from cells to nodes, the cells' conductances G and the stripe resistance S that two cells
share, (1 + G S) i = G B v, so that L = B^T (1 + G S)^-1 G B is the nodal matrix of all stripes and
severed parts, at their leads. What else a board joins is added to L.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..physics.circuit import Circuit

NOWHERE = -1  # what an address selects when it selects no line
LEAKAGE = 1e-10  # S, of any insulator that is good enough: it keeps severed parts solvable
_INFINITE = 1e9  # ohm of what is not there: of an ADC's input, say


@dataclass
class Wiring:
    """How cells, stripes and multiplexers are joined; nodes are rows first, then columns."""

    # row_of, col_of: (rows, cols) stripe (or severed part) on which each cell hangs
    row_of: np.ndarray
    col_of: np.ndarray
    # rows, cols: stripe that each address of the multiplexer selects, or NOWHERE
    rows: np.ndarray
    cols: np.ndarray
    # row_lead, col_lead: resistance of each address's way to its stripe [ohm]
    row_lead: np.ndarray
    col_lead: np.ndarray
    # (kind a, index a, kind b, index b, S): conductances between two stripes, at their leads; kind
    # 0 is a row, 1 a column
    ties: list[tuple[int, int, int, int, float]] = field(default_factory=list)
    # sense addresses whose reference resistor is missing; not of floating matrices
    bare: set[int] = field(default_factory=set)
    stripe: float = 0.0  # resistance of a stripe from its lead to its far end [ohm]
    leakage: float = LEAKAGE  # between each row and each column, on top of the cells [S]

    @classmethod
    def sound(cls, rows: int, cols: int) -> Wiring:
        """Return the wiring of a matrix without damage."""
        row_of, col_of = np.indices((rows, cols))
        lines, leads = (np.arange(rows), np.arange(cols)), (np.zeros(rows), np.zeros(cols))
        return cls(row_of, col_of, *lines, *leads)

    @classmethod
    def ideal(cls, circuit: Circuit, stripe: float = 0.0) -> Wiring:
        """Return the same of a circuit, without leakage if each crossing has a cell."""
        leakage = 0.0 if circuit.populated.all() else LEAKAGE
        return replace(cls.sound(*circuit.shape), stripe=stripe, leakage=leakage)

    def addresses(self, axis: int) -> np.ndarray:
        """Return which stripe each address of the rows (0) or columns (1) selects."""
        return (self.rows, self.cols)[axis]

    def cut(self, axis: int, line: int, at: int) -> None:
        """Cut a stripe before its crossing `at`: its far part becomes a stripe of its own."""
        name = ("row_of", "col_of")[axis]
        of = getattr(self, name).copy()
        of.swapaxes(0, axis)[line, at:] = max(int(of.max()) + 1, len(self.addresses(axis)))
        setattr(self, name, of)

    @property
    def stripes(self) -> tuple[int, int]:
        """How many rows and columns there are, severed parts included."""
        of = (self.row_of, self.rows), (self.col_of, self.cols)
        rows, cols = (max(int(cells.max()), int(lines.max())) + 1 for cells, lines in of)
        return rows, cols


def voltage_ratio(conductance: np.ndarray, wiring: Wiring, circuit: Circuit) -> np.ndarray:
    """Return the ADC ratio (n, rows, cols) of a matrix of any readout.

    An address that selects nothing reads 0, and drives nothing.

    Args:
        conductance: (n, rows, cols) of the cells [S], 0 where there is none.
        circuit: as it truly is.
    """
    readout = circuit.readout_class
    if not readout.has_cross_talk:  # r_par lies in series with each cell
        conductance = conductance / (1.0 + circuit.r_par * conductance)
        circuit = replace(circuit, r_par=0.0)
    cols = np.where(wiring.cols == NOWHERE, NOWHERE, wiring.cols + wiring.stripes[0])
    r_ref = np.full(circuit.shape[1 - circuit.sense_axis], circuit.r_ref)
    r_ref[list(wiring.bare)] = _INFINITE
    lines, leads = (wiring.rows, cols), (wiring.row_lead, wiring.col_lead)
    return readout.of_network(circuit, nodal_matrix(conductance, wiring), lines, leads, r_ref)


def nodal_matrix(conductance: np.ndarray, wiring: Wiring) -> np.ndarray:
    """L of all stripes and severed parts, (n, nodes, nodes) [S], rows first."""
    n_rows, n_cols = wiring.stripes
    joined = np.full((len(conductance), n_rows, n_cols), wiring.leakage)
    if not wiring.stripe:
        joined[:, wiring.row_of, wiring.col_of] += conductance
    nodes = n_rows + n_cols
    nodal = np.zeros((len(conductance), nodes, nodes))
    nodal[:, :n_rows, n_rows:] = -joined
    nodal[:, n_rows:, :n_rows] = -joined.swapaxes(1, 2)
    for kind_a, a, kind_b, b, siemens in wiring.ties:
        a, b = a + kind_a * n_rows, b + kind_b * n_rows
        nodal[:, [a, b], [b, a]] -= siemens
    every = np.arange(nodes)
    nodal[:, every, every] = -nodal.sum(2)
    return nodal + _along_stripes(conductance, wiring) if wiring.stripe else nodal


def _along_stripes(conductance: np.ndarray, wiring: Wiring) -> np.ndarray:
    """L of the cells alone, (n, nodes, nodes) [S], each at its place on two resistive stripes."""
    rows, cols = conductance.shape[1:]
    stripes = wiring.row_of.ravel(), wiring.stripes[0] + wiring.col_of.ravel()
    cells, each = rows * cols, np.arange(rows * cols)
    incidence = np.zeros((cells, sum(wiring.stripes)))
    incidence[each, stripes[0]], incidence[each, stripes[1]] = 1.0, -1.0
    shared = np.zeros((cells, cells))  # ohm
    for of, length in zip(stripes, (cols, rows), strict=True):
        for stripe in np.unique(of):
            mine = np.flatnonzero(of == stripe)
            way = wiring.stripe / length * np.arange(1, len(mine) + 1)
            shared[np.ix_(mine, mine)] += np.minimum.outer(way, way)
    found = np.empty((len(conductance), *(incidence.shape[1],) * 2))
    for k, g in enumerate(conductance.reshape(-1, cells)):
        currents = np.linalg.solve(np.eye(cells) + g[:, None] * shared, g[:, None] * incidence)
        found[k] = incidence.T @ currents
    return found
