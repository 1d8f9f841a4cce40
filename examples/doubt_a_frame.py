# SPDX-License-Identifier: Apache-2.0
"""Know when not to trust a frame: status and message of an estimate.

A sound reading, then the same with a row whose lead has come off. An estimate that is not "ok" is
no measurement; `tactile-skin launch` stops the robot for it.

    python examples/doubt_a_frame.py
"""

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward

circuit, curve = Circuit(rows=16, cols=16, r_ref=1780.0, r_par=326.0), PressureCurve()
force = np.zeros(circuit.shape)
force[3:6, 4:6] = 2.0  # N on each of six cells
sound = forward(circuit, curve.resistance(force))
broken = sound.copy()
broken[9] = 0.0  # row 9 reads nothing, not even its cells at rest

for name, adc in (("sound", sound), ("broken", broken)):
    estimate = compensate(adc, circuit, curve)
    print(f"{name}: {estimate.status} {estimate.message}")
