# SPDX-License-Identifier: Apache-2.0
"""The paper's literal equations (section IV-B), as the oracle of the forward model."""

import numpy as np
from scipy.optimize import brentq

DIODES = {  # saturation current [A], emission coefficient, ohm in series: of SPICE models
    "1N4148": (2.52e-9, 1.752, 0.568),
    "1N4007": (7.03e-9, 1.81, 0.034),
    "BAT85": (2.1e-7, 1.02, 2.0),
    "1N4001": (29.5e-9, 1.96, 0.0735),
    "BAV99": (4.6e-9, 1.9, 0.6),
    "BAT54": (1e-7, 1.0, 0.25),
    "1N5817": (31.7e-6, 1.373, 0.051),
}
_THERMAL = 0.02569  # V, k T / q at 25 degrees


def adc_ratio(resistance: np.ndarray, r_ref: float, r_par: float) -> np.ndarray:
    """ADC ratio of every crossing, one system of rows*cols + 1 equations each.

    Unknowns: the current through each cell, row to column, and the input current. Supply 1 V.
    """
    rows, cols = resistance.shape
    out = np.empty((rows, cols))
    for r in range(rows):
        for c in range(cols):
            matrix, right = system(resistance, r, c, r_ref + r_par)
            out[r, c] = np.linalg.solve(matrix, right)[-1] * r_ref
    return out


def system(resistance: np.ndarray, r: int, c: int, r_ext: float):
    """The equations for row r and column c connected: matrix (n, n), right-hand side (n,)."""
    rows, cols = resistance.shape
    n = rows * cols + 1
    cell = np.arange(rows * cols).reshape(rows, cols)
    equations = []

    def equation(*terms):
        line = np.zeros(n)
        for index, value in terms:
            line[index] += value
        equations.append(line)

    # loop through the supply, the external resistors and the selected cell
    equation((n - 1, r_ext), (cell[r, c], resistance[r, c]))
    # loops of the indirect paths: row r -> column l -> row k -> column c
    for k in range(rows):
        for m in range(cols):
            if k != r and m != c:
                equation(
                    (cell[r, m], resistance[r, m]),
                    (cell[k, m], -resistance[k, m]),
                    (cell[k, c], resistance[k, c]),
                    (cell[r, c], -resistance[r, c]),
                )
    # nodes: what flows into a row leaves it; one of all nodes is left out, column c
    for k in range(rows):
        equation(*[(cell[k, m], 1.0) for m in range(cols)], (n - 1, -1.0 if k == r else 0.0))
    for m in range(cols):
        if m != c:
            equation(*[(cell[k, m], 1.0) for k in range(rows)])
    right = np.zeros(n)
    right[0] = 1.0
    return np.stack(equations), right


def nodal_reading(resistance: np.ndarray, circuit, short=None) -> np.ndarray:
    """ADC ratio of every crossing of any readout, by Kirchhoff's node law; supply 1 V.

    Every line is a node, the divider's middle, the ground and the supply are others; each crossing
    is read by a solution of its own. An amplifier reads the current into the line that it holds.

    Args:
        short: (line, line, conductance) between two lines, rows first.
    """
    rows, cols = resistance.shape
    divider, ground, supply = rows + cols, rows + cols + 1, rows + cols + 2
    cell = np.isfinite(resistance)
    row, col = np.nonzero(cell)
    amplified = circuit.readout == "virtual_ground"
    ohm = resistance[cell] + (circuit.r_par if amplified else 0.0)
    wires = np.stack([row, rows + col, 1.0 / ohm], 1)  # node, node, conductance
    if short:
        wires = np.vstack([wires, short])
    drives, senses = np.arange(rows), np.arange(rows, rows + cols)
    if circuit.driven == "columns":
        drives, senses = senses, drives
    out = np.empty((rows, cols))
    for r, c in np.ndindex(rows, cols):
        drive, sense = (r, rows + c) if circuit.driven == "rows" else (rows + c, r)
        fixed, at = {ground: 0.0, supply: 1.0}, divider
        before, behind = (drive, supply), (sense, divider)
        if amplified:
            voltage = _voltages(wires, {drive: 1.0} | dict.fromkeys(senses, 0.0), supply + 1)
            into = (wires[:, :2] == sense).any(1)
            ends = wires[into][:, :2].astype(int)
            amperes = wires[into, 2] @ voltage[ends].sum(1)  # of the two ends one is at 0 V
            out[r, c] = min(circuit.r_ref * amperes, 1.0)
            continue
        if circuit.readout == "loaded":
            at, behind = sense, before
            more = [(line, ground, 1.0 / circuit.r_ref) for line in senses]
        else:
            held = drives if circuit.readout == "grounded" else ()
            more = [(divider, ground, 1.0 / circuit.r_ref)]
            if circuit.r_drive:
                ends = (supply if line == drive else ground for line in drives)
                more += [(*ends, 1.0 / circuit.r_drive) for ends in zip(drives, ends, strict=True)]
            else:
                fixed |= dict.fromkeys(held, 0.0) | {drive: 1.0}
            if circuit.readout == "grounded":  # all sense lines have a divider
                total = circuit.r_ref + circuit.r_par
                more += [(line, ground, 1.0 / total) for line in senses if line != sense]
        more.append((*behind, 1.0 / circuit.r_par))
        out[r, c] = _voltages(np.vstack([wires, more]), fixed, supply + 1)[at]
    return out


def _voltages(wires: np.ndarray, fixed: dict, nodes: int) -> np.ndarray:
    """Of each node, where those of some are fixed; 0 where nothing leads."""
    one, other = wires[:, :2].astype(int).T
    matrix = np.zeros((nodes, nodes))
    for a, b in ((one, other), (other, one)):
        np.add.at(matrix, (a, a), wires[:, 2])
        np.add.at(matrix, (a, b), -wires[:, 2])
    voltage, known = np.zeros(nodes), np.zeros(nodes, bool)
    known[list(fixed)] = True
    voltage[known] = [fixed[node] for node in np.flatnonzero(known)]
    free = ~known & (matrix.diagonal() > 0.0)
    right = -matrix[np.ix_(free, known)] @ voltage[known]
    voltage[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    return voltage


def forward_voltage(diode: str, amperes: float) -> float:
    """[V], by Shockley's law."""
    saturation, n, ohm = DIODES[diode]
    return n * _THERMAL * np.log1p(amperes / saturation) + ohm * amperes


def behind_diodes(ideal: np.ndarray, circuit, diode: str, supply: float) -> np.ndarray:
    """ADC ratio of a matrix that is driven through diodes: each operating point is found.

    Args:
        ideal: (rows, cols) of the same matrix without diodes; floating or loaded.
        supply: [V]
    """
    per_volt = ideal / circuit.r_ref  # A of the driven line for a volt behind its diode
    if circuit.readout == "loaded":
        across = 1 if circuit.driven == "rows" else 0
        per_volt = np.broadcast_to(per_volt.sum(across, keepdims=True), ideal.shape)
    of_current = {
        s: brentq(lambda v, s=s: v + forward_voltage(diode, s * v) - supply, 0.0, supply)
        for s in set(per_volt.ravel())
    }
    return ideal * np.vectorize(of_current.get)(per_volt) / supply


def transfer_resistance(k: np.ndarray, rows: int) -> np.ndarray:
    """t (cells, cells) [ohm] between two crossings, of K (lines, lines), written out."""
    unit = np.eye(len(k))
    ends = (unit[:rows, None] - unit[None, rows:]).reshape(-1, len(k))
    return ends @ k @ ends.T
