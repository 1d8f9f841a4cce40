# SPDX-License-Identifier: Apache-2.0
"""One line is driven, each sense line has its reference resistor, other driven lines are at 0 V."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Bools, Floats
from .driven import DRIVER, LEAST_SCALE, Driven
from .readout import BOUND, Late, Pair

if TYPE_CHECKING:
    from ..circuit import Circuit

# Of drivers that are not ideal:
_STEPS = 60  # 5 to 20 are usual at 25 ohm
_CONVERGED = 1e-3  # share of the supply, of the best step, from which on the residual decides
_PATIENCE = 4  # steps that move it no less: a cell that comes to its bound moves others by a little


class Grounded(Driven):
    """All driven lines are held behind r_drive; the cells follow in closed form."""

    name = "grounded"
    shares_sum = True
    knows_r_drive = True
    second = "r_drive"

    def _drive_lines(self, circuit: Circuit) -> None:
        if circuit.r_drive:
            self._of_inverse(self._inverse(1.0 / circuit.r_drive), circuit.r_drive)
        else:
            self._at_sense = ends = 1.0 / (1.0 / self._load + self._g.sum(0))
            self._v = self._g * ends
            self._p = np.concatenate([np.eye(self._rows), self._v], 1)
            self._k = np.concatenate([np.zeros((len(ends), self._rows)), np.diag(ends)], 1)

    @property
    def by_r_par(self) -> Floats:
        back = self._v @ self._k[:, self._rows :]  # what is left by the other sense lines, too
        return self._turn(self._s / self._load * (back / self._load - self._v))

    @property
    def by_second(self) -> Floats:
        """Each driver's current, times what a volt behind that driver makes of the readings."""
        currents = -self._p[:, self._rows :] @ self._g.T
        currents += self._p[:, : self._rows] * self._g.sum(1)
        return self._turn(-self._s * currents @ self._v)

    @classmethod
    def _before_r_ref(cls, circuit: Circuit) -> float:
        return circuit.r_par

    @classmethod
    def _to_idle(cls, circuit: Circuit, before: Floats) -> Floats:
        return 1.0 / (before + max(circuit.r_drive, DRIVER))

    @classmethod
    def _from_supply(cls, circuit: Circuit, before: Floats, own: Floats) -> Floats:
        return before + max(circuit.r_drive, DRIVER)

    @classmethod
    def apparent(cls, circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
        """Return scale and offset [ohm] of readings as cells' resistances, of ideal drivers."""
        total = (circuit.r_ref + circuit.r_par) / circuit.r_ref
        used = total * adc.sum(circuit.sense_axis - 2, keepdims=True)
        return np.maximum(1.0 - used, LEAST_SCALE), 0.0

    @classmethod
    def guess(cls, circuit: Circuit, adc: Floats, rho: Floats, bounds: Pair) -> Floats:
        """Return the solution, if the drivers are ideal and noise is small."""
        return _within_bounds(circuit, adc, bounds)

    @classmethod
    def closed_form(
        cls, circuit: Circuit, adc: Floats, rho: Floats, bounds: Pair, target: float, late: Late
    ) -> tuple[Floats, int, bool]:
        """Return the cells by the driven lines' voltages, and those by the cells, in turns.

        While line i is driven the sense lines' voltages V_ij are measured, and those of the driven
        lines follow from them and g: W_ik = (S [i = k] + sum_j g_kj V_ij) / (S + sum_j g_kj), with
        S = 1 / r_drive. V is linear in W, and W^-1 V is what ideal drivers would leave of it. Where
        there is no cell and nothing was read, V is what W makes of the cells.
        """
        if circuit.has_ideal_drivers:
            return _by_ideal_drivers(circuit, adc, bounds), 0, True
        turned, total = circuit.driven == "columns", (circuit.r_ref + circuit.r_par) / circuit.r_ref
        v = total * (adc.T if turned else adc)
        unread = (v == 0.0) & ~(circuit.populated.T if turned else circuit.populated)
        held = np.eye(len(v)) / circuit.r_drive  # S
        w = held * circuit.r_drive
        least, at, best = np.inf, 0, w
        for step in range(1, _STEPS + 1):
            ideal = np.linalg.solve(w, v)
            shown = np.minimum(ideal / total, 1.0)
            g = _by_ideal_drivers(circuit, shown.T if turned else shown, bounds)
            cells = g.T if turned else g
            new = (held + v @ cells.T) / (1.0 / circuit.r_drive + cells.sum(1))
            moved, w = np.abs(new - w).max(), new
            v = np.where(unread, w @ (ideal * (cells > 0.0)), v)
            if moved < least:
                least, at, best = moved, step, g
            if moved < target or step - at > _PATIENCE or late():
                break
        return best, step, bool(least < _CONVERGED)


def _within_bounds(circuit: Circuit, adc: Floats, bounds: Pair) -> Floats:
    """Conductance [S] as if the drivers were ideal; cells are held within their bounds.

    With v = adc (r_ref + r_par) / r_ref, a sense line's cells have g = v G / (1 - sum v), where G
    is what leads from it to ground: its divider, and the cells that are held.
    """
    divider, axis = circuit.r_ref + circuit.r_par, circuit.sense_axis
    v = adc * (divider / circuit.r_ref)
    free, held = circuit.populated, np.zeros(circuit.shape)
    ground: Floats | float = 1.0 / divider
    while True:  # each round holds more cells
        left = np.maximum(_left(circuit, v, free), LEAST_SCALE)
        g = np.where(free, v * ground / left, held)
        inside = np.minimum(np.maximum(g, bounds[0]), bounds[1])
        out = free & (np.abs(inside - g) > (BOUND - 1.0) * g)
        if not np.count_nonzero(out):
            return g
        free, held = free & ~out, np.where(out, inside, held)
        ground = 1.0 / divider + held.sum(axis, keepdims=True)


def _left(circuit: Circuit, v: Floats, free: Bools) -> Floats:
    """Return 1 - sum v of each sense line over its free cells.

    Without a cell, v is noise if the drivers are ideal. Those that yield put a voltage there, which
    belongs to the sum: cells of a tenth of the load would fit without.
    """
    counted = free | ~circuit.populated if circuit.r_drive else free
    left: Floats = 1.0 - (v * counted).sum(circuit.sense_axis, keepdims=True)
    return left


def _by_ideal_drivers(circuit: Circuit, adc: Floats, bounds: Pair) -> Floats:
    """Conductance [S], whose bounds all of a sense line share.

    Hard loads leave nothing but noise of 1 - sum v, and cells beyond their end. With T for all that
    leads to the line, from which n cells at g = v T are not at rest, the largest is then put on its
    end, T = (n end + G) / (1 + sum (max v - v)), and all n readings miss alike.
    """
    g, axis, (low, high) = _within_bounds(circuit, adc, bounds), circuit.sense_axis, bounds
    at_end = g >= high
    if not np.count_nonzero(at_end):
        return g
    beyond = at_end.any(axis, keepdims=True) & circuit.populated
    divider = circuit.r_ref + circuit.r_par
    free, v = g > low, adc * (divider / circuit.r_ref)
    ground = 1.0 / divider + (g * ~free).sum(axis, keepdims=True)
    n, used, left = free.sum(axis, keepdims=True), v * free, _left(circuit, v, free)
    end = n * high.min(axis, keepdims=True) + ground
    leads = end / (left + n * used.max(axis, keepdims=True))
    spread = v * leads + (left * leads - ground) / np.maximum(n, 1)
    return np.where(beyond & free, np.minimum(np.maximum(spread, low), high), g)
