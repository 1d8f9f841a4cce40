# SPDX-License-Identifier: Apache-2.0
"""How right newtons are after `tactile-skin calibrate`, on unknown boards.

Boards as in `identify` behind a pseudo-terminal, as a serial device. The command
runs as a user runs it, on a terminal, with rows, columns and readout in its parameter file. A
person, scripted, does what it asks: hands off, press, lay ten things of 3 to 50 N whose weight is
known to a gram. Then the skin is launched with the file that it wrote, and other things are laid
on: their totals, as `skin/pressure` has them, against the true ones. A board takes about a minute.
"""

from __future__ import annotations

import numpy as np
from support.device import run

from .. import harness


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1, help="of the first board")
    parser.add_argument("--size", default="8x8", metavar="ROWSxCOLS")
    parser.add_argument("--readout", default="floating")
    args = parser.parse_args(arguments)
    shape = tuple(map(int, args.size.split("x")))
    seeds = range(args.seed, args.seed + args.boards)
    off = np.abs([run(shape, seed, args.readout) for seed in seeds])
    medians = np.median(off, axis=1)
    print(
        f"{args.readout}, {args.size}: median error {np.median(off):.1%} of all things; of a "
        f"board {np.median(medians):.1%}, at most {medians.max():.1%}; within 5 %: "
        f"{np.count_nonzero(medians < 0.05)} of {len(medians)} boards"
    )
    return {"error": off}


if __name__ == "__main__":
    harness.run(main)
