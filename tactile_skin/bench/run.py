"""The parts in turn: measure, write the numbers, draw what was written."""

from __future__ import annotations

import time
from pathlib import Path

from ..replay import methods
from . import cases, chart, speed, stability
from .measure import machine

PARTS = {  # name -> module, and the arguments of its `measure` in full and quick
    "speed": (speed, {"n": 300, "day_frames": 6000}, {"n": 6, "day_frames": 200}),
    "cases": (cases, {"n": 4}, {"n": 1}),
    "stability": (stability, {"n": 100, "boards": 2}, {"n": 2, "boards": 1}),
    "recorded": (methods, {"n": 1000}, {"n": 30}),
}
ON_REQUEST = ("recorded",)  # needs a file
MOVED = {  # parts that are run from a checkout
    "faults": "benchmarks.faults",
    "growth": "benchmarks.accuracy.growth",
    "way": "benchmarks.running.way",
    "touch_to_stop": "benchmarks.running.touch_to_stop",
}


def run(parts, out: Path, quick: bool, seed: int, tqdm, given=None) -> dict[str, dict]:
    """Measure parts of PARTS, and write NAME.json and NAME.png for each of their figures.

    Args:
        tqdm: progress bar, wraps a list.
        given: part -> arguments of its `measure` in place of those in PARTS.

    Returns:
        name -> what stands in its JSON.

    Raises:
        ModuleNotFoundError: matplotlib is not installed; nothing was measured.
        OSError: the folder cannot be made.
    """
    written = {}
    for part in parts:
        module, full, short = PARTS[part]
        arguments = (short if quick else full) | (given or {}).get(part, {})
        written |= figures_of(module, arguments, out, quick, seed, tqdm)
    return written


def figures_of(module, arguments: dict, out: Path, quick: bool, seed: int, tqdm) -> dict[str, dict]:
    """Measure one part; a module with `measure` and DRAW. Otherwise as `run`."""
    chart.prepare()
    out.mkdir(parents=True, exist_ok=True)

    def track(items):
        return tqdm(items, desc=module.__name__.rpartition(".")[2], disable=None)

    start = time.monotonic()
    figures = module.measure(**arguments, seed=seed, track=track)
    about = {"seed": seed, "quick": quick, "machine": machine()}
    about["seconds"] = round(time.monotonic() - start, 1)
    for name, data in figures.items():
        chart.write(out, name, about | data, module.DRAW[name])
    return {name: about | data for name, data in figures.items()}
