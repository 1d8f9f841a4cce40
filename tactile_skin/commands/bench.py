# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin bench`: figures of every method."""

from __future__ import annotations

from pathlib import Path

from ..arguments import check_folder, split

EXAMPLES = (
    "Each picture NAME.png stands beside NAME.json, which holds the numbers drawn.\n"
    "parts: speed, stability; both take ten minutes, with --quick one. Times are best read on an\n"
    "idle machine. With config:=FILE, and a file of frames, they are of your circuit and touches.\n"
    "examples:\n  tactile-skin bench --quick\n  tactile-skin bench speed --out figures\n"
    "  tactile-skin bench --quick config:=mine.yaml touches.mcap"
)


def register(parser) -> None:
    parser.add_argument("words", nargs="*", metavar="PART | FILE | config:=FILE", help="see above")
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
    from ..recording.frames import KINDS

    words, given = split(args.words, {"config": str})
    parts = [word for word in words if word in bench.PARTS]
    files = [word for word in words if word not in bench.PARTS]
    if len(files) > 1 or not all(word.endswith(KINDS) for word in files):
        known = ", ".join(bench.PARTS)
        raise ValueError(f"part {files[-1]!r}: must be one of {known}, or one file of frames")
    if args.seed < 0:
        raise ValueError(f"--seed = {args.seed}: must be 0 or more")
    written: dict[str, dict] = {}
    own = _own("".join(files), given, 6 if args.quick else 300) if files or given else {}
    for part in parts or bench.PARTS:
        module, full, short = bench.PARTS[part]
        how = (short if args.quick else full) | own
        written |= bench.figures_of(module, how, args.out, args.quick, args.seed, extras.tqdm())
    if "speed" in written:
        print("\n".join([*speed.choice(written["speed"]), ""]))
    if "stability" in written:
        print("what a running skin is silent about:")
        print(*stability.silent(written["stability"]), "", sep="\n")
    print(f"pictures: {', '.join(str(args.out / f'{name}.png') for name in written)}")
    return 0


def _own(path: str, given: dict, n: int) -> dict:
    """Return the argument that has a user's own skin measured, with what `map` feels in a file."""
    from ..bench.measure import forces_of
    from ..middleware.config import part_of
    from ..recording.frames import read_frames, recorded_skin

    skin = recorded_skin(path, given.get("config"))
    if not path:
        return {"skin": (*skin[:2], None)}
    frames = read_frames(path, skin.circuit, part=part_of(skin.board)).ratio(skin.adc)
    return {"skin": (*skin[:2], forces_of(frames, n, *skin[:2]))}
