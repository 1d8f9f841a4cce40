# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin bench`: figures of every method."""

from __future__ import annotations

from pathlib import Path

from ..arguments import check_folder

EXAMPLES = (
    "Each picture NAME.png stands beside NAME.json, which holds the numbers drawn.\n"
    "parts: speed, stability; both take ten minutes, with --quick one. Times are best read on an\n"
    "idle machine.\n"
    "examples:\n  tactile-skin bench --quick\n  tactile-skin bench speed --out figures"
)


def register(parser) -> None:
    parser.add_argument("parts", nargs="*", metavar="PART", help="what to measure (default: all)")
    parser.add_argument("--quick", action="store_true", help="few frames, for a look")
    parser.add_argument("--seed", type=int, default=1, help="of scenes and noise (default 1)")
    parser.add_argument(
        "--out", type=Path, default=Path("bench"), help="folder for the pictures (default bench)"
    )


def run(args) -> int:
    """Measure, draw, and print what to choose and what to worry about."""
    check_folder(args.out)
    from .. import extras
    from ..bench import run as bench
    from ..bench import speed, stability

    for part in args.parts:
        if part not in bench.PARTS:
            raise ValueError(f"part {part!r}: must be one of {', '.join(bench.PARTS)}")
    if args.seed < 0:
        raise ValueError(f"--seed = {args.seed}: must be 0 or more")
    written: dict[str, dict] = {}
    for part in args.parts or bench.PARTS:
        module, full, short = bench.PARTS[part]
        given = short if args.quick else full
        written |= bench.figures_of(module, given, args.out, args.quick, args.seed, extras.tqdm())
    if "speed" in written:
        print("\n".join([*speed.choice(written["speed"]), ""]))
    if "stability" in written:
        print("what a running skin is silent about:")
        print(*stability.silent(written["stability"]), "", sep="\n")
    print(f"pictures: {', '.join(str(args.out / f'{name}.png') for name in written)}")
    return 0
