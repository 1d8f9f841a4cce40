# SPDX-License-Identifier: Apache-2.0
"""How well `fit_curve` finds newtons by a few known weights, on unknown boards.

The boards are those of `identify.py`: 8 % scatter, 3 % at rest, 1 step of noise, 0.5 % carried to
the neighbours, r_par, stripes and curve unknown. Objects of 0.3 to 5 kg, soft (at most 1 kg on a
cell), each laid once; the total force of new ones of 3 to 50 N is then compared with the truth. The
circuit is known exactly (--touches 0), or found by `identify` from so many touches. --wave bends
the fabric's curve up and down by a share, a shape that the shipped curve has at no level. --creep:
an object has stood for 1 to 30 s, and gained so much in a decade of them. --r-ref: the boards have
these, in turn, and all other resistances in proportion; --fabric: but for the cells', which are up
to so many times larger or smaller. With --reference the weights are those of a scale under the
skin, up to 0.5 s early or late, while the objects are laid on and taken off. --hand: in place of
objects, and as new ones, a hand presses a scale on the skin, 3 to 40 N on some 4 to 20 cells.
"alike" is the
same curve without cells' gains.
The method was chosen on seeds 0 to 99; others score it.
"""

from __future__ import annotations

import numpy as np
from support.lab.unknown import Unknown
from support.weights import bodies, known, objects, presses, stream, totals, weighed

from tactile_skin import (
    Circuit,
    PressureCurve,
    fit_curve,
    fit_reference,
    identify,
    measure_rest,
)

from .. import harness

WITHIN = 1.5  # factor between the error that is reported and the true one


def bend(board: Unknown, share: float, phase: float) -> None:
    """Give it a curve whose conductance waves by a share, once in a factor of 190 of the force."""
    force, resistance = np.array(board.curve.points).T
    wave = np.exp(share * np.sin(1.2 * np.log(force[1:]) + phase))
    board.curve = PressureCurve(force, resistance / np.append(1.0, wave))


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=40)
    parser.add_argument("--objects", type=int, default=10)
    parser.add_argument("--new", type=int, default=60, help="objects whose weight is found")
    parser.add_argument("--touches", type=int, default=0, help="to identify the circuit; 0: known")
    parser.add_argument("--size", default="16x16", metavar="ROWSxCOLS")
    parser.add_argument("--seed", type=int, default=100, help="of the first board")
    parser.add_argument("--scatter", type=float, default=0.08, help="from cell to cell")
    parser.add_argument("--wave", type=float, default=0.0, help="of the curve")
    parser.add_argument("--creep", type=float, default=0.0, help="share in a decade of time")
    parser.add_argument("--r-ref", type=float, nargs="+", default=[Circuit().r_ref], metavar="OHM")
    parser.add_argument("--fabric", type=float, default=1.0, help="times its resistance, at most")
    parser.add_argument(
        "--mislabelled", action="store_true", help="one weight is given twice or half as large"
    )
    parser.add_argument("--reference", action="store_true", help="a scale that goes on")
    parser.add_argument("--hand", action="store_true", help="that presses, in place of objects")
    args = parser.parse_args(arguments)
    drawn = presses if args.hand else objects
    shape = tuple(map(int, args.size.split("x")))
    off, alike, by_true, by_default, said, lags = [], [], [], [], [], []
    found_odd = wrong_odd = 0
    for seed in range(args.seed, args.seed + args.boards):
        rng = np.random.default_rng([seed, 2])
        ohms = args.r_ref[seed % len(args.r_ref)] / Circuit().r_ref
        fabric = np.exp(np.log(args.fabric) * np.random.default_rng([seed, 5]).uniform(-1.0, 1.0))
        board = Unknown(shape, seed, ohms, fabric, scatter=args.scatter)
        if args.wave:
            bend(board, args.wave, rng.uniform(0.0, 2.0 * np.pi))
        idle, circuit = board.at_rest(), known(board)
        if args.touches:
            touches = board.frames(bodies(args.touches, shape, np.random.default_rng([seed, 1])))
            supposed = board.supposed
            circuit = identify(touches, supposed, measure_rest(idle, supposed)).circuit
        rest = measure_rest(idle, circuit)
        laid, weights = drawn(args.objects, shape, rng)
        new, truth = drawn(args.new, shape, rng)
        given, bad = weights.copy(), int(rng.integers(args.objects))
        if args.mislabelled:
            given[bad] *= rng.choice([0.5, 2.0])
        if args.reference:
            late = rng.uniform(-0.5, 0.5)
            fitted, found = fit_reference(
                *stream(board, args.objects, late, rng, drawn), circuit, rest
            )
            lags.append(found - late)
        else:
            laid_on = weighed(board, laid, args.creep, rng)
            fitted = fit_curve(laid_on, given, circuit, rest)
        found_odd += bad in fitted.odd
        wrong_odd += len(set(fitted.odd) - {bad}) + (bad in fitted.odd and not args.mislabelled)
        frames = weighed(board, new, args.creep, rng)
        off.append(totals(frames, circuit, fitted.curve, rest) / truth - 1.0)
        alike.append(totals(frames, circuit, fitted.curve.usual, rest) / truth - 1.0)
        by_true.append(totals(frames, circuit, board.curve, rest) / truth - 1.0)
        by_default.append(totals(frames, circuit, PressureCurve(), rest) / truth - 1.0)
        said.append(fitted.error)
        rms = np.square(off[-1]).mean() ** 0.5
        print(
            f"{seed}: median {np.median(np.abs(off[-1])):.2%}, RMS {rms:.2%}; "
            f"said {fitted.error:.2%}; odd {fitted.odd}",
            flush=True,
        )
    for name, errors in (
        ("fitted", off),
        ("alike", alike),
        ("true", by_true),
        ("default", by_default),
    ):
        errors = np.abs(errors)
        per_board = np.median(errors, 1)
        print(
            f"{name} curve: median {np.median(errors):.2%}, p95 {np.quantile(errors, 0.95):.2%}; "
            f"a board's median {per_board.min():.2%} to {per_board.max():.2%}"
        )
    ratio = np.array(said) / np.square(off).mean(1) ** 0.5
    within = np.mean((ratio < WITHIN) & (ratio > 1.0 / WITHIN))
    print(
        f"reported over true RMS: {np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f}), "
        f"within {WITHIN}: {within:.0%}"
    )
    if args.mislabelled:
        print(f"mislabelled objects named: {found_odd} of {args.boards}", end="; ")
    print(f"right weights called odd: {wrong_odd} of {args.boards * args.objects}")
    if lags:
        print(f"the scale's lag is found to {1e3 * np.abs(lags).max():.0f} ms at worst")
    return {"fitted": off, "alike": alike, "true": by_true, "default": by_default, "said": said}


if __name__ == "__main__":
    harness.run(main)
