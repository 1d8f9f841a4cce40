# SPDX-License-Identifier: Apache-2.0
"""What every part measures with: time in y, errors in grams, and the machine's name."""

from __future__ import annotations

import contextlib
import os
import platform
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ..physics.circuit import Circuit, forward
from ..physics.compiled import implementation
from ..physics.curve import GRAM, PressureCurve
from ..simulation import scenes
from ..solvers import METHODS, compensate
from ..solvers.reading import ROUNDING_NOISE, SCAN_NOISE
from ..touch.geometry import PITCH

GHOST = 20.0  # g on a cell that nothing touches
_SPEED = 0.3  # m/s of a touch that wanders
_RATE = 100.0  # frames a second
_DENSE = np.random.default_rng(0).standard_normal((257, 258))


Skin = tuple[Circuit, PressureCurve, np.ndarray | None]  # forces of a recording [N], or None


def usable(circuit: Circuit, curve: PressureCurve) -> list[str]:
    """Return the methods that a skin can be solved by: networks know what they are trained for."""
    found = []
    for method in METHODS:
        with contextlib.suppress(ValueError):
            compensate(np.full(circuit.shape, 0.05), circuit, curve, method)
            found.append(method)
    return found


def forces_of(frames: np.ndarray, n: int, circuit: Circuit, curve: PressureCurve) -> np.ndarray:
    """Return what `map` feels in n of the hardest of (frames, rows, cols) ADC ratio [N]."""
    hardest = np.argsort(-np.nansum(frames, (1, 2)))[: 4 * n : 4]
    return compensate(frames[hardest], circuit, curve, "map", missing=True).force


class Clock:
    """Times calls in thread time, each beside y: one dense solve of 257 equations."""

    def __init__(self):
        self.calls, self.solves = [], []  # s

    def __call__(self, function, *args, **kwargs):
        start = time.thread_time()
        np.linalg.solve(_DENSE[:, :257], _DENSE[:, 257])
        between = time.thread_time()
        result = function(*args, **kwargs)
        self.calls.append(time.thread_time() - between)
        self.solves.append(between - start)
        return result

    @property
    def y(self) -> float:
        """Median time of one dense solve [s]."""
        return float(np.median(self.solves))

    def quantile(self, q: float) -> float:
        """Of the calls' times, in y."""
        return float(np.quantile(self.calls, q) / self.y)

    @property
    def mean(self) -> float:
        """Mean time of a call, in y."""
        return float(np.mean(self.calls) / np.mean(self.solves))


def errors(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """How far (n, rows, cols) forces found [N] are from the true ones.

    Returns:
        mean_g, p95_g and worst_g over all cells [g]; sum_error, median relative error of a
        frame's sum; ghosts, cells a frame with more than 20 g where nothing is.
    """
    error = np.abs(found - truth) / GRAM
    total = truth.sum((1, 2))
    ghosts = (found / GRAM > GHOST) & (truth == 0)
    return {
        "mean_g": float(error.mean()),
        "p95_g": float(np.percentile(error, 95)),
        "worst_g": float(error.max()),
        "sum_error": float(np.median(np.abs(found.sum((1, 2)) - total) / np.maximum(total, 1e-9))),
        "ghosts": float(ghosts.sum((1, 2)).mean()),
    }


# RMS noise of each readout [ADC steps]: a running skin has measured its own
NOISE = {"ideal": 0.0, "adc10": ROUNDING_NOISE, "scan": SCAN_NOISE}


def frames(family: str, readout: str, n: int, rng, circuit: Circuit, curve: PressureCurve):
    """n scenes of one family and their readings: force [N], ADC ratio, each (n, rows, cols)."""
    force = np.minimum(scenes.sample(family, n, *circuit.shape, rng), curve.max_force)
    adc = forward(circuit, curve.resistance(force))
    return force, scenes.read_out(circuit, adc, readout, rng)


def moving_touch(n: int, rng, shape=(16, 16)):
    """(n, rows, cols) force [N]: a round touch of 25 mm that wanders over a skin."""
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None]
    step = _SPEED / _RATE / PITCH  # cells a frame
    ends = np.array(shape) - 3
    place = rng.uniform(4, ends - 1)
    heading, load = rng.uniform(0, 2 * np.pi), rng.uniform(100, 800)
    force = np.empty((n, *shape))
    for k in range(n):
        heading += 0.1 * rng.standard_normal()
        place = np.clip(place + step * np.array([np.sin(heading), np.cos(heading)]), 2, ends)
        distance = np.hypot(y - place[0], x - place[1])
        force[k] = load * np.maximum(1.0 - (distance / 2.2) ** 2, 0.0) ** 1.5
    return force * GRAM


def day(n: int, rng, circuit: Circuit, curve: PressureCurve):
    """Return a day-like stream: 70 % of the frames idle, 20 % one moving touch, 10 % three.

    Returns:
        force [N] and `scan` readings, at least n frames, in runs of 50.
    """
    scene = []
    while len(scene) < n:
        touches = (0, 1, 3)[rng.choice(3, p=(0.7, 0.2, 0.1))]
        total = sum((moving_touch(50, rng) for _ in range(touches)), np.zeros((50, *circuit.shape)))
        scene += list(np.minimum(total, curve.max_force))
    force = np.array(scene)
    adc = forward(circuit, curve.resistance(force))
    return force, scenes.read_out(circuit, adc, "scan", rng)


def machine() -> dict[str, str]:
    """Processor, cores and the versions that times depend on."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = (line.split(":", 1) for line in info.read_text().splitlines() if ":" in line)
        model = {key.strip(): value.strip() for key, value in lines}.get("model name", model)
    libraries = {name: version(name) for name in ("numpy", "scipy", "matplotlib")}
    return {
        "processor": model,
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        "kernel": implementation(),
    } | libraries
