"""The two networks as methods."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .. import network
from ..circuit import two_terminal_resistance
from .estimate import Estimate
from .judge import judge
from .reading import Reading

_ALONE = 0.95  # share of a crossing's conductance from which on its own cell is all there is


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
    force, rho = _with_hard_edges(force, reading)
    return judge(force, reading, method, rho=rho)


def _with_hard_edges(force: np.ndarray, reading: Reading):
    """Cells that the reading gives away without a network; and rho of the result, if known.

    The networks learnt from touches of several cells: a corner of 10 kg on one cell they take for
    half of it, or for nothing at the skin's rim, and a stop would not come. Through such a cell
    flows nearly all that is read at its crossing, so that what flows around it, as the network
    sees it, need not be known well.
    """
    curve, cells = reading.curve, reading.circuit.populated
    read = 1.0 / reading.rho
    # More flows around a cell the more is pressed: where even an untouched skin's flow around it is
    # too much, there is nothing to find.
    if not (read * (1.0 - _ALONE) > _around_at_rest(reading.circuit, curve)).any():
        return force, None
    g = np.where(cells, 1.0 / curve.resistance(force), 0.0)
    rho = two_terminal_resistance(g)
    own = read - (1.0 / rho - g)
    alone = cells & (own > _ALONE * read)
    if not alone.any():
        return force, rho
    pressed = curve.force(1.0 / np.where(alone, own, 1.0))
    return np.where(alone, np.maximum(force, pressed), force), None


@lru_cache(maxsize=16)
def _around_at_rest(circuit, curve) -> np.ndarray:
    """(rows, cols) conductance [S] of an untouched skin's crossings, but for their own cell."""
    g = circuit.populated / curve.rest_resistance
    return 1.0 / two_terminal_resistance(g) - g
