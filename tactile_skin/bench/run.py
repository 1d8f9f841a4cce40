"""The parts in turn: measure, write the numbers, draw what was written."""

from __future__ import annotations

import time
from pathlib import Path

from ..replay import methods
from ..solvers import METHODS
from . import cases, chart, growth, speed, stability, touch_to_stop, way
from .damage import reliability
from .measure import machine

PARTS = {  # name -> module, and the arguments of its `measure` in full and quick
    "speed": (speed, {"n": 300, "day_frames": 6000}, {"n": 6, "day_frames": 200}),
    "cases": (cases, {"n": 4}, {"n": 1}),
    "stability": (stability, {"n": 100, "boards": 2}, {"n": 2, "boards": 1}),
    "growth": (growth, {"n": 60}, {"n": 4}),
    "way": (
        way,
        {"methods": tuple(METHODS), "seconds": 6.0, "long": 60.0, "skins": way.SKINS},
        {"methods": ("naive", "auto"), "seconds": 0.5, "long": 0.5, "skins": (2,)},
    ),
    "touch_to_stop": (touch_to_stop, {"pushes": 40, "cuts": 10}, {"pushes": 1, "cuts": 1}),
    "faults": (reliability, reliability.FULL, reliability.QUICK),
    "recorded": (methods, {"n": 1000}, {"n": 30}),
}
ON_REQUEST = "faults", "recorded"  # longer than all others together; needs a file


def run(parts, out: Path, quick: bool, seed: int, tqdm, given=None) -> dict[str, dict]:
    """Measure the parts and write NAME.json and NAME.png for each of their figures.

    Args:
        tqdm: progress bar, wraps a list.
        given: part -> arguments of its `measure` in place of those in PARTS.

    Returns:
        name -> what stands in its JSON.

    Raises:
        ModuleNotFoundError: matplotlib is not installed; nothing was measured.
        OSError: the folder cannot be made.
    """
    chart.prepare()
    out.mkdir(parents=True, exist_ok=True)
    about = {"seed": seed, "quick": quick, "machine": machine()}
    written = {}
    for part in parts:
        module, full, short = PARTS[part]

        def track(items, part=part):
            return tqdm(items, desc=f"{part:<9}", disable=None)

        start = time.monotonic()
        arguments = (short if quick else full) | (given or {}).get(part, {})
        figures = module.measure(**arguments, seed=seed, track=track)
        about_part = about | {"seconds": round(time.monotonic() - start, 1)}
        for name, data in figures.items():
            written[name] = about_part | data
            chart.write(out, name, written[name], module.DRAW[name])
    return written
