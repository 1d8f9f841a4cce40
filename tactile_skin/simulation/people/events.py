# SPDX-License-Identifier: Apache-2.0
"""What touches a robot and is no gesture: bodies that lean or sit, things laid on, walls, cloth.

As in `hands`, the numbers are chosen to be broad, and come from no recording.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .hands import Hand, Person, pressed, pulse, ramp
from .mat import FINE, Mat, texture


def over(mat: Mat, shape: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return (T, rows, cols) of one shape that presses with a force over time."""
    cells = mat.cells(shape)
    return force[:, None, None] * cells / max(cells.sum(), 1e-9)


def _place(mat: Mat, rng: np.random.Generator) -> np.ndarray:
    return mat.size * rng.uniform(0.2, 0.8, 2)


def _body(mat: Mat, t, force, rng: np.random.Generator, rocking: float) -> np.ndarray:
    """Return what a chest, a forearm or a lap presses that rocks by so much [m]."""
    angle, at = rng.uniform(0.0, np.pi), mat.size * rng.uniform(0.3, 0.7, 2)
    if rng.random() < 0.67:
        radii = rng.uniform(0.3, 0.75, 2) * mat.size
    else:  # a forearm
        radii = np.array([0.6 * mat.size.max(), rng.uniform(0.03, 0.05)])
    cloth = texture(mat, rng.uniform(0.25, 0.8), rng)
    sway = rocking * np.sin(2 * np.pi * rng.uniform(0.2, 0.7) * t + rng.uniform(0.0, 6.0))
    out = np.zeros((len(t), mat.rows, mat.cols))
    for k in force.nonzero()[0]:
        u, v = mat.around(at + np.array([sway[k], 0.0]), angle)
        shape = np.maximum(1.0 - (u / radii[0]) ** 2 - (v / radii[1]) ** 2, 0.0)
        out[k] = over(mat, np.sqrt(shape) * cloth, force[k : k + 1])[0]
    return out


def _lean(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    duration = rng.uniform(2.0, 9.0)
    t = np.arange(0.0, duration, period)
    force = ramp(t, duration, rng.uniform(0.3, 1.5), rng.uniform(0.3, 1.5))
    force *= np.exp(rng.uniform(2.3, 5.2))
    wave = np.sin(2 * np.pi * rng.uniform(0.15, 0.8) * t + rng.uniform(0.0, 6.0))
    force *= 1.0 + rng.uniform(0.0, 0.4) * wave
    return _body(mat, t, force, rng, rng.uniform(0.005, 0.05))


def _sit(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    duration = rng.uniform(3.0, 10.0)
    t = np.arange(0.0, duration, period)
    # per 20 ms: a walk that depends on the time, not on the pictures
    restless = rng.normal(0.0, 0.03 * np.sqrt(period / 0.02), len(t))
    force = ramp(t, duration, 0.5, 0.5) * rng.uniform(60.0, 200.0)
    force *= 0.6 + np.abs(np.cumsum(restless)) % 0.8
    return _body(mat, t, force, rng, 0.03)


def _box(mat: Mat, rng: np.random.Generator, size, angle: float, tilt: float) -> np.ndarray:
    u, v = mat.around(_place(mat, rng), angle)
    slope = rng.normal(0.0, tilt, 2)
    inside = (np.abs(u) < size[0] / 2) & (np.abs(v) < size[1] / 2)
    return inside * np.clip(1.0 + slope[0] * u / size[0] + slope[1] * v / size[1], 0.05, None)


def _thing(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    duration = rng.uniform(2.0, 8.0)
    t = np.arange(0.0, duration, period)
    shape = _box(mat, rng, rng.uniform(0.02, 0.2, 2), rng.uniform(0.0, 3.0), 0.6)
    force = ramp(t, duration, rng.uniform(0.04, 0.3), rng.uniform(0.05, 0.3))
    swing = np.exp(-t / 0.08) * np.cos(2 * np.pi * rng.uniform(5.0, 12.0) * t)
    force = force * np.exp(rng.uniform(0.7, 3.5)) * (1.0 + rng.uniform(0.0, 0.8) * swing)
    return over(mat, shape * texture(mat, 0.6, rng), force)


def _dropped(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    """Return (T, rows, cols) of a thing that drops on the mat, jumps and lies, or rolls off."""
    t = np.arange(0.0, rng.uniform(0.4, 3.0), period)
    shape = _box(mat, rng, rng.uniform(0.01, 0.12, 2), rng.uniform(0.0, 3.0), 1.0)
    force, start, height = np.zeros(len(t)), 0.04, np.exp(rng.uniform(2.0, 4.5))
    gap = rng.uniform(0.08, 0.25)
    while gap > 0.02:
        force += height * pulse(t, start, rng.uniform(0.02, 0.06), 0.3)
        start, height, gap = start + gap, height * rng.uniform(0.2, 0.6), gap * 0.6
    if rng.random() < 0.5:
        force += np.exp(rng.uniform(-0.5, 2.0)) * (t > start) * (t < t[-1] - 0.1)
    return over(mat, shape, force)


def _wall(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    """Return (T, rows, cols) of a robot that drives against a wall, an edge or a door frame."""
    duration = rng.uniform(0.06, 0.35) if rng.random() < 0.6 else rng.uniform(0.4, 3.0)
    t = np.arange(0.0, duration + 0.1, period)
    size = (rng.uniform(0.08, 0.4), rng.uniform(0.006, 0.03))
    shape = _box(mat, rng, size, rng.uniform(0.0, 3.0), 0.8)
    force = np.exp(rng.uniform(2.5, 5.0)) * pulse(t, 0.02, duration, rng.uniform(0.15, 0.5))
    return over(mat, shape, force)


def _cloth(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    t = np.arange(0.0, rng.uniform(0.4, 5.0), period)
    at, drift = _place(mat, rng), rng.normal(0.0, 0.08, 2)
    folds, total = texture(mat, 1.2, rng), np.exp(rng.uniform(-1.0, 1.2))
    out = np.zeros((len(t), mat.rows, mat.cols))
    for k, now in enumerate(t):
        u, v = mat.around(at + drift * now, 0.0)
        shape = np.maximum(1.0 - (u / 0.09) ** 2 - (v / 0.05) ** 2, 0.0)
        flutter = 1.0 + 0.6 * np.sin(2 * np.pi * 1.3 * now) + 0.3 * rng.standard_normal()
        moved = np.roll(folds, int(now / 0.06) * (FINE - 2), 1)
        out[k] = over(mat, shape * moved, np.array([total * max(0.0, flutter)]))[0]
    return out


def _carry(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    """Somebody carries the robot between two flat hands, and walks."""
    duration = rng.uniform(3.0, 9.0)
    t, person = np.arange(0.0, duration, period), Person(int(rng.integers(1_000_000)))
    step = np.sin(2 * np.pi * rng.uniform(1.4, 2.2) * t)
    force = ramp(t, duration, 0.6, 0.5) * np.exp(rng.uniform(2.5, 4.3))
    force *= 1.0 + rng.uniform(0.1, 0.45) * step
    out = np.zeros((len(t), mat.rows, mat.cols))
    for share in (0.2, 0.8):
        at = np.repeat([mat.size * (share, rng.uniform(0.3, 0.7))], len(t), 0)
        out += pressed(mat, Hand("flat", force, at, rng.normal(0.0, 0.5)), person, rng, period)
    return out


def _shaken(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    """Return (T, rows, cols) of a cover or a cable that the robot's own motion presses on."""
    t = np.arange(0.0, rng.uniform(1.0, 6.0), period)
    wave = np.sin(2 * np.pi * rng.uniform(1.0, 9.0) * t + rng.uniform(0.0, 6.0))
    force = np.exp(rng.uniform(-0.5, 2.5)) * np.clip(wave + rng.uniform(-0.5, 1.0), 0.0, None)
    size = (rng.uniform(0.03, 0.3), rng.uniform(0.004, 0.02))
    return over(mat, _box(mat, rng, size, rng.uniform(0.0, 3.0), 0.5), force)


def _flicker(mat: Mat, rng: np.random.Generator, period: float) -> np.ndarray:
    """Return (T, rows, cols) of a cell or two that come and go: bad, or a large thing's rim."""
    t = np.arange(0.0, rng.uniform(0.1, 3.0), period)
    out = np.zeros((len(t), mat.rows, mat.cols))
    row, col = int(rng.integers(mat.rows)), int(rng.integers(mat.cols))
    cells = [(row, col), (row, min(col + 1, mat.cols - 1))][: rng.integers(1, 3)]
    seconds = np.exp(rng.uniform(-3.0, 0.5))  # that it stays
    for cell in cells:
        start = rng.uniform(0.0, seconds)
        while start < t[-1]:
            force = np.exp(rng.uniform(-2.3, 0.3))
            while_on = (t >= start) & (t < start + seconds * rng.uniform(0.5, 1.5))
            out[:, cell[0], cell[1]][while_on] = force
            start += seconds * rng.uniform(1.2, 6.0)
    return out


_ALL = _lean, _sit, _thing, _dropped, _wall, _cloth, _carry, _shaken, _flicker
EVENTS: dict[str, Callable[[Mat, np.random.Generator, float], np.ndarray]] = {
    event.__name__[1:]: event for event in _ALL
}


def happen(event: str, mat: Mat, seed: int, period: float) -> np.ndarray:
    """Return what an event of EVENTS presses, by its seed: (T, rows, cols) [N]."""
    rng = np.random.default_rng([seed, list(EVENTS).index(event), 3])
    return EVENTS[event](mat, rng, period)
