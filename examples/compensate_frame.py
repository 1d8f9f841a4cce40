# SPDX-License-Identifier: Apache-2.0
"""Compensate one frame: what the board reads, what the naive method makes of it, what is pressed.

No board, no nodes: the forward model makes the reading of two fingers. Replace `adc` by a frame of
your own board, as a ratio of its full scale, and the circuit by yours.

    python examples/compensate_frame.py
"""

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward

circuit = Circuit(rows=16, cols=16, r_ref=1780.0, r_par=326.0)  # ohm
curve = PressureCurve()  # force on a cell [N] <-> its resistance [ohm]

force = np.zeros(circuit.shape)  # N
force[3:6, 4:6] = 2.0
force[10:12, 11:13] = 2.0
adc = forward(circuit, curve.resistance(force))  # what the board reads, 0 to 1

for method in ("naive", "auto"):
    estimate = compensate(adc, circuit, curve, method)
    ghosts = int(np.sum((estimate.force > 0.2) & (force == 0.0)))  # 0.2 N: 20 g
    error = np.abs(estimate.force - force).mean()
    total = f"sum {estimate.force.sum():.2f} N (true {force.sum():.2f} N)"
    print(f"{method:6} {total}, error {error:.3f} N a cell, {ghosts} ghosts, {estimate.status}")
