# SPDX-License-Identifier: Apache-2.0
"""One line is driven, an amplifier with feedback resistor r_ref holds each sense line at 0 V."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats, Floats32, Ints, Value
from .loaded import Loaded
from .readout import Late, Pair, Readout, blank

if TYPE_CHECKING:
    from ..circuit import Circuit

_HELD = 1e-6  # ohm by which an amplifier holds its line at 0 V


class VirtualGround(Readout):
    """Each reading is that of its own cell: adc = r_ref g / (1 + r_par g), as if with no end."""

    name = "virtual_ground"
    passive = False
    has_cross_talk = False

    def __init__(self, circuit: Circuit, g: Floats, derivatives: bool = True):
        behind = 1.0 + circuit.r_par * g
        self.adc = circuit.r_ref * g / behind
        self._own = circuit.r_ref / np.square(behind)
        self._r_ref = circuit.r_ref

    @property
    def own(self) -> Floats:
        return self._own

    @property
    def by_r_par(self) -> Floats:
        return np.square(self.adc) / -self._r_ref

    def change(self, p: Floats) -> Floats:
        return self._own * p

    def pull(self, w: Floats) -> Floats:
        return self._own * w

    def sensitivity(self, weight: Floats, readings: Ints, one: Ints, other: Ints) -> Floats32:
        row, col = np.divmod(readings, weight.shape[1])
        of_cell = (row[:, None] == one) & (col[:, None] + len(weight) == other)
        weight = (weight * self._own).ravel()[readings]
        slopes: Floats32 = (of_cell * weight[:, None]).astype(np.float32)
        return slopes

    def cells_for(self, cells: Ints, b: Floats) -> Floats:
        picture = np.zeros(self.adc.shape)
        own = self._own.flat[cells]
        picture.flat[cells] = np.divide(b.flat[cells], own, out=np.zeros(own.size), where=own > 0.0)
        return picture

    def readings_for(self, cells: Ints, b: Floats) -> Floats:
        return self.cells_for(cells, b)

    @classmethod
    def of_network(
        cls,
        circuit: Circuit,
        laplacian: Floats,
        lines: tuple[Ints, Ints],
        leads: Pair,
        r_ref: Floats,
    ) -> Floats:
        """Return (..., rows, cols) the ADC ratio; r_par lies in series with each crossing."""
        held = np.full(len(r_ref), _HELD)
        volts = Loaded.of_network(replace(circuit, r_par=0.0), laplacian, lines, leads, held)
        with np.errstate(divide="ignore"):
            ohm = _HELD / volts + circuit.r_par  # of a supply of 1 V
            adc = np.minimum((r_ref[:, None] if circuit.driven == "columns" else r_ref) / ohm, 1.0)
        return blank(adc, lines)

    @classmethod
    def sharing(cls, circuit: Circuit, cells: float, picture: Floats | None) -> float:
        return 1.0

    @classmethod
    def apparent(cls, circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
        """Return scale and offset [ohm] of readings as the cells' resistances."""
        return 1.0, circuit.r_par

    @classmethod
    def closed_form(
        cls, circuit: Circuit, adc: Floats, rho: Floats, bounds: Pair, target: float, late: Late
    ) -> tuple[Floats, int, bool]:
        return cls.guess(circuit, adc, rho, bounds), 0, True

    @classmethod
    def ratio(cls, circuit: Circuit, rho: Value) -> Value:
        with np.errstate(divide="ignore"):
            ratio: Value = np.minimum(np.divide(circuit.r_ref, circuit.r_par + rho), 1.0)
        return ratio

    @classmethod
    def in_series(cls, circuit: Circuit) -> float:
        return circuit.r_par
