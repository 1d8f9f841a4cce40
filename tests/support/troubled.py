# SPDX-License-Identifier: Apache-2.0
"""Readings of a circuit with one fault and nothing else."""

import numpy as np

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation.textile import Textile

FAULTS = {
    "open": Textile(open=1),
    "short": Textile(short=1),
    "r_par +10 %": Textile(r_par=1.1),
    "r_par -10 %": Textile(r_par=0.9),
    "moving": Textile(moving=1.0),
}


def expose(textile: Textile, circuit: Circuit, curve: PressureCurve, force, rng) -> np.ndarray:
    """(rows, cols) ADC ratio of a matrix that is drawn for it, before noise and rounding."""
    return textile.draw(circuit, curve, rng).ratio(np.asarray(force)[None])[0]


def read(textile: Textile, circuit: Circuit, curve: PressureCurve, force, rng) -> np.ndarray:
    """One frame as a board sends it: (rows, cols) ADC ratio, rounded, mean of 4 scans.

    Args:
        force: (rows, cols) [N], at the middle of the scan.
    """
    ratio = expose(textile, circuit, curve, force, rng)
    return textile.converter(circuit).frame(ratio, rng)


def faulty(circuit: Circuit, resistance: np.ndarray, fault: str, rng) -> np.ndarray:
    """(rows, cols) ADC ratio, not rounded."""
    curve = PressureCurve()
    return expose(FAULTS[fault], circuit, curve, curve.force(resistance), rng)
