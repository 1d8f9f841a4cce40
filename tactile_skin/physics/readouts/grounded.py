# SPDX-License-Identifier: Apache-2.0
"""One line is driven, each sense line has its reference resistor, other driven lines are at 0 V."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats
from .driven import DRIVER, LEAST_SCALE, Driven

if TYPE_CHECKING:
    from ..circuit import Circuit


class Grounded(Driven):
    """All driven lines are held behind r_drive; ../grounded.py has its inverse."""

    name = "grounded"
    has_closed_form = True
    knows_r_drive = True

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
    def by_r_drive(self) -> Floats:
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
