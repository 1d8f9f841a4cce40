# SPDX-License-Identifier: Apache-2.0
"""Contacts of any shape, course and path, which stand for what nobody has thought of.

A random field, cut off at a random level and size, presses in ramps, swells or bursts, and stands,
drifts, wanders or changes its shape: a recogniser that has seen only some kinds of events takes
others for the gesture that they look most like.
"""

from __future__ import annotations

import numpy as np

from .events import over
from .hands import pulse, ramp
from .mat import Mat

_SECONDS = (0.1, 8.0)  # of an event
_FORCE = (0.4, 150.0)  # N
_RADIUS = (0.004, 0.3)  # m
_GRAIN = (0.005, 0.06)  # m over which its pressure varies
_LEVELS = (-2.0, 1.5)  # standard deviations of its field that do not press: solid to scattered
_CORNERS = (2.0, 8.0)  # exponents of its outline: an ellipse, a box
_FLANK = (0.02, 1.0)  # s in which it comes and goes
_BURST = (0.03, 0.5)  # s
_GAP = (0.7, 4.0)  # durations of a burst from its start to the next one's
_SWELL = 2.0  # most that a force swells by, times its mean
_RATE = (0.2, 8.0)  # Hz of whatever wanders
_DRIFT = 0.08  # m/s, standard deviation
_WANDER = (0.003, 0.06)  # m
_CHANGES = 0.4  # share of events whose outline, and of those whose field, changes
_STRETCH = 0.3  # of the logarithm of its radii


def _log_uniform(rng: np.random.Generator, between: tuple[float, float], size=None):
    low, high = np.log(between)
    return np.exp(rng.uniform(low, high, size))


def _wander(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return (T,) a smooth course between -1 and 1."""
    n = int(rng.integers(1, 4))
    phase = 2 * np.pi * _log_uniform(rng, _RATE, n) * t[:, None] + rng.uniform(0.0, 2 * np.pi, n)
    return np.sin(phase) @ rng.dirichlet(np.ones(n))


def _ramps(t: np.ndarray, end: float, rng: np.random.Generator) -> np.ndarray:
    return ramp(t, end, *_log_uniform(rng, _FLANK, 2))


def _swells(t: np.ndarray, end: float, rng: np.random.Generator) -> np.ndarray:
    swell = rng.uniform(0.0, _SWELL) * _wander(t, rng)
    return _ramps(t, end, rng) * np.maximum(1.0 + swell, 0.0)


def _bursts(t: np.ndarray, end: float, rng: np.random.Generator) -> np.ndarray:
    force, start = np.zeros(len(t)), 0.0
    while start < end:
        duration = _log_uniform(rng, _BURST)
        force += pulse(t, start, duration, rng.uniform(0.1, 0.6)) * rng.lognormal(0.0, 0.5)
        start += duration * rng.uniform(*_GAP)
    return force


def _stands(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.zeros((len(t), 2))


def _drifts(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.normal(0.0, _DRIFT, 2) * t[:, None]


def _wanders(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return _log_uniform(rng, _WANDER) * np.stack([_wander(t, rng), _wander(t, rng)], 1)


def _field(mat: Mat, grain: float, rng: np.random.Generator) -> np.ndarray:
    """Return (rows * FINE, cols * FINE) a random field of mean 0 and std 1."""
    smooth = mat.noise(grain, rng)
    return (smooth - smooth.mean()) / smooth.std()


def anything(mat: Mat, seed: int, period: float) -> np.ndarray:
    """Return what one contact of any kind presses, by its seed: (T, rows, cols) [N]."""
    rng = np.random.default_rng([seed, 99, 3])
    end = float(_log_uniform(rng, _SECONDS))
    t = np.arange(0.0, end + period, period)
    course = (_ramps, _swells, _bursts)[rng.integers(3)]
    force = course(t, end, rng) * _log_uniform(rng, _FORCE)
    way = (_stands, _drifts, _wanders)[rng.integers(3)](t, rng)
    at, angle = mat.size * rng.uniform(0.15, 0.85, 2), rng.uniform(0.0, np.pi)
    radii, corners = _log_uniform(rng, _RADIUS, 2), rng.choice(_CORNERS)
    grain, level = _log_uniform(rng, _GRAIN), rng.uniform(*_LEVELS)
    one, other = _field(mat, grain, rng), _field(mat, grain, rng)
    turn = 2.0 * _wander(t, rng) * (rng.random() < _CHANGES)  # rad from one field to the other
    stretch = np.exp(_STRETCH * _wander(t, rng) * (rng.random() < _CHANGES))
    out = np.zeros((len(t), mat.rows, mat.cols))
    for k in force.nonzero()[0]:
        u, v = mat.around(at + way[k], angle)
        rim = np.abs(u / radii[0] / stretch[k]) ** corners
        rim = rim + np.abs(v / radii[1] / stretch[k]) ** corners
        field = np.cos(turn[k]) * one + np.sin(turn[k]) * other
        shape = np.sqrt(np.maximum(1.0 - rim, 0.0)) * np.maximum(field - level, 0.0)
        out[k] = over(mat, shape, force[k : k + 1])[0]
    return out
