"""What the prior of `map` is worth: each family of touches, tuned on and not.

    python tests/yardsticks/prior.py [--frames 300] [--seed S] [--write docs/lab/accuracy.md]
    python tests/yardsticks/prior.py --stream

Error of newton, of map under the built-in prior alone and of map, on the same frames, `scan`, on
16 x 16 cells. Times are multiples of y (bench/measure.py). --stream: what `auto` takes in the demo.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from unittest import mock

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.measure import NOISE, Clock, machine
from tactile_skin.board import simulator
from tactile_skin.board.formats import make_parser
from tactile_skin.learning import scenes
from tactile_skin.learning.bodies import bodies
from tactile_skin.physics.curve import GRAM
from tactile_skin.solvers import prior

CIRCUIT, CURVE = Circuit(), PressureCurve()
SIZES = {"small bodies": (0.7, 3.0), "large bodies": (0.7, 6.0)}  # cells, half of a side
# What the prior's numbers were chosen on and its network has learnt from.
TUNED = {
    "bodies": "other sizes, textures, counts",
    "small bodies": "other sizes, textures, counts",
    "large bodies": "other sizes, textures, counts",
    "pictures": "nothing",
    "blobs": "yes, other seeds",
    "rects": "yes, other seeds",
    "random": "level prior only",
}
METHODS = "newton", "built-in prior", "map"
LAG = 0.004  # s by which the board's low-pass is behind


def load(family: str, n: int, rng) -> np.ndarray:
    """(n, rows, cols) force [N]."""
    if family in SIZES:
        drawn = bodies(n, *CIRCUIT.shape, rng, half=SIZES[family])
        force = np.clip(drawn, 0.0, scenes.MAX_LOAD) * GRAM
    else:
        force = scenes.sample(family, n, *CIRCUIT.shape, rng)
    return np.minimum(force, CURVE.max_force)


def solve(method: str, frame, noise):
    if method != "built-in prior":
        return compensate(frame, CIRCUIT, CURVE, method, noise=noise)
    with mock.patch.object(prior, "with_neighbours", lambda *_: None):
        return compensate(frame, CIRCUIT, CURVE, "map", noise=noise)


def family(name: str, n: int, seed: int, noise) -> dict[str, dict]:
    """Of each method: error of the frames [g a cell], times [y], coverage, share suspect."""
    rng = np.random.default_rng([seed, list(TUNED).index(name)])
    force = load(name, n, rng)
    adc = scenes.read_out(CIRCUIT, forward(CIRCUIT, CURVE.resistance(force)), "scan", rng)
    touched, table = force > 0.0, {}
    for method in METHODS:
        for frame in adc[:3]:
            solve(method, frame, noise)
        clock = Clock()
        found = [clock(solve, method, frame, noise) for frame in adc]
        error = np.abs(np.array([e.force for e in found]) - force)
        within = error <= np.array([e.std for e in found])
        table[method] = {
            "error": error.mean((1, 2)) / GRAM,
            "y": (clock.quantile(0.5), clock.quantile(0.99)),
            "within": float(within[touched].mean()),
            "suspect": float(np.mean([e.status == "suspect" for e in found])),
            "failed": int(sum(e.status == "failed" for e in found)),
        }
    return table


def row(name: str, table: dict[str, dict]) -> str:
    cells = [name, TUNED[name]]
    for method in METHODS:
        error = table[method]["error"]
        cells.append(f"{error.mean():.2f} +- {error.std() / error.size**0.5:.2f}")
    error, newton = table["map"]["error"], table["newton"]["error"]
    ratio = error.mean() / newton.mean()
    # of a ratio of two means over the same frames
    spread = (error - ratio * newton).std() / newton.mean() / error.size**0.5
    result = table["map"]
    cells += [
        f"{ratio:.2f} +- {spread:.2f}",
        f"{100 * result['within']:.0f} %",
        f"{100 * result['suspect']:.1f} %",
        "{:.1f} / {:.1f}".format(*result["y"]),
    ]
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| touches | tuned on | newton [g a cell] | built-in prior | map | map / newton "
    "| within 1 std | suspect | p50 / p99 [y] |\n" + "|---" * 9 + "|"
)


def stream(seconds: int, seed: int) -> None:
    """Time, error and status of `auto` over the demo at 100 frames a second, noise measured."""
    scene = scenes.script("demo", *CIRCUIT.shape)
    board = simulator.Board(CIRCUIT, CURVE, scene, frames_per_second=100, seed=seed)
    parser = make_parser("binary", *CIRCUIT.shape, CIRCUIT.adc_bits)
    scale = CIRCUIT.full_scale * 2.0 ** (16 - CIRCUIT.adc_bits)
    clock, last, errors, alone, statuses = Clock(), None, [], [], []
    while len(errors) < 100 * seconds:
        for frame in parser.feed(board.scan()):
            adc, truth = frame.samples / scale, scene(frame.device_time_us * 1e-6 - LAG)
            given = {"noise": NOISE["scan"]}
            last = clock(compensate, adc, CIRCUIT, CURVE, "auto", start=last, **given)
            own = compensate(adc, CIRCUIT, CURVE, "auto", **given)
            errors.append(np.abs(last.force - truth).mean() / GRAM)
            alone.append(np.abs(own.force - truth).mean() / GRAM)
            statuses.append(last.status)
    p50, p99, most = (clock.quantile(q) for q in (0.5, 0.99, 1.0))
    print(f"{len(errors)} frames: p50 {p50:.2f}, p99 {p99:.2f}, largest {most:.2f} y")
    print(f"error {np.mean(errors):.3f} g a cell, each frame alone {np.mean(alone):.3f} g")
    print(f"not ok: {sum(s != 'ok' for s in statuses)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seed", type=int, default=int.from_bytes(os.urandom(3)))
    parser.add_argument("--write", type=Path, metavar="PAGE", help="update its table")
    parser.add_argument("--stream", action="store_true", help="the demo, with auto")
    parser.add_argument("--unknown-noise", action="store_true", help="noise is not given")
    parser.add_argument("--family", choices=list(TUNED), nargs="*", default=list(TUNED))
    args = parser.parse_args()
    print(f"seed {args.seed}", flush=True)
    if args.stream:
        stream(36, args.seed)
        return
    lines = [HEAD]
    noise = None if args.unknown_noise else NOISE["scan"]
    for name in args.family:
        lines.append(row(name, family(name, args.frames, args.seed, noise)))
        print(lines[-1], flush=True)
    if args.write:
        text = args.write.read_text()
        begin, end = "<!-- accuracy -->", "<!-- end -->"
        head, rest = text.split(begin)
        tail = rest.split(end, 1)[1]
        where = f"\n{args.frames} frames a family, seed {args.seed}, {machine()['processor']}.\n"
        table = "\n".join(lines)
        args.write.write_text(f"{head}{begin}\n{table}\n{where}{end}{tail}")


if __name__ == "__main__":
    main()
