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
_DRIVER = 1e-3  # ohm of a driver that holds its line
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

    Args:
        conductance: (n, rows, cols) of the cells [S], 0 where there is none.
        circuit: as it truly is.
    """
    if circuit.readout == "floating":
        rho = between_leads(conductance, wiring)
        return circuit.r_ref / (circuit.r_ref + circuit.r_par + rho)
    return driven_ratio(conductance, wiring, circuit)


def between_leads(conductance: np.ndarray, wiring: Wiring) -> np.ndarray:
    """Resistance [ohm] between each row and column address with every other line floating.

    With the nodal matrix L of all stripes and severed parts, and K = (L + fill)^-1, where fill is a
    constant matrix (L is singular along the constant vector, which no difference of voltages sees):
    rho_ij = K_aa + K_bb - 2 K_ab for the nodes a and b that the addresses i and j select; infinite
    for an address that selects nothing. Conductance and result are (n, rows, cols).
    """
    nodal = nodal_matrix(conductance, wiring)
    every = np.arange(nodal.shape[1])
    fill = nodal[:, every, every].mean(1) / len(every)
    k = np.linalg.inv(nodal + fill[:, None, None])
    own = k[:, every, every]
    a, b = wiring.rows, wiring.stripes[0] + wiring.cols
    rho = own[:, a, None] + own[:, None, b] - 2.0 * k[:, a[:, None], b[None, :]]
    rho += wiring.row_lead[:, None] + wiring.col_lead
    rho[:, wiring.rows == NOWHERE] = np.inf
    rho[:, :, wiring.cols == NOWHERE] = np.inf
    return rho


def driven_ratio(conductance: np.ndarray, wiring: Wiring, circuit: Circuit) -> np.ndarray:
    """ADC ratio of a loaded or grounded matrix, by Kirchhoff's laws for all its nodes at once.

    An address that selects nothing reads 0, and drives nothing. As `voltage_ratio`.
    """
    nodal = nodal_matrix(conductance, wiring)
    cols = np.where(wiring.cols == NOWHERE, NOWHERE, wiring.cols + wiring.stripes[0])
    lines = (wiring.rows, wiring.row_lead), (cols, wiring.col_lead)
    (drive, before), (sense, behind) = lines if circuit.driven == "rows" else lines[::-1]
    grounded = circuit.readout == "grounded"
    r_ref = np.full(len(sense), circuit.r_ref)
    r_ref[list(wiring.bare)] = _INFINITE
    load = r_ref + behind + (circuit.r_par if grounded else 0.0)  # ohm
    _lead_to_ground(nodal, sense, 1.0 / load)
    if grounded:
        driver = max(circuit.r_drive, _DRIVER)
        _lead_to_ground(nodal, drive, 1.0 / (before + driver))
    k = np.linalg.inv(nodal)
    series = before + (driver if grounded else k[:, drive, drive] + circuit.r_par)  # ohm
    u = k[:, drive[:, None], sense] / np.broadcast_to(series, (len(k), len(drive)))[:, :, None]
    u *= r_ref / load
    u[:, drive == NOWHERE], u[:, :, sense == NOWHERE] = 0.0, 0.0
    return u if circuit.driven == "rows" else u.swapaxes(1, 2)


def _lead_to_ground(nodal: np.ndarray, nodes: np.ndarray, siemens: np.ndarray) -> None:
    there = nodes != NOWHERE  # several addresses may select one node
    every = np.arange(nodal.shape[1])
    nodal[:, every, every] += np.bincount(nodes[there], siemens[there], len(every))


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
