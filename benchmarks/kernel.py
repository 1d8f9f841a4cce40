# SPDX-License-Identifier: Apache-2.0
"""Shows what the compiled loops are worth: how much longer a frame takes without them.

    python -m benchmarks.kernel [--frames N]

Every frame of `compensate(..., method="auto")` is solved with the loops compiled and in NumPy,
in turns and by one thread, and the thread's time is taken: what else the machine does is left out.
Hardly one loop alone is worth its C: it is the group that has to make frames of each scene and size
at least 1.15 times faster.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tactile_skin.bench.measure import NOISE, Clock, frames, moving_touch
from tactile_skin.physics import compiled
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.solvers import Estimate, compensate

SIZES = 8, 16, 32
SCENES = "bodies", "moving touch"
FRAMES = 60  # of each scene and size
REPEATS = 5  # of a frame, of which the fastest counts: whatever disturbs one only adds
SEED = 340_836
IN_TURNS = "compiled", "in NumPy"


class Row(NamedTuple):
    """Attributes:
    scene, size: of SCENES and SIZES.
    compiled, plain: median time of a frame [y], see `Clock`.
    ratio: median over the frames of time in NumPy over time compiled.
    """

    scene: str
    size: int
    compiled: float
    plain: float
    ratio: float


def drawn(scene: str, n: int, circuit: Circuit, curve: PressureCurve) -> np.ndarray:
    """Return (n, rows, cols) `scan` readings."""
    rng = np.random.default_rng([SEED, SCENES.index(scene), circuit.rows])
    if scene == "bodies":
        return frames("bodies", "scan", n, rng, circuit, curve)[1]
    force = np.minimum(moving_touch(n, rng, circuit.shape), curve.max_force)
    return scenes.read_out(circuit, forward(circuit, curve.resistance(force)), "scan", rng)


def measure(scene: str, size: int, n: int) -> Row:
    """Solve n frames by both implementations; a moving touch goes on from the frame before."""
    circuit, curve, clock = Circuit(size, size), PressureCurve(), Clock()
    taken, last = np.full((n, len(IN_TURNS)), np.inf), None
    loops = compiled.library, None
    for k, adc in enumerate(drawn(scene, n, circuit, curve)):
        found: Estimate | None = None
        for _ in range(REPEATS):
            for form, loop in enumerate(loops):
                compiled.library = loop
                start = time.thread_time()
                found = compensate(adc, circuit, curve, start=last, noise=NOISE["scan"])
                taken[k, form] = min(taken[k, form], time.thread_time() - start)
        compiled.library = loops[0]
        clock(int)  # y
        last = found if scene != "bodies" else None
    fast, plain = np.median(taken, 0) / clock.y
    return Row(scene, size, fast, plain, float(np.median(taken[:, 1] / taken[:, 0])))


def measured(n: int) -> Iterator[Row]:
    """Measure every scene in every size."""
    if compiled.implementation() != "compiled":
        raise SystemExit("nothing is compiled: install a C compiler, then run `pip install -e .`")
    return (measure(scene, size, n) for scene in SCENES for size in SIZES)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.kernel",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--frames", type=int, default=FRAMES, metavar="N")
    n = parser.parse_args(arguments).frames
    print("scene         size   compiled   in NumPy   times")
    for row in measured(n):
        print(
            f"{row.scene:<12} {row.size:>3}x{row.size:<3} {row.compiled:8.2f} y {row.plain:8.2f} y "
            f"{row.ratio:7.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
