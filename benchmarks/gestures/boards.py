# SPDX-License-Identifier: Apache-2.0
"""Three boards that read a gesture, and the pictures that each method makes of their readings.

The cells scatter by 5 to 8 %, leak into their neighbours and differ at rest by 3 %, which no method
knows, but for the rest. A picture is the mean of the frames that a board of 100 Hz sends meanwhile.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from support.lab.parts import BadMatrix

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.bench.measure import NOISE
from tactile_skin.physics.circuit import forward
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation.scenes import read_out
from tactile_skin.touch.episode import LIMIT
from tactile_skin.touch.recogniser import GATE

METHODS = ("truth", "raw", "naive", "cnn", "auto")
FRAMES = 4  # of the board a picture: those of 40 ms
_REST = 200  # frames of which a rest is measured
_LOADS = tuple(GRAM * load for load in (0, 5, 10, 20, 50, 100, 200, 500, 1000))  # N
_OTHER_FABRIC = (90000, 45000, 26000, 13000, 5200, 2600, 1350, 620, 360)  # ohm
_THIRD_FABRIC = (25000, 9000, 5600, 3200, 1500, 860, 480, 220, 125)  # ohm
BOARDS = {  # A is the paper's
    "A": (Circuit(), PressureCurve()),
    "B": (Circuit(r_ref=4700.0, r_par=150.0), PressureCurve(_LOADS, _OTHER_FABRIC)),
    "C": (
        Circuit(rows=19, cols=24, r_ref=1000.0, r_par=126.0, adc_bits=12),
        PressureCurve(_LOADS, _THIRD_FABRIC),
    ),
}


class Board(NamedTuple):
    """One board, and what a method is given of it."""

    circuit: Circuit
    curve: PressureCurve  # as calibrated, with the cells' rest
    matrix: BadMatrix
    rest: np.ndarray  # (rows, cols) ADC ratio
    noise: float  # RMS of a picture's reading [ADC steps]

    @classmethod
    def of(cls, name: str, seed: int) -> Board:
        """Draw the board of BOARDS of that name."""
        circuit, curve = BOARDS[name]
        matrix = BadMatrix.everyday(circuit, curve, np.random.default_rng([seed, 5]))
        tared = curve.resting_at(1.0 / matrix.fabric.rest)
        rest = forward(circuit, tared.rest_resistance)
        return cls(circuit, tared, matrix, rest, NOISE["scan"] / FRAMES**0.5)

    def read(self, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the readings (n, rows, cols) of forces (n, rows, cols) [N]."""
        ratio = self.matrix.ratio(force)
        return np.mean([read_out(self.circuit, ratio, "scan", rng) for _ in range(FRAMES)], axis=0)

    def pictures(
        self, force: np.ndarray, rng: np.random.Generator, methods=METHODS
    ) -> dict[str, np.ndarray]:
        """Return what each method makes of the readings of (n, rows, cols) forces [N]; 0 on cells
        that are not surely touched.

        Raw readings are steps above rest, as the force that one cell needs for LIMIT of them.
        """
        adc = self.read(force, rng)
        found = {"truth": _over(force, LIMIT)} if "truth" in methods else {}
        if "raw" in methods:
            found["raw"] = _over(np.maximum(adc - self.rest, 0.0) * self._newtons(), LIMIT)
        if "naive" in methods:
            quiet = compensate(self.read(np.zeros_like(force[:1]), rng), *self._known, "naive")
            naive = compensate(adc, *self._known, "naive").force - quiet.force.mean(0)
            found["naive"] = _over(np.maximum(naive, 0.0), LIMIT)
        if "cnn" in methods:
            found["cnn"] = _over(compensate(adc, *self._known, "cnn").force, LIMIT)
        if "auto" in methods:
            estimate = compensate(adc, *self._known, "auto", noise=self.noise)
            found["auto"] = _over(estimate.force, np.maximum(LIMIT, GATE * estimate.std))
        return found

    @property
    def _known(self) -> tuple[Circuit, PressureCurve]:
        return self.circuit, self.curve

    def _newtons(self) -> float:
        """Return the force [N] of a lightly pressed cell by its reading above rest."""
        one = np.zeros(self.circuit.shape)
        one[tuple(n // 3 for n in one.shape)] = LIMIT
        more = forward(self.circuit, self.curve.resistance(one)) - self.rest
        return LIMIT / float(more.max())


def _over(force: np.ndarray, limit) -> np.ndarray:
    return np.where(force > limit, force, 0.0)
