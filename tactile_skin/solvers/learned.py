"""The two networks as methods."""

from __future__ import annotations

from .. import network
from .estimate import Estimate
from .judge import judge
from .reading import Reading


def cnn(reading: Reading, weights=None, **_) -> Estimate:
    """The paper's network: one pass over the ADC picture, no iteration."""
    return _learned(reading, weights, "cnn", "paper")


def physics(reading: Reading, weights=None, **_) -> Estimate:
    """A network of the same size, fed with a few steps of the fixed point."""
    return _learned(reading, weights, "physics", "physics")


def _learned(reading: Reading, weights, method: str, kind: str) -> Estimate:
    reading.need_whole(method)
    weights = weights or network.shipped(kind)
    if weights.kind != kind:
        raise ValueError(f"weights {weights.path}: of a {weights.kind} network, not for {method!r}")
    weights.check(reading.circuit, reading.curve)
    force = weights.predict(reading.adc) * reading.circuit.populated
    return judge(force, reading, method)
