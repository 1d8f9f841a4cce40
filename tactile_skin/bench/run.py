# SPDX-License-Identifier: Apache-2.0
"""The parts in turn: measure, write the numbers, draw what was written."""

from __future__ import annotations

import time
from pathlib import Path

from ..middleware.threads import one_thread
from . import chart, speed, stability
from .measure import machine

PARTS = {  # name -> module, and the arguments of its `measure` in full and quick
    "speed": (speed, {"n": 300, "day_frames": 6000}, {"n": 6, "day_frames": 1000}),
    "stability": (stability, {"n": 100, "boards": 2}, {"n": 2, "boards": 1, "learnt": 8}),
}


def figures_of(module, arguments: dict, out: Path, quick: bool, seed: int, tqdm) -> dict[str, dict]:
    """Measure a part, write NAME.json and NAME.png of its figures; return name -> JSON.

    Args:
        module: of the part, with `measure`, which takes the arguments, and DRAW.

    Raises:
        ModuleNotFoundError: matplotlib is not installed; nothing was measured.
        OSError: the folder cannot be made.
    """
    chart.prepare()
    out.mkdir(parents=True, exist_ok=True)

    def track(items):
        return tqdm(items, desc=module.__name__.rpartition(".")[2], disable=None)

    start = time.monotonic()
    with one_thread():  # as in a running skin: others would wait for one another
        figures = module.measure(**arguments, seed=seed, track=track)
    about = {"seed": seed, "quick": quick, "machine": machine()}
    about["seconds"] = round(time.monotonic() - start, 1)
    for name, data in figures.items():
        chart.write(out, name, about | data, module.DRAW[name])
    return {name: about | data for name, data in figures.items()}
