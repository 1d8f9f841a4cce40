# SPDX-License-Identifier: Apache-2.0
"""The prior of `map` against none and the built-in one alone, on the same frames."""

from __future__ import annotations

from unittest import mock

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.measure import Clock
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.simulation.bodies import bodies
from tactile_skin.solvers import prior

CIRCUIT, CURVE = Circuit(), PressureCurve()
SIZES = {"small bodies": (0.7, 3.0), "large bodies": (0.7, 6.0)}  # cells, half of a side
# What the prior's numbers were chosen on and its network has learnt from.
TUNED = {
    "bodies": "other sizes, textures, counts",
    "small bodies": "other sizes, textures, counts",
    "large bodies": "other sizes, textures, counts",
    "pictures": "nothing",
    "blobs": "yes, other seeds",
    "rects": "yes, other seeds",
    "random": "level prior only",
}
METHODS = "newton", "built-in prior", "map"


def load(family: str, n: int, rng) -> np.ndarray:
    """(n, rows, cols) force [N]."""
    if family in SIZES:
        drawn = bodies(n, *CIRCUIT.shape, rng, half=SIZES[family])
        force = np.clip(drawn, 0.0, scenes.MAX_LOAD) * GRAM
    else:
        force = scenes.sample(family, n, *CIRCUIT.shape, rng)
    return np.minimum(force, CURVE.max_force)


def solve(method: str, frame, noise):
    if method != "built-in prior":
        return compensate(frame, CIRCUIT, CURVE, method, noise=noise)
    with mock.patch.object(prior, "with_neighbours", lambda *_: None):
        return compensate(frame, CIRCUIT, CURVE, "map", noise=noise)


def family(name: str, n: int, seed: int, noise) -> dict[str, dict]:
    """Of each method: error of the frames [g a cell], times [y], coverage, share suspect."""
    rng = np.random.default_rng([seed, list(TUNED).index(name)])
    force = load(name, n, rng)
    adc = scenes.read_out(CIRCUIT, forward(CIRCUIT, CURVE.resistance(force)), "scan", rng)
    touched, table = force > 0.0, {}
    for method in METHODS:
        for frame in adc[:3]:
            solve(method, frame, noise)
        clock = Clock()
        found = [clock(solve, method, frame, noise) for frame in adc]
        error = np.abs(np.array([e.force for e in found]) - force)
        within = error <= np.array([e.std for e in found])
        table[method] = {
            "error": error.mean((1, 2)) / GRAM,
            "y": (clock.quantile(0.5), clock.quantile(0.99)),
            "within": float(within[touched].mean()),
            "suspect": float(np.mean([e.status == "suspect" for e in found])),
            "failed": int(sum(e.status == "failed" for e in found)),
        }
    return table
