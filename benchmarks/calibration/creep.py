# SPDX-License-Identifier: Apache-2.0
"""How well creep is measured and taken out, on unknown boards.

The boards are those of `identify.py`; a load's conductance gains a share in each decade of time,
1 + share * log10(1 + t / time), by 20 % more or less from cell to cell (--cells), and a load that
changes is the sum of those that came one after the other. The curve is fitted by objects that
have lain for 5 s, the creep measured by one of two minutes. Then another object stands: its
total, raw and with the creep taken out, against the truth, and "by creep": against what the same
board would feel if it did not creep, which leaves the curve's error out. A total is the mean of 5
frames. Controls: a load that grows by 5 % a minute, one that comes 20 times, and one
that grows on a fabric that does not creep. The method was chosen on seeds 0 to 9; others score it.
"""

from __future__ import annotations

import numpy as np
from support.creep import calibrated, felt
from support.lab.unknown import Creeping
from support.weights import HARDEST, objects

from .. import harness

GROWTH = 0.05  # of the load, a minute
MEAN = 5  # frames of which a total is the mean


def _smooth(values) -> np.ndarray:
    """Means of up to `MEAN` values around each."""
    ones = np.ones(MEAN)
    return np.convolve(values, ones, "same") / np.convolve(np.ones(len(values)), ones, "same")


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=20)
    parser.add_argument("--seed", type=int, default=100, help="of the first board")
    parser.add_argument("--size", default="16x16", metavar="ROWSxCOLS")
    parser.add_argument("--share", type=float, default=0.05, help="a decade of time")
    parser.add_argument("--time", type=float, default=1.0, help="s after which it begins")
    parser.add_argument("--cells", type=float, default=0.0, help="scatter of the share")
    parser.add_argument("--objects", type=int, default=10, help="by which the curve is fitted")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--touches", type=int, default=0, help="to identify the circuit; 0: known")
    args = parser.parse_args(arguments)
    shape = tuple(map(int, args.size.split("x")))
    times = np.concatenate([np.arange(0.0, 10.0, 0.2), np.arange(10.0, 60.0 * args.minutes, 2.0)])
    table = []
    for seed in range(args.seed, args.seed + args.boards):
        skin = Creeping(shape, seed, args.share, args.time, args.cells)
        circuit, rest, curve, creep = calibrated(skin, args.objects, args.touches, seed)
        force = objects(4, shape, np.random.default_rng([seed, 3]))[0][0]
        force *= min(1.0, HARDEST / (1.2 * force.max() * (1.0 + GROWTH * args.minutes)))
        total = force.sum()

        def run(course, at=times, on=skin, force=force, known=(circuit, rest, curve, creep)):
            return tuple(map(_smooth, felt(on.standing(at, force, course), at, *known)))

        raw, out = run(np.ones(times.size))
        after = times > 1.0
        still = Creeping(shape, seed, 0.0, 1.0)  # the same board, if it did not creep
        first = run(np.ones(20), np.arange(20) / 20, still)[0].mean()
        row = {
            "share": creep.share,
            "std": creep.std,
            "time": creep.time,
            "force, no creep": np.abs(first / total - 1.0),
            "force, raw": np.abs(raw[after] / total - 1.0).max(),
            "force": np.abs(out[after] / total - 1.0).max(),
            "by creep, raw": np.abs(raw[after] / first - 1.0).max(),
            "by creep": np.abs(out[after] / first - 1.0).max(),
        }
        course = 1.0 + GROWTH * times / 60.0
        grown = run(course)[1]
        row["grows, force"] = np.abs(grown[after] / (total * course)[after] - 1.0).max()
        row["grows, by creep"] = np.abs(grown / run(course, times, still)[0] - 1.0)[after].max()
        at = np.arange(0.0, 60.0, 0.1)
        course = (at % 3.0 < 2.0) * 1.0
        again = felt(skin.standing(at, force, course), at, circuit, rest, curve, creep)
        pressed = (at % 3.0 > 0.5) & (at % 3.0 < 1.9)
        each = [again[1][pressed & (at // 3.0 == k)].mean() for k in range(20)]
        row["presses, by creep"] = np.abs(np.array(each) / first - 1.0).max()
        quiet = (at % 3.0 > 2.1) & (at > 3.0)
        row["released"] = again[1][quiet].max()
        at = np.arange(0.0, 60.0, 0.5)
        raw, out = run(at / 60.0, at, still)
        row["slow push"] = (run(at / 60.0, at)[1][-20:] / raw[-20:] - 1.0).min()
        row["slow push, no creep"] = (out[-20:] / raw[-20:] - 1.0).min()
        table.append(row)
        print(f"{seed}: " + ", ".join(f"{k} {v:.4f}" for k, v in row.items()), flush=True)
    print(f"{args.size}, {args.share:.0%} a decade from {args.time:g} s, {args.boards} boards:")
    for name in table[0]:
        values = np.array([row[name] for row in table])
        print(f"  {name:22} median {np.median(values):8.4f}", end="")
        if name not in ("share", "std", "time", "released"):
            print(f", worst {np.abs(values).max():.4f}", end="")
            print(f", within 3 %: {np.mean(np.abs(values) < 0.03):.0%}", end="")
        print()
    off = np.array([row["share"] - args.share for row in table])
    within = np.mean(np.abs(off) < [row["std"] for row in table])
    print(
        f"  error of the share: RMS {np.square(off).mean() ** 0.5:.4f}; within one std {within:.0%}"
    )
    return table


if __name__ == "__main__":
    harness.run(main)
