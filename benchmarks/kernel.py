# SPDX-License-Identifier: Apache-2.0
"""Shows what a frame costs, and how much more without the compiled loops.

    python -m benchmarks.kernel [--frames N] [--data FOLDER]

Every frame of `compensate(..., method="auto")` is solved with the loops compiled and in NumPy,
in turns and by one thread, and the thread's time is taken: what else the machine does is left out.
Hardly one loop alone is worth its C: it is the group that has to make frames of each scene and size
at least 1.15 times faster. FOLDER holds recordings of a floating insole (.npz): N frames from the
middle of each foot's are played as a stream.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from support import insole

from tactile_skin.bench.measure import NOISE, Clock, frames, moving_touch
from tactile_skin.physics import compiled
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.solvers import Estimate, compensate

from .accuracy.boards import recordings

SIZES = 8, 16, 32, 64
SCENES = "bodies", "moving touch", "exact bodies"
FRAMES = 60  # of each scene and size
REPEATS = 4  # of a frame, of which the fastest counts: whatever disturbs one only adds
SEED = 340_836
IN_TURNS = "compiled", "in NumPy"


class Row(NamedTuple):
    """Attributes:
    scene, size: what was solved.
    compiled, plain: median time of a frame [y]: each one's fastest over that of the y next to it.
    late: 99th percentile of the compiled ones [y].
    ratio: median over the frames of time in NumPy over time compiled.
    """

    scene: str
    size: str
    compiled: float
    late: float
    plain: float
    ratio: float


def drawn(scene: str, n: int, circuit: Circuit, curve: PressureCurve) -> np.ndarray:
    """Return (n, rows, cols) `scan` readings."""
    rng = np.random.default_rng([SEED, SCENES.index(scene), circuit.rows])
    if scene != "moving touch":
        kind = "scan" if scene == "bodies" else "ideal"
        return frames("bodies", kind, n, rng, circuit, curve)[1]
    force = np.minimum(moving_touch(n, rng, circuit.shape), curve.max_force)
    return scenes.read_out(circuit, forward(circuit, curve.resistance(force)), "scan", rng)


def measure(scene: str, size: int, n: int) -> Row:
    """Solve n frames of a scene; a moving touch goes on from the frame before."""
    circuit, curve = Circuit(size, size), PressureCurve()
    given = {"noise": 0.0 if scene == "exact bodies" else NOISE["scan"]}
    frames = drawn(scene, n, circuit, curve)
    return solve(scene, frames, circuit, curve, given, streamed=scene == "moving touch")


def footprints(folder: Path, n: int) -> Iterator[Row]:
    """Solve frames of real insoles as streams."""
    for name, counts in recordings(folder, n):
        skin, begin = insole.circuit(counts[0] >= 0), max(0, (len(counts) - n) // 2)
        given = {"noise": insole.NOISE, "threshold": insole.ratio(insole.THRESHOLD)}
        adc = insole.ratio(counts[begin : begin + n].astype(float))
        adc = np.where(skin.populated, adc, np.nan)
        yield solve(name, adc, skin, insole.curve(), given, streamed=True)


def solve(scene: str, frames, circuit: Circuit, curve, given: dict, streamed: bool) -> Row:
    """Solve (n, rows, cols) readings by both implementations."""
    taken, last = np.full((len(frames), len(IN_TURNS)), np.inf), None
    loops = compiled.library, None
    for k, adc in enumerate(frames):
        found: Estimate | None = None
        clock = Clock()
        for _ in range(REPEATS):
            for form, loop in enumerate(loops):
                compiled.library = loop
                start = time.thread_time()
                found = compensate(adc, circuit, curve, start=last, **given)
                taken[k, form] = min(taken[k, form], time.thread_time() - start)
            clock(int)  # y
        compiled.library = loops[0]
        taken[k] /= min(clock.solves)
        last = found if streamed else None
    (fast, plain), late = np.median(taken, 0), np.percentile(taken[:, 0], 99)
    size = f"{circuit.rows}x{circuit.cols}"
    return Row(scene, size, fast, float(late), plain, float(np.median(taken[:, 1] / taken[:, 0])))


def measured(n: int, data: Path | None = None) -> Iterator[Row]:
    """Measure every scene in every size, then the recordings."""
    if compiled.implementation() != "compiled":
        raise SystemExit("nothing is compiled: install a C compiler, then run `pip install -e .`")
    rows = (measure(scene, size, n) for scene in SCENES for size in SIZES)
    return chain(rows, footprints(data, n) if data else ())


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.kernel",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--frames", type=int, default=FRAMES, metavar="N")
    parser.add_argument("--data", type=Path, metavar="FOLDER")
    args = parser.parse_args(arguments)
    print(f"{'scene':<20} {'size':>6}   compiled        p99   in NumPy   times")
    for row in measured(args.frames, args.data):
        print(
            f"{row.scene:<20} {row.size:>6} {row.compiled:8.2f} y {row.late:8.2f} y "
            f"{row.plain:8.2f} y {row.ratio:7.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
