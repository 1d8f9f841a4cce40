"""The two networks as methods."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..learning import network
from ..physics.kernel import connected_rho
from . import series
from .estimate import Estimate
from .reading import Reading
from .suspect import judge, network_of

_ALONE = 0.95  # share of a crossing's conductance from which on its own cell is all there is


def cnn(reading: Reading, weights=None) -> Estimate:
    """The paper's network: one pass over the ADC picture, no iteration."""
    return _learned(reading, weights, "cnn", "paper")


def physics(reading: Reading, weights=None) -> Estimate:
    """A network of the same size, fed with a few steps of the fixed point.

    If its answer shows the board's r_par to be another than the circuit's, it looks again.
    """
    return _learned(reading, weights, "physics", "physics")


def _learned(reading: Reading, weights, method: str, kind: str) -> Estimate:
    reading.need_whole(method)
    weights = network.shipped(kind) if weights is None else weights
    if not isinstance(weights, network.Weights):
        found = type(weights).__name__
        raise ValueError(f"weights are of type {found}: must be Weights, see network.load")
    if weights.kind != kind:
        raise ValueError(f"weights {weights.path}: of a {weights.kind} network, not for {method!r}")
    weights.check(reading.circuit, reading.curve)
    force, there = _look(reading, weights)
    r_par = series.guess(reading, there[1]) if kind == "physics" else None
    told = reading
    if r_par is not None:
        told = series.as_read_by_the_circuit(reading, r_par)
        force, there = _look(told, weights)
    force, there = _with_hard_edges(force, there, told)
    estimate = judge(force, reading, method, network=there)
    return estimate if r_par is None else series.named(replace(estimate, r_par=r_par), reading)


def _look(reading: Reading, weights) -> tuple[np.ndarray, tuple]:
    """(rows, cols) force [N] that the network sees, and `network_of` it."""
    force = weights.predict(reading.adc)
    if reading.circuit.mask is not None:
        force *= reading.circuit.populated
    return force, network_of(force, reading)


def _with_hard_edges(force: np.ndarray, there: tuple, reading: Reading):
    """Cells that the reading gives away without a network; and `network_of` those, if known.

    Args:
        there: `network_of` the force.

    The networks learnt from touches of several cells: a corner of 10 kg on one cell they take for
    half of it, or for nothing at the skin's rim, and a stop would not come. Through such a cell
    flows nearly all that is read at its crossing, so that what flows around it, as the network
    sees it, need not be known well.
    """
    # More flows around a cell the more is pressed: where even an untouched skin's flow around it is
    # too much, there is nothing to find.
    if not (reading.rho < _telling(reading.circuit, reading.curve)).any():
        return force, there
    around = 1.0 / there[2] - there[1]  # S
    alone = around * reading.rho < 1.0 - _ALONE
    if reading.circuit.mask is not None:
        alone &= reading.circuit.populated
    if not alone.any():
        return force, there
    own = 1.0 / reading.rho - around
    pressed = reading.curve.force(1.0 / np.where(alone, own, 1.0))
    return np.where(alone, np.maximum(force, pressed), force), None


@lru_cache(maxsize=16)
def _telling(circuit, curve) -> np.ndarray:
    """(rows, cols) reading [ohm] below which it may be that of its own cell alone.

    On an untouched skin the rest of it would then be less than what flows around the cell.
    """
    g = circuit.populated / curve.rest_resistance
    around = 1.0 / connected_rho(g) - g
    return (1.0 - _ALONE) / around
