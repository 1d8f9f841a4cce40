# SPDX-License-Identifier: Apache-2.0
"""What every readout answers: a class for each, of which an object is the network of one frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from ..arrays import Floats, Floats32, Ints, Value

if TYPE_CHECKING:
    from ..circuit import Circuit

Pair: TypeAlias = Sequence[Floats]  # of rows and of columns


class Readout(ABC):
    """The network of one frame; adc_a is the reading of crossing a, g_b the conductance of cell b.

    Args:
        circuit: whose readout this is.
        g: (rows, cols) cells [S], 0 where there is none; if floating, of a connected network,
            which is not checked.
        derivatives: whether others than `own` and `by_r_par` will be asked for.

    Attributes:
        adc: (rows, cols) ADC ratio.
        name: of the readout, as in `Circuit.readout`.
        passive: whether resistors are all there is.
        has_cross_talk: whether a reading depends on other cells than its own.
        has_closed_form: whether the cells follow from the readings, line by line.
        knows_r_line, knows_r_drive: whether `Circuit.r_line` and `Circuit.r_drive` are modelled.
        takes_diodes: whether lines may be driven through diodes: none is held at 0 V.
    """

    name: ClassVar[str]
    passive: ClassVar[bool] = True
    has_cross_talk: ClassVar[bool] = True
    has_closed_form: ClassVar[bool] = False
    knows_r_line: ClassVar[bool] = False
    knows_r_drive: ClassVar[bool] = False
    takes_diodes: ClassVar[bool] = False
    adc: Floats

    @abstractmethod
    def __init__(self, circuit: Circuit, g: Floats, derivatives: bool = True): ...

    @property
    @abstractmethod
    def own(self) -> Floats:
        """(rows, cols) d adc_a / d g_a [ohm]."""

    @property
    @abstractmethod
    def by_r_par(self) -> Floats:
        """(rows, cols) d adc_a / d r_par [1/ohm]."""

    @property
    def by_r_drive(self) -> Floats:
        """(rows, cols) d adc_a / d r_drive [1/ohm]."""
        return np.zeros(self.adc.shape)

    @abstractmethod
    def change(self, p: Floats) -> Floats:
        """Return (rows, cols) sum_b d adc_a / d g_b * p_b."""

    @abstractmethod
    def pull(self, w: Floats) -> Floats:
        """Return (rows, cols) sum_a w_a * d adc_a / d g_b."""

    @abstractmethod
    def sensitivity(self, weight: Floats, readings: Ints, one: Ints, other: Ints) -> Floats32:
        """Return (m, n) weight_a times d adc_a / d (a conductance between two lines).

        Args:
            weight: (rows, cols).
            readings: (m,) flat, which a; one, other: (n,) the lines, rows first.
        """

    @abstractmethod
    def cells_for(self, cells: Ints, b: Floats) -> Floats:
        """Return (rows, cols) p, 0 but at the flat `cells`, where change(p) is b."""

    @abstractmethod
    def readings_for(self, cells: Ints, b: Floats) -> Floats:
        """Return (rows, cols) w, 0 but at the flat `cells`, where pull(w) is b."""

    @classmethod
    @abstractmethod
    def of_network(
        cls,
        circuit: Circuit,
        laplacian: Floats,
        lines: tuple[Ints, Ints],
        leads: Pair,
        r_ref: Floats,
    ) -> Floats:
        """Return (rows, cols) the ADC ratio of any network: see `readouts.of_network`."""

    @classmethod
    @abstractmethod
    def sharing(cls, circuit: Circuit, cells: float) -> float:
        """Return how many cells of a touch share a current: see `readouts.sharing`."""

    @classmethod
    @abstractmethod
    def apparent(cls, circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
        """Return scale and offset of readings as resistances: see `readouts.apparent`."""

    @classmethod
    def read(cls, circuit: Circuit, g: Floats) -> Floats:
        """Return (n, rows, cols) the ADC ratio of n frames, whose networks may fall into parts."""
        adc: Floats = np.array([cls(circuit, frame).adc for frame in g]).reshape(g.shape)
        return np.minimum(adc, 1.0)  # an amplifier ends there, and rounding

    @classmethod
    def by_conductance(cls, circuit: Circuit, g: Floats) -> Floats:
        """Return (rows, cols, rows, cols) d adc_a / d g_b [ohm]."""
        network = cls(circuit, g)
        cells = np.array([network.change(cell) for cell in np.eye(g.size).reshape(-1, *g.shape)])
        return np.moveaxis(cells, 0, -1).reshape(*g.shape, *g.shape)

    @classmethod
    def ratio(cls, circuit: Circuit, rho: Value) -> Value:
        """Return the ADC ratio where the two lines are so far from one another [ohm]."""
        return circuit.r_ref / (circuit.r_ref + circuit.r_par + rho)

    @classmethod
    def in_series(cls, circuit: Circuit) -> float:
        """Return what `ratio` adds to a cell, or to its two lines [ohm]."""
        return circuit.r_ref + circuit.r_par

    @classmethod
    def through_driver(cls, circuit: Circuit, currents: Floats) -> Floats:
        """Return the current of the line that is driven while each crossing is read.

        Args:
            currents: (..., rows, cols) of each crossing's reference resistor, NaN: not read.
        """
        return currents


def blank(adc: Floats, lines: tuple[Ints, Ints]) -> Floats:
    """Put 0 into the readings of lines that are no node."""
    row, col = lines
    adc[row < 0], adc[:, col < 0] = 0.0, 0.0
    return adc
