# SPDX-License-Identifier: Apache-2.0
"""A start and weights that `compensate` cannot use are refused by name."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.solvers import METHODS

CIRCUIT, CURVE = Circuit(4, 6), PressureCurve()
FORCE = np.zeros((4, 6))
FORCE[1:3, 2:4] = 2.0
ADC = np.rint(forward(CIRCUIT, CURVE.resistance(FORCE)) * 1023) / 1023
LAST = compensate(ADC, CIRCUIT, CURVE)


def hole(value) -> np.ndarray:
    force = np.ones((4, 6))
    force[2, 3] = value
    return force


STARTS = {
    "NaN": (replace(LAST, force=hole(np.nan)), "start.force = nan at row 2, column 3"),
    "infinite": (replace(LAST, force=hole(np.inf)), "start.force = inf at row 2, column 3"),
    "negative": (replace(LAST, force=hole(-1.0)), "start.force = -1.0 at row 2, column 3"),
    "shape": (replace(LAST, force=np.ones((6, 4))), "start has shape (6, 4): the circuit is"),
    "length": (replace(LAST, force=[1.0]), "start has shape (1,)"),
    "batch": (compensate(np.stack([ADC] * 3), CIRCUIT, CURVE), "start has shape (3, 4, 6)"),
    "picture": (FORCE, "start is of type ndarray: must be an Estimate, that of the last frame"),
    "name": ("map", "start is of type str: must be an Estimate"),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("wrong", STARTS)
def test_a_bad_start_is_refused(method, wrong):
    start, message = STARTS[wrong]
    with pytest.raises(ValueError, match=re.escape(message)):
        compensate(ADC, CIRCUIT, CURVE, method, start=start)


def test_weights_must_be_weights():
    with pytest.raises(ValueError, match="weights are of type str: must be Weights"):
        compensate(ADC, CIRCUIT, CURVE, "cnn", weights="mine.npz")
