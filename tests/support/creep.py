# SPDX-License-Identifier: Apache-2.0
"""Loads that stand on boards that creep, and what the calibration makes of them."""

from __future__ import annotations

import numpy as np

from support.lab.unknown import Creeping
from support.weights import bodies, known, objects
from tactile_skin import compensate, fit_curve, identify, measure_rest
from tactile_skin.calibration.creep import LAID, Standing, as_it_comes, measure_creep
from tactile_skin.physics.creep import Creep


def calibrated(skin: Creeping, objects_n: int, touches: int, seed: int):
    """circuit, rest, curve of a load that has just come, creep: all measured."""
    shape = skin.supposed.shape
    idle, circuit = skin.at_rest(), known(skin)
    if touches:
        pressed = skin.frames(bodies(touches, shape, np.random.default_rng([seed, 1])))
        circuit = identify(pressed, skin.supposed, measure_rest(idle, skin.supposed)).circuit
    rest = measure_rest(idle, circuit)
    laid, weights = objects(objects_n, shape, np.random.default_rng([seed, 2]))
    times = np.array([0.0, LAID])
    frames = np.array([skin.standing(times, force, np.ones(2))[1] for force in laid])
    curve = fit_curve(frames, weights, circuit, rest).curve
    heavy = laid[np.argsort(weights)[-3]]
    times = np.arange(0.0, 120.0, 0.5)
    creep = measure_creep(
        skin.standing(times, heavy, np.ones(times.size)), times, circuit, rest, curve
    )
    return circuit, rest, as_it_comes(curve, creep), creep


def felt(frames, times, circuit, rest, curve, creep: Creep) -> tuple[np.ndarray, np.ndarray]:
    """(n,) totals [N], as found and with the creep taken out."""
    standing = Standing(creep, curve)
    tared = curve.resting_at(1.0 / rest.conductance)
    raw, out, last = [], [], None
    for t, adc in zip(times, frames, strict=True):
        last = compensate(adc, circuit, tared, "map", start=last)
        raw.append(last.force.sum())
        out.append(standing.update(t, last.force).sum())
    return np.array(raw), np.array(out)
