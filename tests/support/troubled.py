# SPDX-License-Identifier: Apache-2.0
"""Readings of a circuit with one fault and nothing else."""

import numpy as np

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation.textile import Textile, expose

FAULTS = {
    "open": Textile(open=1),
    "short": Textile(short=1),
    "r_par +10 %": Textile(r_par=1.1),
    "r_par -10 %": Textile(r_par=0.9),
    "moving": Textile(moving=1.0),
}


def faulty(circuit: Circuit, resistance: np.ndarray, fault: str, rng) -> np.ndarray:
    """(rows, cols) ADC ratio, not rounded."""
    curve = PressureCurve()
    return expose(FAULTS[fault], circuit, curve, curve.force(resistance), rng)
