# SPDX-License-Identifier: Apache-2.0
"""What a board does not say of itself: its series resistances, and the curve of its fabric.

python examples/find_circuit.py
"""

import numpy as np

from tactile_skin import Circuit, PressureCurve, fit_curve, forward, identify, measure_rest
from tactile_skin.simulation import scenes

rng = np.random.default_rng(1)
true = Circuit(r_par=372.0, r_line=9.0)  # what nobody knows
fabric = PressureCurve()  # nor this


def read(force):
    """Frames (n, rows, cols) of the board: rounded, with a step of noise."""
    ideal = forward(true, fabric.resistance(force))
    return scenes.read_out(true, ideal, "scan", rng)


supposed = Circuit(r_par=326.0)
rest = measure_rest(read(np.zeros((30, 16, 16))), supposed)
touches = scenes.sample("blobs", 20, 16, 16, rng)
found = identify(read(touches), supposed, rest)
print(found.message)

objects = scenes.sample("blobs", 8, 16, 16, rng)
weights = objects.sum((1, 2))  # N: what a kitchen scale says
fitted = fit_curve(read(objects), weights, found.circuit, rest)
print(fitted.message)
