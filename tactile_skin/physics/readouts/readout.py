# SPDX-License-Identifier: Apache-2.0
"""What every readout answers: a class for each, of which an object is the network of one frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from ..arrays import Floats, Floats32, Ints, Value

if TYPE_CHECKING:
    from ..circuit import Circuit

Pair: TypeAlias = Sequence[Floats]  # of rows and of columns; low and high
Late: TypeAlias = Callable[[], bool]
BOUND = 1.0 + 1e-9  # factor within which a conductance is on a bound, but for rounding


class Readout(ABC):
    """The network of one frame; adc_a is the reading of crossing a, g_b the conductance of cell b.

    Args:
        circuit: whose readout this is.
        g: (rows, cols) cells [S], 0 where there is none; if floating, of a connected network,
            which is not checked.
        derivatives: whether others than `own` and `by_r_par` will be asked for.
    """

    name: ClassVar[str]  # of the readout, as in `Circuit.readout`
    passive: ClassVar[bool] = True  # whether resistors are all there is
    has_cross_talk: ClassVar[bool] = True  # whether a reading depends on other cells than its own
    # whether a reading is that of `rho`, the resistance between its two lines (rows, cols) [ohm],
    # which follows from `inverse`, a `laplacian.Network`
    two_terminal: ClassVar[bool] = False
    loads_lower: ClassVar[bool] = False  # whether a load may lower readings of other cells
    # whether the readings of a sense line share what its divider leaves of their sum: r_par lies
    # with r_ref
    shares_sum: ClassVar[bool] = False
    # knows_r_line, knows_r_drive: whether `Circuit.r_line` and `Circuit.r_drive` are modelled
    knows_r_line: ClassVar[bool] = False
    knows_r_drive: ClassVar[bool] = False
    second: ClassVar[str] = "r_line"  # of these the one that frames determine besides r_par, if any
    # whether lines may be driven through diodes: none is held at 0 V
    takes_diodes: ClassVar[bool] = False
    adc: Floats  # (rows, cols) ADC ratio
    rho: Floats  # if two_terminal

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
    def by_second(self) -> Floats:
        """(rows, cols) d adc_a / d r_line of all stripes, or / d r_drive [1/ohm]."""
        return np.zeros(self.adc.shape)

    def behind_stripes(self, further: Floats) -> Readout:
        """Return the same behind the circuit's stripes, at first order.

        Args:
            further: (rows, cols) [ohm] that they add beyond that.
        """
        return self

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

    def information(self, weight: Floats, scale: Floats, cells: Ints) -> Floats32 | None:
        """Return `Linearised.information`; None: it is left to `sensitivity`."""
        return None

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
        """Return (..., rows, cols) the ADC ratio of any networks, damaged wires included: not fast.

        Args:
            laplacian: (..., nodes, nodes) [S].
            lines: for rows and columns, the node that each address selects; -1: none, reads 0.
            leads: for rows and columns, what lies between each address and its node [ohm].
            r_ref: of each sense line [ohm], infinite where it is missing; not if floating.
        """

    @classmethod
    @abstractmethod
    def sharing(cls, circuit: Circuit, cells: float, picture: Floats | None) -> float:
        """Return how many cells of a touch may share the current through what lies in series.

        An ohm there hides as much as so many ohm of each of them.

        Args:
            cells: how many it has, if they are alike.
            picture: (rows, cols) resistances of all cells [ohm]; None: not known.
        """

    @classmethod
    @abstractmethod
    def apparent(cls, circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
        """Return how readings (..., rows, cols) become resistances that follow their own cell most.

        Returns:
            scale, to be broadcast, or a number, and offset [ohm], of r_ref * scale / adc - offset.
        """

    @classmethod
    def least(cls, circuit: Circuit, rest: Floats) -> Floats:
        """Return (rows, cols) the least that loads on other cells leave of readings at rest.

        Both are over the scale of `apparent`, by which they lower all of a line alike.
        """
        return rest

    @classmethod
    def guess(cls, circuit: Circuit, adc: Floats, rho: Floats, bounds: Pair) -> Floats:
        """Return (rows, cols) cells between bounds [S] whose products with `rho` are all alike.

        The ADC ratio `adc` is 0 where it is not known; `rho` is its resistance by `apparent` [ohm].
        """
        return circuit.populated * np.clip(cls.product(circuit) / rho, *bounds)

    @classmethod
    def product(cls, circuit: Circuit) -> float:
        """Return what the products are that `guess` takes for alike.

        Equal cells send no current from one sense line to another: it is then 1.
        """
        return 1.0

    @classmethod
    def closed_form(
        cls, circuit: Circuit, adc: Floats, rho: Floats, bounds: Pair, target: float, late: Late
    ) -> tuple[Floats, int, bool] | None:
        """Return the cells where they follow from the readings line by line; None: they do not.

        Args:
            adc, rho, bounds: as of `guess`, all of them read.
            target: share of the supply by which a step for the drivers may be the last.
            late: whether there is no time for another step.

        Returns:
            (rows, cols) [S], steps, whether these sufficed.
        """
        return None

    @classmethod
    def read(cls, circuit: Circuit, g: Floats) -> Floats:
        """Return (n, rows, cols) the ADC ratio of n frames, whose networks may fall into parts."""
        adc: Floats = np.array([cls(circuit, frame).adc for frame in g]).reshape(g.shape)
        return np.minimum(adc, 1.0)  # an amplifier ends there, and rounding

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
    adc[..., row < 0, :], adc[..., col < 0] = 0.0, 0.0
    return adc
