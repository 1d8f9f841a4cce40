# SPDX-License-Identifier: Apache-2.0
"""One row is driven, one column is read, all other lines are open: the paper's board."""

from __future__ import annotations

import math
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .. import compiled, laplacian, lines
from ..arrays import Floats, Floats32, Ints
from .readout import Pair, Readout, blank

if TYPE_CHECKING:
    from ..circuit import Circuit

_TARGET = 1e-6  # share of the right side that they leave: single precision


class Floating(Readout):
    """All follows from two-terminal resistances rho: d rho_a / d g_b = -t_ab^2."""

    name = "floating"
    two_terminal = True
    knows_r_line = True
    takes_diodes = True

    def __init__(self, circuit: Circuit, g: Floats, derivatives: bool | laplacian.Network = True):
        if derivatives:  # or what they follow from
            known = derivatives if isinstance(derivatives, laplacian.Network) else None
            self.inverse = known or laplacian.solve(g)
            self.rho = self.inverse.rho
        else:
            self.rho = laplacian.connected_rho(g)
        self.adc = circuit.ratio(self.rho)
        self._circuit, self._g = circuit, g

    def behind_stripes(self, further: Floats) -> Floating:
        stripes = self._circuit.stripes
        if stripes is None:
            return self
        other = copy(self)
        other.__dict__.pop("_slope", None)
        added = lines.added_resistance(self.inverse.k, self._g, *stripes)
        other.adc = self._circuit.ratio(self.rho + (added + further))
        return other

    @cached_property
    def _slope(self) -> Floats:
        """- d adc / d rho [1/ohm]."""
        slope = self.adc * self.adc
        slope /= self._circuit.r_ref
        return slope

    @property
    def own(self) -> Floats:
        return self.rho * self.rho * self._slope

    @property
    def by_r_par(self) -> Floats:
        return -self._slope

    @property
    def by_second(self) -> Floats:
        unit = (np.ones(n) for n in self._g.shape)
        return self.by_r_par * lines.added_resistance(self.inverse.k, self._g, *unit)

    def change(self, p: Floats) -> Floats:
        return self._slope * laplacian.hessian_product(self.inverse.k, p)

    def pull(self, w: Floats) -> Floats:
        return laplacian.hessian_product(self.inverse.k, w * self._slope)

    def sensitivity(self, weight: Floats, readings: Ints, one: Ints, other: Ints) -> Floats32:
        return laplacian.sensitivity(self.inverse.k, weight * self._slope, readings, one, other)

    def information(self, weight: Floats, scale: Floats, cells: Ints) -> Floats32 | None:
        return compiled.information(self.inverse.k, weight, self._slope, scale, cells)

    def cells_for(self, cells: Ints, b: Floats) -> Floats:
        return self._solve(cells, b / self._slope)

    def readings_for(self, cells: Ints, b: Floats) -> Floats:
        return self._solve(cells, b) / self._slope

    def _solve(self, cells: Ints, b: Floats) -> Floats:
        """t_ab^2 x_b = b_a, without the matrix."""
        picture = np.zeros(self.adc.shape)
        solve = laplacian.hessian_solver(self.inverse, self._g, cells, _TARGET)
        picture.flat[cells] = solve(b.flat[cells])
        return picture

    @classmethod
    def of_network(
        cls,
        circuit: Circuit,
        laplacian: Floats,
        lines: tuple[Ints, Ints],
        leads: Pair,
        r_ref: Floats,
    ) -> Floats:
        fill = laplacian.diagonal(axis1=-2, axis2=-1).mean(-1) / laplacian.shape[-1]
        k = np.linalg.inv(laplacian + fill[..., None, None])
        (a, b), own = lines, k.diagonal(axis1=-2, axis2=-1)
        rho = own[..., a, None] + own[..., None, b] - 2.0 * k[..., a[:, None], b]
        return blank(circuit.ratio(rho + leads[0][:, None] + leads[1]), lines)

    @classmethod
    def sharing(cls, circuit: Circuit, cells: float, picture: Floats | None) -> float:
        """By Foster's theorem it is g * rho = cells / (the touch's rows + its columns - 1)."""
        side = min(math.sqrt(cells), *circuit.shape)
        return cells / (side + cells / side - 1.0)

    @classmethod
    def apparent(cls, circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
        """Return scale and offset [ohm] of readings as two-terminal resistances."""
        return 1.0, cls.in_series(circuit)

    @classmethod
    def product(cls, circuit: Circuit) -> float:
        """Return what keeps Foster's sum: that of g * rho is rows + cols - 1."""
        return (sum(circuit.shape) - 1) / np.count_nonzero(circuit.populated)

    @classmethod
    def read(cls, circuit: Circuit, g: Floats) -> Floats:
        if circuit.stripes is None:
            return circuit.ratio(laplacian.two_terminal_resistance(g))
        return circuit.ratio(np.array([lines.solve(frame, *circuit.stripes) for frame in g]))
