# SPDX-License-Identifier: Apache-2.0
"""How often `measure_rest` takes noisy boards, and refuses touched ones.

Boards as in `identify.py`. Sound: also with slow noise or a hum of 0.5 to 2.5 steps. Noisy: one to
three cells whose readings scatter by 5 to 40 ADC steps, jump between two values, or drop to 0; or
one that loses its contact with the fabric now and then. Touched: a finger of 0.3 to 3 N that comes,
goes, taps (for two frames or more) or stays for part of the time, or a drift of all cells by 10 to
30 %. What stands all the time no rest tells. Chosen on
seeds 0 to 19; others score it.
"""

from __future__ import annotations

import numpy as np
from support.lab.unknown import Unknown
from support.resting import NOISY, TOUCHED, noisy, resting, touched

from tactile_skin import measure_rest

from .. import harness

SHAPES = (4, 4), (6, 6), (8, 8), (8, 12), (16, 16)
SOUND = "sound", "slow noise", "hum"


def sound(board: Unknown, kind: str, n: int, rng) -> np.ndarray:
    """Of a board without noisy cells; each reading's noise may be slow, or common to all."""
    frames = resting(board, n, 1.0, rng)
    size = rng.uniform(0.5, 2.5) / board.supposed.full_scale
    if kind == "slow noise":  # that of a board whose low-pass takes ten frames
        noise = size * rng.standard_normal(frames.shape)
        for k in range(1, n):
            noise[k] = 0.9 * noise[k - 1] + 0.19**0.5 * noise[k]
        frames = frames + noise
    elif kind == "hum":
        turn = 2.0 * np.pi * (rng.uniform(0.02, 0.5) * np.arange(n) + rng.random())
        frames = frames + 2**0.5 * size * np.sin(turn)[:, None, None]
    return np.clip(frames, 0.0, 1.0)


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=20, help="of each size and kind")
    parser.add_argument("--seed", type=int, default=100, help="of the first board")
    args = parser.parse_args(arguments)
    print(f"of {args.boards} boards each: sound and refused; noisy and refused; named wrongly; ")
    print("off by, conductance of the worst cell; touched and taken")
    rows = []
    for shape in SHAPES:
        refused = dict.fromkeys((*SOUND, *NOISY), 0)
        taken, wrong, off, why = dict.fromkeys(TOUCHED, 0), 0, [], []
        for seed in range(args.seed, args.seed + args.boards):
            board = Unknown(shape, seed)
            rng = np.random.default_rng([seed, 7])
            true = measure_rest(board.at_rest(300), board.supposed).conductance
            for kind in refused:
                n = int(rng.choice([20, 30, 100, 300]))
                if kind in SOUND:
                    cells, frames = [], sound(board, kind, n, rng)
                else:
                    cells, frames = noisy(board, kind, n, rng)
                try:
                    rest = measure_rest(frames, board.supposed)
                except ValueError as error:
                    refused[kind] += 1
                    why.append(f"{seed} {kind}: {error}")
                    continue
                wrong += len(set(rest.noisy) - set(cells))
                off.append(np.abs(np.log(rest.conductance / true)).max())
            for kind in taken:
                n = int(rng.choice([20, 30, 100, 300]))
                try:
                    rest = measure_rest(touched(board, kind, n, rng), board.supposed)
                except ValueError:
                    continue
                taken[kind] += 1
                why.append(f"{seed} {kind} taken, {rest.noisy}")
        print(f"{shape}: {refused}; {wrong}; {np.quantile(off, 0.95):.1%}; {taken}", flush=True)
        rows.append(
            {"shape": shape, "refused": refused, "wrong": wrong, "off": off, "taken": taken}
        )
        for line in why[:8]:
            print("   ", line)
    return rows


if __name__ == "__main__":
    harness.run(main)
