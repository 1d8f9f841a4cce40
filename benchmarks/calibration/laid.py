# SPDX-License-Identifier: Apache-2.0
"""How often `calibrate` refuses a weight that stands, and uses one that came late or slid.

Boards of 8 x 8 to 16 x 16 with 0.3 to 3 steps of noise, six objects of 0.3 to 5 kg on each, 30
frames of a second. `still`: with creep of 10 % a decade of time from 0.5 s on. `late`: it came
after so much of the second. `slid`: by so many cells, evenly. The error is that of the total by
the mean frame, of the weights that are used.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import shift
from support.lab.unknown import Unknown
from support.weights import known, objects, totals

from tactile_skin import measure_rest
from tactile_skin.guide.calibration import MOST_MOVED, Guide

from .. import harness

SHAPES, NOISES = ((8, 8), (12, 12), (16, 16)), (0.3, 1.0, 3.0)
FRAMES, STEPS, OBJECTS = 30, 6, 6
BEGIN, CREEP = 0.5, 0.1  # s after it was laid; share in a decade of time
LATE, SLID = (0.1, 0.3, 0.6), (0.5, 1.0, 2.0)


def courses(board: Unknown, force: np.ndarray, rng):
    """name -> FRAMES exposures of a load (rows, cols) [N]."""
    still, none = board.expose(force), board.expose(np.zeros(force.shape))
    steps, each = np.arange(STEPS) / (STEPS - 1), FRAMES // STEPS
    crept = 1.0 + CREEP * np.log10(1.0 + steps / BEGIN)
    grows = [board.expose(force, np.where(force > 0.0, c, 1.0)) for c in crept]
    yield "still", [e for e in grows for _ in range(each)]
    for late in LATE:
        before = round(late * FRAMES)
        yield f"late by {late:g} s", [none] * before + [still] * (FRAMES - before)
    for slid in SLID:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        way = slid * np.array([np.sin(angle), np.cos(angle)])
        moved = [shift(force, way * s, order=1, prefilter=False) for s in steps]
        yield f"slid by {slid:g} cells", [e for f in moved for e in [board.expose(f)] * each]


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=18)
    parser.add_argument("--seed", type=int, default=152000)
    args = parser.parse_args(arguments)
    found: dict[str, list] = {}
    for k, seed in enumerate(range(args.seed, args.seed + args.boards)):
        shape, rng = SHAPES[k % 3], np.random.default_rng(seed)
        board = Unknown(shape, seed, noise=NOISES[k // 3 % 3])
        circuit = known(board)
        rest = measure_rest(board.at_rest(), circuit)
        guide = Guide(circuit, None, None, None)
        guide.rest = rest
        for force in objects(OBJECTS, shape, rng)[0]:
            there = board.frames([force] * FRAMES)
            true = totals(there.mean(0)[None], circuit, board.curve, rest)[0]
            for name, exposures in courses(board, force, rng):
                frames = np.array([board.sample(e) for e in exposures])
                felt = totals(frames.mean(0)[None], circuit, board.curve, rest)[0]
                found.setdefault(name, []).append(
                    (guide.moved(frames) <= MOST_MOVED, felt / true - 1.0)
                )
    for name, of in found.items():
        used, off = np.array(of).T
        kept = np.abs(off[used > 0.0])
        error = f"their totals are off by {np.quantile(kept, 0.95):.1%} (p95)" if kept.size else ""
        print(f"{name}: used {np.count_nonzero(used)} of {used.size}; {error}")
    return {
        name: {"used": [u for u, _ in of], "error": [e for _, e in of]}
        for name, of in found.items()
    }


if __name__ == "__main__":
    harness.run(main)
