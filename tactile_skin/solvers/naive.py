"""The paper's naive method (section V)."""

from __future__ import annotations

from .estimate import Estimate
from .reading import Reading
from .suspect import judge


def naive(reading: Reading) -> Estimate:
    """Each reading taken for its own cell's resistance: sees ghosts where parallel paths cross."""
    reading.need_whole("naive")
    circuit = reading.circuit
    force = reading.curve.force(circuit.two_terminal(reading.adc)) * circuit.populated
    return judge(force, reading, "naive")
