"""`tactile-skin bench`: figures of every method."""

from __future__ import annotations

from pathlib import Path

from ..arguments import check_folder

EXAMPLES = (
    "Each picture NAME.png stands beside NAME.json, which holds the numbers drawn.\n"
    "parts: speed, cases, stability, growth, way (bytes in to stop hook), touch_to_stop; all\n"
    "of them take 20 minutes, with --quick two. Times are best read on an idle machine.\n"
    "Only on request: faults, damaged boards through the whole chain, which takes an hour on\n"
    "two cores, with --quick one minute; recorded, every method on frames of your own board.\n"
    "examples:\n  tactile-skin bench --quick\n  tactile-skin bench speed growth --out figures\n"
    "  tactile-skin bench faults --shapes 4x4 16x16 --minutes 10\n"
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
    faults = parser.add_argument_group("faults")
    faults.add_argument("--shapes", nargs="+", metavar="SHAPE", help="such as 4x4 (default: all)")
    faults.add_argument(
        "--faults", nargs="+", metavar="NAME", help="names, or dead or electrical (default: all)"
    )
    faults.add_argument("--minutes", type=float, help="of sound streams, in all (default 60)")
    faults.add_argument("--streams", type=int, help="of each fault and begin (default 1)")
    faults.add_argument("--jobs", type=int, help="processes (default: one a core)")


def run(args) -> int:
    """Measure, draw, and print the tables."""
    check_folder(args.out)
    from .. import extras
    from ..bench import choose, speed, touch_to_stop
    from ..bench import run as bench
    from ..bench.damage import table
    from ..replay import methods

    unknown = [part for part in args.parts if part not in bench.PARTS]
    if unknown:
        raise ValueError(f"part {unknown[0]!r}: must be one of {', '.join(bench.PARTS)}")
    if args.seed < 0:
        raise ValueError(f"--seed = {args.seed}: must be 0 or more")
    parts = args.parts or [part for part in bench.PARTS if part not in bench.ON_REQUEST]
    given = _given(args, parts)
    written = bench.run(parts, args.out, args.quick, args.seed, extras.tqdm(), given)
    if "speed" in written:
        print(speed.table(written["speed"]))
        print("\n".join(["", *choose.lines(written["speed"]), ""]))
    if "stability" in written:
        print("what a running skin is silent about:")
        print(*choose.silent(written["stability"]), "", sep="\n")
    if "touch_to_stop" in written:
        print(touch_to_stop.table(written["touch_to_stop"]), "", sep="\n")
    if "recorded" in written:
        print(methods.table(written["recorded"]), "", sep="\n")
    if "faults" in written:
        print(table.table(written["faults"]))
    print(f"pictures: {', '.join(str(args.out / f'{name}.png') for name in written)}")
    return 0


def _given(args, parts) -> dict[str, dict]:
    """Part -> what the command line gives its `measure`."""
    from ..bench.damage import reliability

    options = ("shapes", "faults", "minutes", "streams", "jobs")
    given = {name: getattr(args, name) for name in options if getattr(args, name) is not None}
    if given and "faults" not in parts:
        raise ValueError(f"--{next(iter(given))}: only with the part faults")
    for name in given.get("shapes", ()):
        if name not in reliability.SHAPES:
            raise ValueError(f"shape {name!r}: must be one of {', '.join(reliability.SHAPES)}")
    for name, least in (("minutes", 0.0), ("streams", 1), ("jobs", 1)):
        if not given.get(name, least) >= least:
            raise ValueError(f"--{name} = {given[name]}: must be {least:g} or more")
    if "faults" in given:
        given["faults"] = reliability.named(given["faults"])
    if (args.frames is not None) != ("recorded" in parts):
        raise ValueError("the part recorded needs --frames FILE, and no other part takes it")
    return {"faults": given, "recorded": {"frames": args.frames, "config": args.config}}
