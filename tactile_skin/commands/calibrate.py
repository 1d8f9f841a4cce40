# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin calibrate`: from a board that is wired up to a parameter file with its newtons."""

from __future__ import annotations

import shlex
import shutil
import sys
import tempfile
import termios
import textwrap
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from ..arguments import split
from ..calibration.creep import measure_creep
from ..calibration.curve_fit import POOR, FittedCurve
from ..calibration.reference import MAX_LAG, fit_reference
from ..calibration.rest import supposing
from ..guide.calibrated import known_of, write
from ..guide.calibration import OBJECT, Guide
from ..guide.creep import stand
from ..guide.gain import measure_gain, write_gain
from ..guide.sent import GLANCE, check_sent
from ..guide.weight import newtons
from ..middleware.config import SkinConfig, part_of, read_skin
from ..recording.lines import read_reference
from ..replay.sources import Live, Recorded

_NAME = "tactile-skin calibrate"
_HARDEST = 10  # touches under a scale, among which is its hardest load
_LIGHTEST = 0.02  # of its largest force, above which it counts as a load
_SHADES = " .:-=+*#%@"
_OF_BOARD = {"port": str, "baud": int, "protocol": str}
_OF_FILES = {
    "rest": str,
    "touches": str,
    "reference": str,
    "creep": str,
    "rate": float,
    "full_scale": float,
}

EXAMPLES = (
    "You need ten minutes, the board, and up to ten things that a kitchen scale has "
    "weighed.\nexamples:\n"
    "  tactile-skin calibrate --config mine.yaml --out calibrated.yaml\n"
    "  tactile-skin calibrate --config mine.yaml --out mine.yaml port:=/dev/ttyUSB0\n"
    "  tactile-skin calibrate --config calibrated.yaml --out calibrated.yaml --creep\n"
    "  tactile-skin calibrate --config calibrated.yaml --out calibrated.yaml --gain 1.0\n"
    "from recordings (.mcap, .npy, .npz, .csv; rate:=60 if they have no times), one for each "
    "weight:\n"
    "  tactile-skin calibrate --config mine.yaml rest:=rest.mcap touches:=touches.mcap \\\n"
    "    500g:=bottle.mcap 1.2kg:=books.mcap 3kg:=bag.mcap\n"
    "with a scale in place of weights (lines of time [s],force [N]), and a load\n"
    "that stands for two minutes:\n"
    "  tactile-skin calibrate --config mine.yaml rest:=rest.mcap touches:=touches.mcap \\\n"
    "    reference:=scale.csv creep:=standing.mcap\n"
    "then:\n  tactile-skin launch skin.launch.yaml config:=calibrated.yaml"
)


def register(parser) -> None:
    parser.add_argument(
        "--creep",
        nargs="?",
        const=True,
        metavar="FILE",
        help="measure only by how much a load that stands grows with time: one object, two minutes",
    )
    parser.add_argument(
        "--gain",
        metavar="WEIGHT",
        help="measure only one factor on the curve, by a thing of this weight [kg] (or 10N, 500g)",
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar="NAME:=VALUE",
        help="port, baud or protocol, instead of the parameter file's; or recordings",
    )
    parser.add_argument(
        "--config", type=Path, help="parameter file with what you know of the board"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("calibrated.yaml"),
        help="parameter file to write; one that is there is kept as NAME.bak "
        "(default calibrated.yaml)",
    )


def run(args) -> int:
    """Guide through the steps, on a live board or through files, and write what was learnt.

    Returns:
        the exit status: 1 if there were weights to find the curve by and there is none. Without a
        curve, and nothing else that was learnt, no file is written.
    """
    out, config, creep = args.out, args.config, args.creep is True
    check_writable(out)
    skin = read_skin(config)
    if args.gain is not None:
        return _gain(args, skin)
    recorded = [f"creep:={args.creep}"] if args.creep and not creep else []
    given, loads = split_words([*args.words, *recorded])
    if creep and "rest" in given:
        raise ValueError("--creep is of a live board: give creep:=FILE")
    weighed = not creep
    if "rest" in given:
        weighed = bool(loads or "reference" in given)
        guide = from_files(skin, given, loads)
    else:
        with closing(Live(config, given)) as live:
            guide = Guide(skin.circuit, live, _ask, _say, _count_down, _show, **known_of(skin))
            live(0.0)  # what the driver logs of the port stands above the first question
            check_sent(skin, live(GLANCE))
            stand(guide, skin.curve) if creep else guide.run()
    no_curve, learnt = weighed and not guide.fitted, guide.learnt
    if no_curve and not learnt:
        print(f"{_NAME}: no curve was found: {out} is not written", file=sys.stderr)
        return 1
    write(out, config, guide, skin)
    port = [f"port:={given['port']}"] if "port" in given else []
    use = shlex.join(["tactile-skin", "launch", "skin.launch.yaml", *port, f"config:={out}"])
    if no_curve:
        print(
            f"{_NAME}: no curve was found: {out} is written with {' and '.join(learnt)} only, its "
            "forces are those of the configured curve. Weigh again: "
            f"{shlex.join(['--config', str(out)])}",
            file=sys.stderr,
        )
    elif doubt := _doubt(guide.fitted) or guide.unfit:
        _say(f"{out} is written, but {doubt}: see what is said above, and calibrate again.")
        print(f"To use it until then:\n  {use}")
    else:
        print(f"{out} is written. Use it:\n  {use}")
    return int(no_curve)


def _gain(args, skin: SkinConfig) -> int:
    """Find one factor on the curve, on a live board, and write it into the configuration."""
    weight = newtons(args.gain) or newtons(f"{args.gain} kg")
    if weight is None or args.creep:
        raise ValueError(f"--gain {args.gain}: must be a weight, as 1.0 (kg), 10N or 500g, alone")
    given, loads = split_words(args.words)
    if loads or given.keys() & _OF_FILES.keys():
        raise ValueError("--gain is of a live board: give port, baud or protocol only")
    with closing(Live(args.config, given)) as live:
        guide = Guide(skin.circuit, live, _ask, _say, _count_down, _show, **known_of(skin))
        live(0.0)
        check_sent(skin, live(GLANCE))
        factor = measure_gain(guide, weight, skin)
    write_gain(args.out, args.config, guide, factor, skin)
    _say(f"{args.out} is written: the curve's forces times {factor:.2f}.")
    return 0


def _doubt(fitted: FittedCurve | None) -> str:
    if fitted and fitted.error > POOR:
        return f"totals are off by {fitted.error:.0%}"
    if fitted and fitted.unexplained > fitted.off.size / 2.0:
        return f"{fitted.unexplained} of {fitted.off.size} objects do not fit the circuit"
    return ""


def check_writable(out: Path) -> None:
    """Before the work begins, not after it: ValueError says why `out` cannot be written."""
    if not out.parent.is_dir():
        raise ValueError(f"--out {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise ValueError(f"--out {out}: is a folder, must be a file")
    try:
        with tempfile.NamedTemporaryFile(dir=out.parent, prefix=f".{out.name}."):
            pass
    except OSError as error:
        raise ValueError(f"--out {out}: {out.parent}: {error.strerror}") from error


def split_words(words: list[str]) -> tuple[dict, list[tuple[str, str]]]:
    """["rest:=a.csv", "500g:=b.csv"] -> {"rest": "a.csv"}, [("500g", "b.csv")].

    Raises:
        ValueError: an unknown name, a value of another type, files beside a live board's
            parameters, or without the rest.
    """
    weighed = [word for word in words if newtons(word.partition(":=")[0]) is not None]
    others = [word for word in words if word not in weighed]
    bare, given = split(others, _OF_BOARD | _OF_FILES)
    recorded = weighed or given.keys() & _OF_FILES.keys()
    if bare or (recorded and given.keys() & _OF_BOARD.keys()):
        raise ValueError(
            f"{' '.join(words)}: must be {', '.join(_OF_BOARD)} of a live board, or files: files "
            f"are {', '.join(_OF_FILES)}, or a weight such as 500g:=FILE"
        )
    if recorded and "rest" not in given:
        raise ValueError("rest:=FILE is missing: frames of the untouched skin")
    return given, [(name, path) for name, _, path in (w.partition(":=") for w in weighed)]


def from_files(skin: SkinConfig, files: dict, loads: list[tuple[str, str]]) -> Guide:
    """Take the three steps with recorded frames in place of a board and a person.

    Args:
        files: rest, and touches if there are; rate: frames a second, of files without times.
        loads: weight and file of each object that lies on the skin.
    """
    part = part_of(skin.board)
    source = Recorded(skin.adc, files.get("rate"), files.get("full_scale"), part)
    answers = [("", "")]  # what is typed, and the file that it opens: to "hands off"

    def ask(text: str) -> str:
        if not answers:  # a file does not take its hands off
            raise ValueError(f"{files['rest']}: {text.strip().splitlines()[0]}")
        word, path = answers.pop(0)
        if path:
            print(f"  {word}: {path}")
            source.open(path)
            source.skip_to(guide.load, OBJECT)
        return word

    guide = Guide(skin.circuit, source, ask, _say, show=_show, **known_of(skin))
    rest = source.stream(files["rest"])[0]
    check_sent(skin, rest)
    guide.measure_rest()
    if "touches" in files:
        check_sent(skin, rest, source.stream(files["touches"])[0])
        guide.identify()
    if loads and "reference" in files:
        raise ValueError("reference:= takes the place of weights: give one of both")
    if loads:
        answers += [*loads, ("", ""), ("", "")]  # the end, and that it is meant
        guide.fit_curve()
    if "reference" in files:
        frames, times = source.stream(files.get("touches", ""))
        at, force = read_reference(files["reference"])
        if at[-1] < times[0] - MAX_LAG or at[0] > times[-1] + MAX_LAG:  # clocks of their own
            at, times = at - at[0], times - times[0]
        frames = guide.straight(frames)
        fitted, late = fit_reference(frames, times, force, at, guide.circuit, guide.at_rest)
        guide.fitted = fitted
        if fitted.creep.share:
            guide.creep = fitted.creep
        print(f"  {files['reference']} is {late:+.2f} s late; {fitted.message}")
        hardest = sorted(guide.touches, key=lambda touch: -np.nanmax(touch))[:_HARDEST]
        said = force[force > _LIGHTEST * force.max()]
        guide.prove(hardest, said, lambda *by: fit_reference(frames, times, force, at, *by)[0])
    if "creep" in files:
        frames, times = source.stream(files["creep"])
        curve = guide.fitted.curve if guide.fitted else skin.curve
        at_rest = supposing(guide.at_rest, guide.circuit)
        creep = guide.creep = measure_creep(
            guide.straight(frames), times, guide.circuit, at_rest, curve
        )
        print(f"  a standing load gains {creep.share:.1%} in a decade of time")
    return guide


def picture(force: np.ndarray) -> str:
    """Return a text picture of (rows, cols) [N], one character for two of a terminal's a cell."""
    share = force / max(force.max(), 1e-9)
    shade = np.minimum((share * len(_SHADES)).astype(int), len(_SHADES) - 1)
    lines = ["".join(2 * _SHADES[k] for k in row) for row in shade]
    edge = "  +" + "-" * (2 * force.shape[1]) + "+"
    return "\n".join([edge, *(f"  |{line}|" for line in lines), edge])


def _ask(text: str) -> str:
    """Return what is typed from now on: an Enter of the step before is no answer."""
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)
    *above, question = text.splitlines()
    _say("\n".join(above))
    try:
        return input(question)
    except EOFError:
        return ""


def _say(text: str) -> None:
    """Print lines that break between words, as wide as the terminal; further ones are indented."""
    width = shutil.get_terminal_size().columns
    for line in text.splitlines():
        print(textwrap.fill(line, width, subsequent_indent="    ", break_on_hyphens=False))


def _show(force: np.ndarray) -> None:
    print(picture(force))


def _count_down(seconds: int) -> None:
    """Wait for some seconds, and show on one line how many are left."""
    for left in range(seconds, 0, -1):
        print(f"\r  hands off: measured in {left} s ", end="", flush=True)
        time.sleep(1.0)
    print("\r  measuring                 ", flush=True)
