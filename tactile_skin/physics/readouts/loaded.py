# SPDX-License-Identifier: Apache-2.0
"""One line is driven, each sense line has its reference resistor, other driven lines are open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats
from .driven import LEAST_SCALE, Driven

if TYPE_CHECKING:
    from ..circuit import Circuit


class Loaded(Driven):
    """The driven line is held behind r_par."""

    name = "loaded"
    takes_diodes = True

    def _drive_lines(self, circuit: Circuit) -> None:
        k, rows = self._inverse(0.0), self._rows
        self._at_drive = k.diagonal()[:rows, None] + circuit.r_par
        self._of_inverse(k, self._at_drive)
        self._c = self._back

    @property
    def by_r_par(self) -> Floats:
        return self._turn(-self._s * self._v / self._at_drive)

    @classmethod
    def _before_r_ref(cls, circuit: Circuit) -> float:
        return 0.0

    @classmethod
    def _to_idle(cls, circuit: Circuit, before: Floats) -> Floats:
        return np.zeros(len(before))

    @classmethod
    def _from_supply(cls, circuit: Circuit, before: Floats, own: Floats) -> Floats:
        return before + circuit.r_par + own

    @classmethod
    def apparent(cls, circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
        """Return scale and offset [ohm] of readings as the cells' resistances, without cross-talk.

        That is r_ref times voltage over current of the own cell, as if no current came to its sense
        line from other cells; the voltage is the driven line's own, behind r_par.
        """
        along = -1 - circuit.sense_axis
        scale = 1.0 - circuit.r_par / circuit.r_ref * adc.sum(along, keepdims=True)
        return np.maximum(scale, LEAST_SCALE), circuit.r_ref

    @classmethod
    def least(cls, circuit: Circuit, rest: Floats) -> Floats:
        """Return the means of each with the lowest of its driven line, so many as leave the least.

        Cells in other lines join sense lines, all with r_ref: their voltages become (1 + L)^-1 of
        those before, L a Laplacian. That is doubly stochastic, with no row's weight above its own.
        """
        along = 1 - circuit.sense_axis
        line = np.sort(rest, axis=along).cumsum(along)
        many = np.arange(2, line.shape[along] + 2)
        line = np.moveaxis(line, along, -1)
        means = (np.moveaxis(rest, along, -1)[..., None] + line[..., None, :]) / many
        return np.moveaxis(np.fmin(means.min(-1), np.moveaxis(rest, along, -1)), -1, along)

    @classmethod
    def through_driver(cls, circuit: Circuit, currents: Floats) -> Floats:
        """Return the sum of the currents through the reference resistors of all sense lines.

        A crossing that was not read counts as the mean of those that were.
        """
        if currents.ndim < 2:  # no picture
            return currents
        along = -1 - circuit.sense_axis
        read = ~np.isnan(currents)
        mean: Floats = np.where(read, currents, 0.0).sum(along, keepdims=True)
        mean /= np.maximum(read.sum(along, keepdims=True), 1)
        mean *= currents.shape[along]
        return mean
