# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the solvers in grams a cell, on simulated frames of a family of touches."""

from __future__ import annotations

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.bench.measure import GHOST, Clock, frames
from tactile_skin.physics.curve import GRAM


def accuracy(method, family, readout, n, seed=1, circuit=None, curve=None, **kwargs) -> dict:
    """Error, spread, status and time of one method from nothing on n fresh frames."""
    circuit, curve = circuit or Circuit(), curve or PressureCurve()
    rng = np.random.default_rng(seed)
    force, adc = frames(family, readout, n, rng, circuit, curve)
    for frame in adc[:3]:
        compensate(frame, circuit, curve, method, **kwargs)
    clock = Clock()
    found = [clock(compensate, frame, circuit, curve, method, **kwargs) for frame in adc]
    error = np.abs(np.array([e.force for e in found]) - force)  # N
    touched = force > 0
    within = error <= np.array([e.std for e in found])
    ghosts = (np.array([e.force for e in found]) > GHOST * GRAM) & ~touched
    return {
        "method": method,
        "family": family,
        "readout": readout,
        "frames": n,
        "mean g": float(error.mean() / GRAM),
        "worst g": float(error.max() / GRAM),
        "frames within 1e-3 g": int((error.max((1, 2)) < 1e-3 * GRAM).sum()),
        "frames with ghosts": float(ghosts.any((1, 2)).mean()),
        "touched within 1 std": float(within[touched].mean()),
        "residual": [float(q) for q in np.quantile([e.residual for e in found], (0.5, 0.98))],
        "suspect": float(np.mean([e.status == "suspect" for e in found])),
        "failed": float(np.mean([e.status == "failed" for e in found])),
        "p50 y": clock.quantile(0.5),
        "p99 y": clock.quantile(0.99),
        "y us": clock.y * 1e6,
    }
