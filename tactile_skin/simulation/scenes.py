# SPDX-License-Identifier: Apache-2.0
"""Pressure scenes: what a skin may feel, as force per cell.

Three families are the paper's (section V-B): Gaussian blobs in random rectangles, filled
rectangles, and random matrices. Its text leaves the numbers open; the ones here are this
project's, and every figure names them. Two more are nearer to real touches (bodies.py).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import GRAM
from .bodies import bodies, pictures
from .matrix import OVERSAMPLED
from .people.hands import Person, perform
from .people.mat import Mat

FAMILIES = ("blobs", "rects", "random")  # the paper's
_FREE = {"bodies": bodies, "pictures": pictures}
MAX_LOAD = 1000.0  # g a cell, as the paper's
_SIDE = (2, 9)  # cells, shortest and longest side of a rectangle
_NOISE = 0.05  # relative, of each cell
_GESTURES = ("tap", "stroke", "tickle", "pat", "press", "hold")  # of the scene of that name
_PERSON = 203  # who makes them; the shipped recogniser has not seen this one
_PITCH = 0.018  # m, of the mat that is touched
_STEP = 0.01  # s between its pictures
_PAUSE = 1.5  # s between two gestures
_RAMP = 0.15  # s in which a part of the demo comes, and in which it goes
_MEASURED = 2.0  # s at the begin in which the rest is measured


def sample(family: str, n: int, rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Draw n scenes of one family: (n, rows, cols) force per cell [N], at most 1 kg of load.

    blobs: 1 to 4 rectangles of 2 to 9 cells a side, each a*exp(-(dy/(h/3))^2 - (dx/(w/3))^2) about
    its middle, a = U(0, 1000) g, 5 % multiplicative noise a cell, summed. rects: the same, filled
    constant. random: U(0, 1) a cell times one U(0, 1) * 1000 g. bodies: one to four free bodies
    off the grid. pictures: recorded ones, scaled, turned and cropped (bodies.py).

    Raises:
        ValueError: an unknown family.
    """
    if family == "random":
        scale = rng.uniform(0.0, MAX_LOAD, (n, 1, 1))
        return rng.uniform(0.0, 1.0, (n, rows, cols)) * scale * GRAM
    if family in _FREE:
        return np.clip(_FREE[family](n, rows, cols, rng), 0.0, MAX_LOAD) * GRAM
    if family not in FAMILIES:
        raise ValueError(f"family {family!r}: must be one of {', '.join((*FAMILIES, *_FREE))}")
    load = np.zeros((n, rows, cols))
    count = rng.integers(1, 5, n)
    y, x = np.arange(rows)[:, None], np.arange(cols)[None, :]
    for k in range(4):
        h = _column(np.minimum(rng.integers(_SIDE[0], _SIDE[1] + 1, n), rows))
        w = _column(np.minimum(rng.integers(_SIDE[0], _SIDE[1] + 1, n), cols))
        top = rng.integers(0, rows - h + 1)
        left = rng.integers(0, cols - w + 1)
        amplitude = _column(rng.uniform(0.0, MAX_LOAD, n))
        inside = (y >= top) & (y < top + h) & (x >= left) & (x < left + w)
        inside &= _column(count > k)
        shape: float | np.ndarray = 1.0
        if family == "blobs":
            dy, dx = y - (top + (h - 1) / 2), x - (left + (w - 1) / 2)
            shape = np.exp(-((dy / (h / 3)) ** 2) - (dx / (w / 3)) ** 2)
        noise = 1.0 + _NOISE * rng.standard_normal((n, rows, cols))
        load += np.where(inside, amplitude * shape * noise, 0.0)
    return np.clip(load, 0.0, MAX_LOAD) * GRAM


def _column(values: np.ndarray) -> np.ndarray:
    return values[:, None, None]


READOUTS = ("ideal", "adc10", "scan")


def read_out(circuit: Circuit, adc: np.ndarray, readout: str, rng: np.random.Generator):
    """Return what a board makes of the ideal ADC ratio, same shape.

    ideal: nothing. adc10: rounded to the circuit's ADC steps (10 bits, by default). scan: 1 ADC
    step RMS noise on each sample, rounded, mean of 4 scans - what a board of 390 scans a second
    has for each of 100 frames a second.

    Raises:
        ValueError: an unknown readout.
    """
    if readout == "ideal":
        return adc
    steps = adc * circuit.full_scale
    if readout == "adc10":
        return np.rint(steps) / circuit.full_scale
    if readout != "scan":
        raise ValueError(f"readout {readout!r}: must be one of {', '.join(READOUTS)}")
    total = sum(np.rint(steps + rng.standard_normal(adc.shape)) for _ in range(OVERSAMPLED))
    return np.clip(total / OVERSAMPLED, 0.0, circuit.full_scale) / circuit.full_scale


# --- scripted scenes: functions of time, for the simulated board ---------------------------------


def finger(rows: int, cols: int, row: float, col: float, newtons: float, width: float = 0.9):
    """Return a fingertip pressed at (row, col): (rows, cols) force [N]; width: std in cells."""
    y, x = np.arange(rows)[:, None], np.arange(cols)[None, :]
    distance2 = (y - row) ** 2 + (x - col) ** 2
    shape = np.where(distance2 < (3.0 * width) ** 2, np.exp(-distance2 / (2 * width**2)), 0.0)
    return newtons * shape / shape.sum()


def _pulse(t: float, start: float, end: float) -> float:
    """0 outside (start, end), 1 within, raised-cosine flanks [s]."""
    if not start < t < end:
        return 0.0
    edge = min(t - start, end - t) / _RAMP
    return 1.0 if edge >= 1.0 else 0.5 - 0.5 * np.cos(np.pi * edge)


def _idle(t, rows, cols):
    return np.zeros((rows, cols))


def _one_finger(t, rows, cols):
    return finger(rows, cols, 0.35 * rows, 0.6 * cols, 4.0)


def _two_fingers(t, rows, cols):
    """Two corners of a rectangle: the other two are where the naive method sees ghosts."""
    first = finger(rows, cols, 0.25 * rows, 0.3 * cols, 12.0)
    return first + finger(rows, cols, 0.7 * rows, 0.75 * cols, 12.0)


def _push_left(t, rows, cols):
    """Return a palm on the robot's left: high columns, see geometry.py."""
    return finger(rows, cols, 0.5 * (rows - 1), cols - 3.0, 60.0, width=1.6)


def _stroke(t, rows, cols):
    """Return a finger drawn across the columns, there and back in 4 s."""
    phase = 0.5 - 0.5 * np.cos(2 * np.pi * t / 4.0)
    return finger(rows, cols, 0.5 * (rows - 1), 2.0 + phase * (cols - 5.0), 5.0)


_DEMO = (  # start [s], end [s], what is done; the rest is measured first
    (2.0, 4.0, _one_finger),
    (4.5, 8.0, _two_fingers),
    (9.0, 11.5, _push_left),
    (12.5, 16.5, _stroke),
)
_DEMO_PERIOD = 18.0  # s


def _demo(t, rows, cols):
    """Idle, one finger, two fingers, a push from the left, a stroke; then again."""
    t %= _DEMO_PERIOD
    force = np.zeros((rows, cols))
    for start, end, scene in _DEMO:
        level = _pulse(t, start, end)
        if level > 0.0:
            force += level * scene(t - start, rows, cols)
    return force


@lru_cache(maxsize=2)
def _performed(rows: int, cols: int) -> np.ndarray:
    """Return (T, rows, cols) of a person's gestures, one after the other [N]."""
    mat, person = Mat(rows, cols, _PITCH), Person(_PERSON)
    parts = [np.zeros((round(_MEASURED / _STEP), rows, cols))]
    for seed, gesture in enumerate(_GESTURES):
        parts.append(perform(gesture, person, mat, seed, _STEP))
        parts.append(np.zeros((round(_PAUSE / _STEP), rows, cols)))
    return np.concatenate(parts)


def _gestures(t, rows, cols):
    pictures = _performed(rows, cols)
    return pictures[int(t / _STEP) % len(pictures)]


_ALL = _demo, _gestures, _idle, _one_finger, _two_fingers, _push_left, _stroke
SCRIPTS = {scene.__name__[1:]: scene for scene in _ALL}


def script(name: str, rows: int, cols: int):
    """Return a scripted scene: function of the time [s] that gives (rows, cols) force per cell [N].

    Raises:
        ValueError: an unknown name.
    """
    if name not in SCRIPTS:
        raise ValueError(f"scene {name!r}: must be one of {', '.join(SCRIPTS)}")
    scene = SCRIPTS[name]
    scene(0.0, rows, cols)  # what it prepares is there at a board's first scan
    return lambda t: scene(t, rows, cols)
