# SPDX-License-Identifier: Apache-2.0
"""How well `identify` finds r_par and r_line of unknown boards.

Each board has r_par up to 20 % off, stripes of 0 to 15 ohm, a fabric whose curve is up to 30 % off
in level and shape, 8 % scatter, 3 % at rest, 0.5 % of a touch carried to the neighbours and 1 step
of noise on each of the four samples of a reading. Bodies (ellipses, boxes, rings, turned, textured,
30 to 1000 g on a cell) press anywhere. The circuit that is supposed is the paper's. Where lines are
driven the stripes are ideal, and loads scatter by 5 to 8 %.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from support.lab.unknown import Unknown, UnknownDriven
from support.weights import bodies

from tactile_skin import Circuit, compensate, identify, measure_rest
from tactile_skin.calibration.identify import names, values
from tactile_skin.calibration.rest import supposing
from tactile_skin.physics.curve import GRAM

from .. import harness


def error(board: Unknown, circuit: Circuit, rest, frames, force) -> float:
    """Mean error [g a cell] of `map` with a circuit, and the true curve of the fabric."""
    curve = board.curve.resting_at(1.0 / supposing(rest, circuit).conductance)
    found = compensate(frames, circuit, curve, "map")
    return float(np.abs(found.force - force).mean() / GRAM)


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=40)
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--size", default="16x16", metavar="ROWSxCOLS")
    parser.add_argument("--seed", type=int, default=0, help="of the first board")
    parser.add_argument("--readout", default="floating")
    parser.add_argument(
        "--errors", type=int, default=0, metavar="N", help="of N frames a board, too, by `map`"
    )
    args = parser.parse_args(arguments)
    shape = tuple(map(int, args.size.split("x")))
    off, std, told, spent, errors = [], [], [], 0.0, []
    for seed in range(args.seed, args.seed + args.boards):
        driven = args.readout != "floating"
        board = UnknownDriven(shape, seed, args.readout) if driven else Unknown(shape, seed)
        both = names(board.supposed)
        truth = tuple(getattr(board, name) for name in both)
        force = bodies(args.frames, shape, np.random.default_rng([seed, 1]))
        frames, rest = board.frames(force), measure_rest(board.at_rest(), board.supposed)
        begun = time.process_time()
        found = identify(frames, board.supposed, rest)
        spent += time.process_time() - begun
        if args.errors:
            new = bodies(args.errors, shape, np.random.default_rng([seed, 2]))
            true = replace(board.supposed, **dict(zip(both, truth, strict=True)))
            seen = board.frames(new)
            circuits = true, found.circuit, board.supposed
            errors.append([error(board, circuit, rest, seen, new) for circuit in circuits])
        off.append(np.subtract(values(found.circuit), truth))
        std.append([found.std[name] for name in both])
        told.append([found.told[name] for name in both])
        print(
            f"{seed}: r_par {truth[0]:.1f}, off by {off[-1][0]:+.2f} +- {std[-1][0]:.2f}; "
            f"{both[1]} {truth[1]:.1f}, off by {off[-1][1]:+.2f} +- {std[-1][1]:.2f}; "
            f"told {told[-1]}, {found.frames} frames",
            flush=True,
        )
    off, std, told = np.array(off), np.array(std), np.array(told)
    share = np.abs(off[:, 0]) < 0.01 * Circuit().r_par
    print(f"r_par within 1 %: {share.mean():.1%}; {both[1]} within 1 ohm: ", end="")
    print(f"{(np.abs(off[:, 1]) < 1.0).mean():.1%}; told {told.mean(0)}")
    within = [np.mean((np.abs(off) < std)[told[:, k], k]) for k in range(2) if told[:, k].any()]
    print("of those told, within one standard deviation:", *(f"{share:.0%}" for share in within))
    if errors:
        known, identified, supposed = np.mean(errors, axis=0)
        print(f"error of map [g a cell]: the circuit known {known:.2f}, identified ", end="")
        print(f"{identified:.2f} ({identified / known:.2f} times), as supposed {supposed:.2f}")
    print(f"{1e3 * spent / (args.boards * args.frames):.0f} ms a frame (processor time)")
    return {"off": off, "std": std, "told": told, "map": errors}


if __name__ == "__main__":
    harness.run(main)
