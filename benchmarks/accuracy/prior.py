# SPDX-License-Identifier: Apache-2.0
"""What the prior of `map` is worth, on families that it was tuned on and on others.

Error of newton, of map under the built-in prior alone and of map, on the same frames, `scan`, on
16 x 16 cells. Times are multiples of y (bench/measure.py). --stream: what `auto` takes in the demo.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from support.prior import CIRCUIT, CURVE, METHODS, TUNED, family

from tactile_skin import compensate
from tactile_skin.bench.measure import NOISE, Clock, machine
from tactile_skin.board.formats import make_parser
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes, simulator

from .. import harness

LAG = 0.004  # s by which the board's low-pass is behind


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


def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seed", type=int, default=int.from_bytes(os.urandom(3)))
    parser.add_argument("--write", type=Path, metavar="PAGE", help="update its table")
    parser.add_argument("--stream", action="store_true", help="the demo, with auto")
    parser.add_argument("--unknown-noise", action="store_true", help="noise is not given")
    parser.add_argument("--family", choices=list(TUNED), nargs="*", default=list(TUNED))
    args = parser.parse_args(arguments)
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
    harness.run(main)
