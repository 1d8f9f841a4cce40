# SPDX-License-Identifier: Apache-2.0
"""Recordings of boards that are driven through diodes."""

from __future__ import annotations

import numpy as np

from support.damaged import Case
from support.kirchhoff import DIODES
from support.lab.parts import Diode

SHAPES, R_REF, R_PAR = ((8, 8), (9, 9), (16, 16)), (1780.0, 10e3, 35e3), 25.0


def recorded(seed: int, r_ref: float, diode: str | None = None, supply: float = 5.0):
    """The circuit, and (n, rows, cols) ADC ratio of a board; whole ADC steps."""
    shape = SHAPES[seed % len(SHAPES)]
    through = Diode(*DIODES[diode], supply) if diode else None
    parts = {"diode": through, "r_ref": r_ref, "r_par": R_PAR}
    case = Case(seed, (), 40.0, shape, readouts=("loaded",), **parts)
    frames = case.frames[::2]
    return case.circuit, np.rint(frames * case.circuit.full_scale) / case.circuit.full_scale
