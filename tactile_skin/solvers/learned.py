"""The paper's network as a method."""

from __future__ import annotations

from .. import network
from .estimate import Estimate
from .judge import judge
from .reading import Reading


def cnn(reading: Reading, weights=None, **_) -> Estimate:
    """One pass, no iteration."""
    reading.need_whole("cnn")
    weights = weights or network.shipped("cnn")
    weights.check(reading.circuit, reading.curve)
    force = weights.predict(reading.adc) * reading.circuit.populated
    return judge(force, reading, "cnn")
