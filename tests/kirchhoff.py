"""The paper's literal equations (section IV-B), as the oracle of the forward model."""

import numpy as np


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
