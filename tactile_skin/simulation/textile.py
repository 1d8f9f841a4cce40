# SPDX-License-Identifier: Apache-2.0
"""How far a skin is from what the solvers know of it: each effect by its strength.

The solvers know stripes without resistance, cells on one curve and a frame read in an instant.
Here stripes have resistance, are cut and touch one another; cells scatter, leak sideways and stick;
the board drifts, saturates and reads one row after the other while the contact moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import GRAM, PressureCurve
from .matrix import Converter, Fabric, Matrix
from .network import NOWHERE, Wiring

_TOUCHING = 1.0  # S between two stripes that touch
_STUCK = 50.0 * GRAM, 1000.0 * GRAM  # N on a cell that stays pressed


@dataclass(frozen=True)
class Textile:
    """What differs from the solvers' model; the defaults differ in nothing."""

    noise: float = 0.0  # RMS of a sample, in ADC steps
    # r_par, r_ref: true value over the one that the solver is given
    r_par: float = 1.0
    r_ref: float = 1.0
    # relative error of what a load adds to each cell's conductance, of random sign
    curve: float = 0.0
    scatter: float = 0.0  # relative RMS scatter of the same from cell to cell
    rest: float = 0.0  # relative RMS scatter of the cells' resistance at rest
    line: float = 0.0  # resistance of a stripe from its lead to its far end [ohm]
    lateral: float = 0.0  # share of a cell's conductance above rest that its four neighbours gain
    # cells that the contact moves while the board reads from the first row to the last
    moving: float = 0.0
    open: int = 0  # lines whose lead is cut: they read nothing, but still connect their cells
    broken: int = 0  # lines cut within the matrix: the far part floats
    short: int = 0  # pairs of neighbouring lines that touch
    stuck: int = 0  # cells that stay pressed by a random load
    ceiling: float = 1.0  # ADC ratio above which the input saturates
    full_scale: int = 0  # lines whose samples read full scale whatever is connected

    def draw(self, circuit: Circuit, curve: PressureCurve, rng) -> Matrix:
        """Draw a matrix of this kind; the solver is given the circuit and the curve."""
        rows, cols = circuit.shape
        lines = rng.permutation(rows + cols)  # which lines are damaged
        wiring = Wiring.ideal(circuit, self.line)
        for line in lines[: self.open]:
            axis, number = _line(line, rows)
            wiring.addresses(axis)[number] = NOWHERE
        for line in lines[self.open : self.open + self.broken]:
            at = int(rng.integers(1, cols if line < rows else rows))
            wiring.cut(*_line(line, rows), at)
        pairs = np.delete(np.arange(rows + cols - 1), rows - 1)  # line, and the next of its kind
        for line in rng.choice(pairs, self.short, replace=False):
            axis, first = _line(line, rows)
            wiring.ties.append((axis, first, axis, first + 1, _TOUCHING))
        gain = 1.0 + self.curve * rng.choice((-1.0, 1.0))
        gain = gain * np.exp(self.scatter * rng.standard_normal((rows, cols)))
        at_rest = np.exp(self.rest * rng.standard_normal((rows, cols))) / curve.rest_resistance
        fabric = Fabric(curve, circuit.populated, gain, at_rest, self.lateral)
        stuck = rng.choice(rows * cols, self.stuck, replace=False)
        added = 1.0 / curve.resistance(rng.uniform(*_STUCK, self.stuck))
        fabric.pressed = {divmod(int(k), cols): s for k, s in zip(stuck, added, strict=True)}
        true = replace(circuit, r_par=circuit.r_par * self.r_par, r_ref=circuit.r_ref * self.r_ref)
        heading = rng.uniform(0.0, 2.0 * np.pi)
        tied = [int(line) for line in lines[::-1][: self.full_scale]]
        return Matrix(true, fabric, wiring, self.moving, heading, full_scale=tied)

    def converter(self, circuit: Circuit) -> Converter:
        """Return what such a skin is read with."""
        return Converter(circuit.full_scale, self.noise, rail=self.ceiling, ceiling=self.ceiling)


def _line(line: int, rows: int) -> tuple[int, int]:
    """Axis, and number on it, of a line: rows are counted first."""
    return (0, int(line)) if line < rows else (1, int(line) - rows)


class Sample:
    """One board of a kind: its cells and its damage are the same in all frames."""

    def __init__(self, textile: Textile, circuit: Circuit, curve: PressureCurve, seed):
        self.matrix = textile.draw(circuit, curve, np.random.default_rng(seed))
        self.converter = textile.converter(circuit)

    def expose(self, force) -> np.ndarray:
        """(n, rows, cols) ADC ratio before noise and rounding, of forces (n, rows, cols) [N]."""
        return self.matrix.ratio(np.asarray(force))

    def sample(self, ratio, rng) -> np.ndarray:
        """(n, rows, cols) frames as the board sends them."""
        return np.array([self.converter.frame(r, rng) for r in ratio])

    def at_rest(self, n: int, rng) -> np.ndarray:
        """(n, rows, cols) frames of the untouched board."""
        rest = self.expose(np.zeros((1, *self.matrix.circuit.shape)))
        return self.sample(np.repeat(rest, n, 0), rng)
