"""The paper's naive method (section V)."""

from __future__ import annotations

from .estimate import Estimate
from .judge import judge
from .reading import Reading


def naive(reading: Reading, **_) -> Estimate:
    """Each reading taken for its own cell's resistance: sees ghosts where parallel paths cross."""
    reading.need_whole("naive")
    circuit = reading.circuit
    force = reading.curve.force(circuit.two_terminal(reading.adc)) * circuit.populated
    return judge(force, reading, "naive")
