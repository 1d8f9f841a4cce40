# SPDX-License-Identifier: Apache-2.0
"""The paper's naive method (section V)."""

from __future__ import annotations

from .estimate import Estimate
from .reading import Reading
from .suspect import estimate_from_force


def naive(reading: Reading) -> Estimate:
    """Each reading taken for its own cell's resistance: sees ghosts where parallel paths cross."""
    reading.need_all_cells("naive")
    circuit = reading.circuit
    force = reading.curve.force(circuit.two_terminal(reading.adc)) * circuit.populated
    return estimate_from_force(force, reading, "naive")
