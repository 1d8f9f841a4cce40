# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the solvers in grams a cell, on simulated frames of a family of touches."""

from __future__ import annotations

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.bench.measure import GHOST, Clock, frames
from tactile_skin.physics.circuit import jacobian
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.simulation.textile import Textile, expose
from tactile_skin.solvers.reading import SCAN_NOISE


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


def other_board(family: str, off: str, n: int, seed=1) -> dict:
    """Error [g] on boards that are not as the solver is told, and what of it is the board's doing.

    R_par is off by 5 %, up or down, or the curve by up to 20 %, or both. "physics" and "map" read
    `scan`. "newton" inverts the same boards exactly, from readings without noise or rounding: what
    it misses by, any inverse does that believes its R_par and curve and nothing else.

    Args:
        off: "R_par", "curve" or "both".
    """
    circuit, curve = Circuit(), PressureCurve()
    rng = np.random.default_rng(seed)
    force = scenes.sample(family, n, *circuit.shape, rng)
    total = dict.fromkeys(("physics", "map", "newton"), 0.0)
    for truth in np.minimum(force, curve.max_force):
        r_par, gain = rng.choice((0.95, 1.05)), rng.uniform(0.0, 0.2)
        skin = Textile(
            noise=1.0, r_par=1.0 if off == "curve" else r_par, curve=0.0 if off == "R_par" else gain
        )
        exact = expose(skin, circuit, curve, truth, rng)
        scan = skin.converter(circuit).frame(exact, rng)
        for method in total:
            adc = exact if method == "newton" else scan
            found = compensate(adc, circuit, curve, method).force
            total[method] += np.abs(found - truth).mean() / GRAM / n
    return {"family": family, "off": off, "frames": n} | total


def r_par_std(family: str, n: int, seed=1) -> dict:
    """Standard deviation [ohm] to which a `scan` frame determines R_par, at best (Cramer-Rao).

    At best: of a fit that knows which cells are touched, takes nothing for granted about how hard,
    and knows the others' resistance, or (second) only that it is the same for all.
    """
    circuit, curve = Circuit(), PressureCurve()
    cells = circuit.rows * circuit.cols
    rng = np.random.default_rng(seed)
    force, adc = frames(family, "ideal", n, rng, circuit, curve)
    std = np.empty((2, n))
    for k in range(n):
        resistance = curve.resistance(force[k])
        steps = jacobian(circuit, resistance).reshape(cells, cells) * resistance.ravel()
        touched = force[k].ravel() > 0
        pattern = np.square(adc[k]).ravel() / circuit.r_ref  # - d adc / d R_par
        for row, unknown in enumerate((steps[:, touched], np.c_[steps[:, touched], steps.sum(1)])):
            u, scale, _ = np.linalg.svd(unknown, full_matrices=False)
            u = u[:, scale > 1e-9 * scale[0]]
            left = np.linalg.norm(pattern - u @ (u.T @ pattern)) * circuit.full_scale
            std[row, k] = SCAN_NOISE / max(left, 1e-9)
    quantiles = np.quantile(std, (0.5, 0.9), axis=1).T.tolist()
    return {"family": family, "frames": n, "rest known": quantiles[0], "rest alike": quantiles[1]}
