# SPDX-License-Identifier: Apache-2.0
"""The two networks as methods."""

from __future__ import annotations

import numpy as np

from ..learning import network
from .estimate import Estimate
from .reading import Reading
from .suspect import estimate_from_force, network_of

_OWN_SHARE = 0.95  # of the current at a crossing, from which on its cell is found alone: chosen


def cnn(reading: Reading, weights=None) -> Estimate:
    """Apply the paper's network: one pass over the ADC picture, no iteration."""
    return _learned(reading, weights, "cnn", "paper")


def physics(reading: Reading, weights=None) -> Estimate:
    """Apply a network of the same size, fed with a few steps of the fixed point."""
    return _learned(reading, weights, "physics", "physics")


def _learned(reading: Reading, weights, method: str, kind: str) -> Estimate:
    reading.need_all_cells(method)
    weights = network.shipped(kind) if weights is None else weights
    if not isinstance(weights, network.Weights):
        found = type(weights).__name__
        raise ValueError(f"weights are of type {found}: must be Weights, see network.load")
    if weights.kind != kind:
        raise ValueError(f"weights {weights.path}: of a {weights.kind} network, not for {method!r}")
    weights.check(reading.circuit, reading.curve)
    force = weights.predict(reading.adc)  # of cells that are all alike
    if reading.curve.gain is not None:
        force *= reading.curve.gain
    force *= reading.circuit.populated
    force, there = _with_single_cells(force, network_of(force, reading), reading)
    return estimate_from_force(force, reading, method, network=there)


def _with_single_cells(force: np.ndarray, there: tuple, reading: Reading):
    """Return the force with cells that their reading determines alone; `network_of` it, if known.

    The networks learnt from touches of several cells: of a corner of 10 kg on one cell they find
    half, or nothing at the skin's rim, and a stop would not come. Nearly all of the current at the
    crossing flows through such a cell, so the current around it, as the network's force implies it,
    need not be accurate.
    """
    around = 1.0 / there[2].rho - there[1]  # S
    alone = reading.circuit.populated & (around * reading.rho < 1.0 - _OWN_SHARE)
    if not alone.any():
        return force, there
    own = 1.0 / reading.rho - around
    pressed = reading.curve.force(1.0 / np.where(alone, own, 1.0))
    return np.where(alone, np.maximum(force, pressed), force), None
