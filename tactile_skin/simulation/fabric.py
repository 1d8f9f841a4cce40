# SPDX-License-Identifier: Apache-2.0
"""The cells of a fabric: none is like another, and they leak into their neighbours."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve

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
        padded = np.pad(more, ((0, 0), (1, 1), (1, 1)))
        around = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1]
        around += padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
        g = factor * (self.rest + more + self.lateral * around)
        return np.where(self.populated, g, 0.0)


def resting_curve(curve: PressureCurve, shape: tuple[int, int], seed: int) -> PressureCurve:
    """Return the curve of (rows, cols) cells that scatter about it at rest by REST_SCATTER."""
    scatter = np.random.default_rng([seed, *shape]).standard_normal(shape)
    return curve.resting_at(curve.rest_resistance * np.exp(REST_SCATTER * scatter))
