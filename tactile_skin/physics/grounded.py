# SPDX-License-Identifier: Apache-2.0
"""The cells of a grounded matrix from its readings, in closed form (docs/derivation.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from . import readouts
from .arrays import Floats
from .circuit import Circuit

BOUND = 1.0 + 1e-9  # factor within which a conductance is on a bound, but for rounding
# Share of the supply by which the voltage of a driven line may be off:
FAST = 2.5e-4  # a quarter of a step of 10 bits
EXACT = 1e-9  # so little that no cell is off by 1e-3 g
_STEPS = 60  # for drivers that are not ideal; 5 to 20 are usual at 25 ohm
_CONVERGED = 1e-3  # share of the supply, of the best step, from which on the residual decides
_PATIENCE = 4  # steps that move it no less: a cell that comes to its bound moves others by a little


def closed_form(
    circuit: Circuit,
    adc: Floats,
    low: Floats,
    high: Floats,
    target: float = EXACT,
    late: Callable[[], bool] = lambda: False,
) -> tuple[Floats, int, bool]:
    """Conductance [S], steps for its drivers, and whether these sufficed.

    While line i is driven the sense lines' voltages V_ij are measured, and those of the driven
    lines follow from them and g: W_ik = (S [i = k] + sum_j g_kj V_ij) / (S + sum_j g_kj), with S =
    1 / r_drive. V is linear in W, and W^-1 V is what ideal drivers would leave of it.

    Args:
        adc: (rows, cols) ADC ratio, all of them read.
        low, high: (rows, cols) between which the conductances are [S].
        target: share of the supply by which the last step may move a driven line.
        late: whether there is no time for another step.
    """
    if circuit.has_ideal_drivers:
        return _by_ideal_drivers(circuit, adc, low, high), 0, True
    turned, total = circuit.driven == "columns", (circuit.r_ref + circuit.r_par) / circuit.r_ref
    v = total * (adc.T if turned else adc)
    held = np.eye(len(v)) / circuit.r_drive  # S
    ideal, w = replace(circuit, r_drive=0.0), held * circuit.r_drive
    least, at, best = np.inf, 0, w
    for step in range(1, _STEPS + 1):
        shown = np.clip(np.linalg.solve(w, v) / total, 0.0, 1.0)
        g = _by_ideal_drivers(ideal, shown.T if turned else shown, low, high)
        cells = g.T if turned else g
        new = (held + v @ cells.T) / (1.0 / circuit.r_drive + cells.sum(1))
        moved, w = np.abs(new - w).max(), new
        if moved < least:
            least, at, best = moved, step, g
        if moved < target or step - at > _PATIENCE or late():
            break
    return best, step, bool(least < _CONVERGED)


def within_bounds(circuit: Circuit, adc: Floats, low: Floats, high: Floats) -> Floats:
    """Conductance [S] as if the drivers were ideal; cells are held within their bounds.

    With v = adc (r_ref + r_par) / r_ref, a sense line's cells have g = v G / (1 - sum v), where G
    is what leads from it to ground: its divider, and the cells that are held.
    """
    divider, axis = circuit.r_ref + circuit.r_par, circuit.sense_axis
    v = adc * (divider / circuit.r_ref)
    free, held = circuit.populated, np.zeros(circuit.shape)
    ground: Floats | float = 1.0 / divider
    while True:  # each round holds more cells
        left = np.maximum(1.0 - (v * free).sum(axis, keepdims=True), readouts.LEAST_SCALE)
        g = np.where(free, v * ground / left, held)
        inside = np.minimum(np.maximum(g, low), high)
        out = free & (np.abs(inside - g) > (BOUND - 1.0) * g)
        if not np.count_nonzero(out):
            return g
        free, held = free & ~out, np.where(out, inside, held)
        ground = 1.0 / divider + held.sum(axis, keepdims=True)


def _by_ideal_drivers(circuit: Circuit, adc: Floats, low: Floats, high: Floats) -> Floats:
    """Conductance [S], whose bounds all of a sense line share.

    Hard loads leave nothing but noise of 1 - sum v, and cells beyond their end. With T for all that
    leads to the line, from which n cells at g = v T are not at rest, the largest is then put on its
    end, T = (n end + G) / (1 + sum (max v - v)), and all n readings miss alike.
    """
    g, axis = within_bounds(circuit, adc, low, high), circuit.sense_axis
    at_end = g >= high
    if not np.count_nonzero(at_end):
        return g
    beyond = at_end.any(axis, keepdims=True) & circuit.populated
    divider = circuit.r_ref + circuit.r_par
    free, v = g > low, adc * (divider / circuit.r_ref)
    ground = 1.0 / divider + (g * ~free).sum(axis, keepdims=True)
    n, used = free.sum(axis, keepdims=True), v * free
    left = 1.0 - used.sum(axis, keepdims=True)
    end = n * high.min(axis, keepdims=True) + ground
    leads = end / (left + n * used.max(axis, keepdims=True))
    spread = v * leads + (left * leads - ground) / np.maximum(n, 1)
    return np.where(beyond & free, np.minimum(np.maximum(spread, low), high), g)
