"""`tactile-skin bench`: figures of every method."""

from __future__ import annotations

from pathlib import Path

from ..arguments import check_folder

EXAMPLES = (
    "Each picture NAME.png stands beside NAME.json, which holds the numbers drawn.\n"
    "parts: speed, cases, stability; all of them take ten minutes, with --quick one. Times are\n"
    "best read on an idle machine. Only on request: recorded, every method on frames of your own\n"
    "board. The whole chain is measured from a checkout: python -m benchmarks.faults --help\n"
    "examples:\n  tactile-skin bench --quick\n  tactile-skin bench speed --out figures\n"
    "  tactile-skin bench recorded --frames touches.csv --config mine.yaml"
)


def register(parser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("parts", nargs="*", metavar="PART", help="what to measure (default: all)")
    parser.add_argument("--quick", action="store_true", help="few frames, for a look")
    parser.add_argument("--seed", type=int, default=1, help="of scenes and noise (default 1)")
    parser.add_argument(
        "--out", type=Path, default=Path("bench"), help="folder for the pictures (default bench)"
    )
    recorded = parser.add_argument_group("recorded")
    recorded.add_argument("--frames", metavar="FILE", help="frames: .mcap, .npy, .npz or .csv")
    recorded.add_argument("--config", help="parameter file (default: as recorded)")


def run(args) -> int:
    """Measure, draw, and print the tables."""
    check_folder(args.out)
    from .. import extras
    from ..bench import run as bench
    from ..bench import speed, stability
    from ..replay import methods

    for part in args.parts:
        if part in bench.MOVED:
            where = f"python -m {bench.MOVED[part]}"
            raise ValueError(f"part {part!r} is no longer installed: run `{where}` in a checkout")
        if part not in bench.PARTS:
            raise ValueError(f"part {part!r}: must be one of {', '.join(bench.PARTS)}")
    if args.seed < 0:
        raise ValueError(f"--seed = {args.seed}: must be 0 or more")
    parts = args.parts or [part for part in bench.PARTS if part not in bench.ON_REQUEST]
    if (args.frames is not None) != ("recorded" in parts):
        raise ValueError("the part recorded needs --frames FILE, and no other part takes it")
    given = {"recorded": {"frames": args.frames, "config": args.config}}
    written = bench.run(parts, args.out, args.quick, args.seed, extras.tqdm(), given)
    if "speed" in written:
        print(speed.table(written["speed"]))
        print("\n".join(["", *speed.choice(written["speed"]), ""]))
    if "stability" in written:
        print("what a running skin is silent about:")
        print(*stability.silent(written["stability"]), "", sep="\n")
    if "recorded" in written:
        print(methods.table(written["recorded"]), "", sep="\n")
    print(f"pictures: {', '.join(str(args.out / f'{name}.png') for name in written)}")
    return 0
