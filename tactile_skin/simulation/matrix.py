# SPDX-License-Identifier: Apache-2.0
"""One imperfect matrix: fabric, wiring and circuit of a board, as they truly are."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import shift

from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from .fabric import Fabric
from .network import Wiring, voltage_ratio


@dataclass
class Matrix:
    """One mat with its wiring."""

    circuit: Circuit  # the true one; of its stripes the wiring knows more
    fabric: Fabric  # the cells
    wiring: Wiring  # stripes, leads and multiplexers
    # cells that the contact moves while the board reads from the first row to the last, in the
    # direction `heading` [rad]
    moving: float = 0.0
    heading: float = 0.0
    # lines (rows, then columns) that read full scale whatever is connected
    full_scale: list[int] = field(default_factory=list)

    @classmethod
    def resting(cls, circuit: Circuit, curve: PressureCurve, seed: int) -> Matrix:
        """Draw one whose cells differ at rest alone: any of them is what the solvers suppose."""
        return cls(circuit, Fabric.resting(circuit, curve, seed), Wiring.ideal(circuit))

    def ratio(self, force: np.ndarray, factor=1.0) -> np.ndarray:
        """Return the ADC ratio that the wires carry to the converter, before noise.

        Args:
            force: (n, rows, cols) [N], at the middle of the scan.
            factor: (rows, cols) times which a cell conducts otherwise.

        Returns:
            (n, rows, cols).
        """
        if self.moving:
            ratio = np.array([self._scanned(picture, factor) for picture in force])
        else:
            ratio = self._read(force, factor)
        for line in self.full_scale:
            rows = self.circuit.rows
            ratio[(slice(None), line) if line < rows else (..., line - rows)] = 1.0
        return ratio

    def _read(self, force, factor) -> np.ndarray:
        conductance = self.fabric.conductance(force, factor)
        return voltage_ratio(conductance, self.wiring, self.circuit)

    def _scanned(self, force: np.ndarray, factor) -> np.ndarray:
        """(rows, cols) of one scan whose rows are read one after the other."""
        each = np.arange(self.circuit.rows)
        way = self.moving * (each / max(len(each) - 1, 1) - 0.5)  # cells, of each row
        steps = way[:, None] * (np.sin(self.heading), np.cos(self.heading))
        moved = np.array([shift(force, step, order=1, prefilter=False) for step in steps])
        return self._read(moved, factor)[each, each]
