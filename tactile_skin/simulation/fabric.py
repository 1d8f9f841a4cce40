"""The cells of a fabric: none is like another, they leak into their neighbours, some are broken."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve

Cell = tuple[int, int]  # row, column
_LATERAL = 0.005  # share that neighbours gain; the paper measured 0.5 %
_SCATTER = (
    0.05,
    0.08,
)  # RMS of what a load adds to a cell's conductance, from board to board; chosen
REST_SCATTER = 0.03  # RMS of log resistance of the cells at rest, chosen: a good fabric's
_LIFTS = 0.1  # chance that a loose cell changes from a picture to the next: a tenth of a second


@dataclass
class Fabric:
    """The cells of one mat, as they truly are.

    Attributes:
    curve: of the usual cell. Beyond its end the fabric goes on conducting more.
    populated: (rows, cols) bool, where there is a cell.
    gain: (rows, cols), times which a load adds to a cell's conductance.
    rest: (rows, cols) conductance without a load [S].
    lateral: share of what a cell conducts above rest that its four neighbours gain.
    pressed: cell -> what a load that stays on it adds to its conductance, whatever else is there
        [S]; fixed: its conductance [S], whatever is on it; added: on top of the fabric's [S];
        restless: relative RMS by which it changes from picture to picture; loose: share of them
        in which the fabric does not touch the cell's electrodes. Both are drawn from `rng`.
    """

    curve: PressureCurve
    populated: np.ndarray
    gain: np.ndarray
    rest: np.ndarray
    lateral: float = 0.0
    pressed: dict[Cell, float] = field(default_factory=dict)
    fixed: dict[Cell, float] = field(default_factory=dict)
    added: dict[Cell, float] = field(default_factory=dict)
    restless: dict[Cell, float] = field(default_factory=dict)
    loose: dict[Cell, float] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    _lifted: bool = field(default=False, repr=False)

    @classmethod
    def everyday(cls, circuit: Circuit, curve: PressureCurve, rng) -> Fabric:
        """Draw one whose loads scatter by 5 to 8 %, and its cells at rest by 3 %."""
        scatter = rng.uniform(*_SCATTER)
        gain = np.exp(scatter * rng.standard_normal(circuit.shape))
        rest = np.exp(REST_SCATTER * rng.standard_normal(circuit.shape)) / curve.rest_resistance
        return cls(curve, circuit.populated, gain, rest, _LATERAL, rng=rng)

    @classmethod
    def resting(cls, circuit: Circuit, curve: PressureCurve, seed: int) -> Fabric:
        """Draw one whose cells scatter by 3 % at rest, and in nothing else."""
        rest = np.asarray(1.0 / resting_curve(curve, circuit.shape, seed).rest_resistance)
        return cls(curve, circuit.populated, np.ones(circuit.shape), rest)

    @property
    def unsteady(self) -> bool:
        """Whether the cells change without a load that changes."""
        return bool(self.restless or self.loose)

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
        g = np.where(self.populated, g, 0.0)
        for cell, siemens in self.fixed.items():
            g[(slice(None), *cell)] = siemens
        for cell, siemens in self.added.items():
            g[(slice(None), *cell)] += siemens
        for cell, share in self.restless.items():
            g[(slice(None), *cell)] *= np.exp(share * self.rng.standard_normal(len(g)))
        for cell, share in self.loose.items():
            for picture in g:
                if self.rng.random() < _LIFTS:
                    self._lifted = self.rng.random() < share
                if self._lifted:
                    picture[cell] = 0.0
        return g


def resting_curve(curve: PressureCurve, shape: tuple[int, int], seed: int) -> PressureCurve:
    """Return the curve of (rows, cols) cells that scatter about it at rest by REST_SCATTER."""
    scatter = np.random.default_rng([seed, *shape]).standard_normal(shape)
    return curve.resting_at(curve.rest_resistance * np.exp(REST_SCATTER * scatter))
