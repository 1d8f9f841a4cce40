# SPDX-License-Identifier: Apache-2.0
"""One imperfect matrix as it truly is: a fabric whose cells differ and leak, wiring and circuit."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import shift

from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from .network import Wiring, voltage_ratio

OVERSAMPLED = 4  # scans of which a board of 100 frames a second sends the mean
Cell = tuple[int, int]  # row, column
REST_SCATTER = 0.03  # RMS of log resistance of the cells at rest, chosen: a good fabric's


@dataclass
class Fabric:
    """The cells of one mat, as they truly are."""

    curve: PressureCurve  # of the usual cell. Beyond its end the fabric goes on conducting more.
    populated: np.ndarray  # (rows, cols) bool, where there is a cell
    gain: np.ndarray  # (rows, cols), times which a load adds to a cell's conductance
    rest: np.ndarray  # (rows, cols) conductance without a load [S]
    lateral: float = 0.0  # share of what a cell conducts above rest that its four neighbours gain
    # cell -> what a load that stays on it adds to its conductance, whatever else is there [S]
    pressed: dict[Cell, float] = field(default_factory=dict)

    @classmethod
    def resting(cls, circuit: Circuit, curve: PressureCurve, seed: int) -> Fabric:
        """Draw one whose cells scatter by 3 % at rest, and in nothing else."""
        rest = np.asarray(1.0 / resting_curve(curve, circuit.shape, seed).rest_resistance)
        return cls(curve, circuit.populated, np.ones(circuit.shape), rest)

    def conductance(self, force: np.ndarray, factor=1.0) -> np.ndarray:
        """Return what cells conduct under a force (n, rows, cols) [N]: the same shape [S].

        Args:
            factor: (rows, cols) times which a cell conducts otherwise: it crept, say.
        """
        curve = self.curve
        end = curve.points[-1][0] * (1.0 if curve.gain is None else curve.gain)  # N
        beyond = np.maximum(force / end, 1.0)
        more = (1.0 / curve.resistance(force) - 1.0 / curve.rest_resistance) * beyond * self.gain
        for cell, siemens in self.pressed.items():
            more[(slice(None), *cell)] = siemens
        conducted = self.rest + more
        if self.lateral:
            padded = np.pad(more, ((0, 0), (1, 1), (1, 1)))
            around = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1]
            around += padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
            conducted += self.lateral * around
        return np.where(self.populated, factor * conducted, 0.0)


def resting_curve(curve: PressureCurve, shape: tuple[int, int], seed: int) -> PressureCurve:
    """Return the curve of (rows, cols) cells that scatter about it at rest by REST_SCATTER."""
    scatter = np.random.default_rng([seed, *shape]).standard_normal(shape)
    return curve.resting_at(curve.rest_resistance * np.exp(REST_SCATTER * scatter))


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
        """Return the ADC ratio (n, rows, cols) that the wires carry to the converter, before noise.

        Args:
            force: (n, rows, cols) [N], at the middle of the scan.
            factor: (rows, cols) times which a cell conducts otherwise.
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


@dataclass
class Converter:
    """An ADC."""

    full_scale: int  # its largest count
    noise: float = 1.0  # RMS of a sample [ADC steps]
    # ADC ratio above which nothing is seen, before the noise; ceiling: the same of counts
    rail: float = np.inf
    ceiling: float = 1.0

    def count(self, ratio: np.ndarray, rng) -> np.ndarray:
        """Return the counts (n, rows, cols) of ADC ratios (n, rows, cols) in turn."""
        return self._counted(ratio, np.minimum(ratio, self.rail) * self.full_scale, self.noise, rng)

    def _counted(self, ratio: np.ndarray, steps: np.ndarray, noise, rng) -> np.ndarray:
        steps = np.rint(steps + noise * rng.standard_normal(steps.shape))
        # full scale is no analogue value: a line tied to it passes any ceiling
        top = np.where(ratio >= 1.0, self.full_scale, np.rint(self.ceiling * self.full_scale))
        return np.clip(steps, 0, top).astype(np.int32)

    def frame(self, ratio: np.ndarray, rng) -> np.ndarray:
        """Return the mean of four samples of an ADC ratio (rows, cols), as an ADC ratio."""
        samples = np.broadcast_to(ratio, (OVERSAMPLED, *ratio.shape))
        return self.count(samples, rng).mean(0) / self.full_scale
