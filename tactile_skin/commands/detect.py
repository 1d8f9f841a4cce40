# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin detect`: what a board sends, and a parameter file that reads it."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import yaml

from ..arguments import split
from ..board.formats import Format
from ..board.recognise import shown
from ..board.recognise.lines import sides
from ..board.recognise.listen import BAUDS, Heard, listen
from ..board.recognise.seen import Seen
from ..board.serial_port import identity
from ..files import read_bytes
from ..middleware.config import read_skin, skin_of
from ..physics.readouts import DRIVEN, READOUTS

EXAMPLES = """\
Listens to the port at one baud rate after the other, shows what arrives, says what it is, asks what
no byte can tell, and writes a parameter file. FILE holds bytes as they came from a port.
examples:
  tactile-skin detect port:=/dev/ttyUSB0
  tactile-skin detect port:=/dev/ttyUSB0 baud:=115200 out:=chest.yaml
  tactile-skin detect bytes.bin rows:=8 cols:=8 r_ref:=10000 readout:=loaded full_scale:=1023
options, name:=value; what is missing is asked, and Enter takes the value in brackets:
  port         serial device, or pyserial URL such as socket://192.168.4.1:3333
  baud         bits per second (default: usual ones in turn)
  seconds      to listen at each (default 4)
  out          parameter file to write (default mine.yaml); it must not exist
  config       parameter file that knows the circuit: readout, r_ref, r_par are taken from it
  rows, cols   cells, where the bytes do not say them
  readout      floating, loaded, grounded or virtual_ground: docs/boards.md has drawings
  driven       rows or columns (default rows)
  pull_up      true: each sense line has a resistor to the supply, as with INPUT_PULLUP
  r_ref        reference resistor [ohm]
  full_scale   what is printed of an input at the supply: 1023 of 10 bits, 5.0 of volts"""

_SECONDS = 4.0  # s: an Arduino that is opened is in its boot loader for 2
_LARGEST = 1 << 26  # bytes of a file
_WIDTHS = (8, 10, 12, 14, 16)  # bits of ADCs
_R_PAR = {"loaded": 25.0, "grounded": 0.0, "virtual_ground": 0.0}  # ohm: of an Arduino's pin
_R_DRIVE = 25.0  # ohm of an Arduino's pin
_KINDS = {
    "port": str,
    "baud": int,
    "seconds": float,
    "out": str,
    "config": str,
    "rows": int,
    "cols": int,
    "readout": str,
    "driven": str,
    "pull_up": bool,
    "r_ref": float,
    "full_scale": float,
}


def register(parser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument(
        "words", nargs="*", metavar="FILE | NAME:=VALUE", help="file of bytes, or port; options"
    )


def run(args) -> int:
    """Return 0 for a file that reads the board, 1 where nothing was recognised."""
    files, given = split(args.words, _KINDS)
    given = _known(given) | given
    if len(files) > 1 or bool(files) == ("port" in given):
        raise ValueError("give port:=NAME, or one FILE of bytes")
    out = Path(given.get("out", "mine.yaml"))
    if out.exists():
        raise ValueError(f"{out}: exists: give out:=NAME for another file")
    if ("rows" in given) != ("cols" in given):
        raise ValueError("rows and cols: give both, or none")
    shape = (given["rows"], given["cols"]) if "rows" in given else None
    bauds, seconds = (given["baud"],) if "baud" in given else BAUDS, given.get("seconds", _SECONDS)
    if not 0.5 <= seconds <= 60.0:
        raise ValueError(f"seconds:={seconds:g}: must be from 0.5 to 60")
    if files:
        found = Heard(read_bytes(files[0], _LARGEST), bauds[0], shape=shape)
    else:
        found = listen(given["port"], bauds, seconds, print, shape)
    return conclude(found, given, shape, out, _ask)


def _known(given: dict) -> dict:
    """Return what a parameter file that is given says of the wiring: it is not asked, nor lost."""
    if "config" not in given:
        return {}
    skin = read_skin(Path(given["config"]))
    names = ("readout", "driven", "r_ref", "r_par", "r_drive")
    known = {name: getattr(skin.circuit, name) for name in names}
    return known | {"pull_up": skin.adc.inverted}


def conclude(
    found: Heard,
    given: dict,
    shape: tuple[int, int] | None,
    out: Path,
    ask: Callable[[str], str],
) -> int:
    """Say what was found, ask for the rest, and write the file; return the exit status."""
    seen = found.seen
    print(f"what arrives:\n  {shown(seen.sample or found.data, seen.text, 200)}")
    if not seen.protocol:
        print(f"not recognised: {seen.about}.\ndocs/detect.md says how to describe it.")
        return 1
    how = "sure" if seen.sure else "not sure: compare with the sketch"
    print(f"{seen.about}: {seen.protocol}, {seen.frames} frames at {found.baud} baud ({how})")
    rows, cols = _cells(found, shape, ask)
    answers = _answers(found.seen, given | {"rows": rows, "cols": cols}, ask)
    out.write_text(text_of(found, answers))
    print(f"{out} is written. See it live:")
    print(f"  tactile-skin launch port:={given.get('port', 'PORT')} config:={out}")
    print(f"then: tactile-skin calibrate --config {out} --out {out}")
    return 0


def _cells(found: Heard, shape: tuple[int, int] | None, ask) -> tuple[int, int]:
    """Rows and columns, as given, as the bytes say, or as typed."""
    shape = shape or found.seen.shape
    while shape is None or not found.fits(shape):
        cells = found.seen.cells
        usual = "{} x {}".format(*sides(cells))
        typed = ask(f"rows x columns of its {cells} cells [{usual}]: ") or usual
        shape = _two(typed)
        if shape is None or not found.fits(shape):
            wrong = f"{typed!r}: must be rows x columns, {cells} cells together"
            if not sys.stdin.isatty():
                raise ValueError(wrong)
            print(f"  {wrong}")
    return shape


def _answers(seen: Seen, answers: dict, ask) -> dict:
    """Return what no byte tells: readout, resistor and scale, as given or typed."""
    if "readout" not in answers:
        about = (
            f"wiring: {', '.join(READOUTS)}; with -columns behind if the columns are driven, "
            "-pullup if readings fall [floating]: "
        )
        answers["readout"], *ends = (ask(about) or "floating").split("-")
        if strange := set(ends) - {"columns", "pullup"}:
            raise ValueError(f"wiring -{strange.pop()}: must be -columns or -pullup")
        answers.setdefault("pull_up", "pullup" in ends)
        answers.setdefault("driven", "columns" if "columns" in ends else DRIVEN[0])
    if "r_ref" not in answers:
        answers["r_ref"] = _number(
            "r_ref", ask("reference resistor r_ref [ohm] [1780]: ") or "1780"
        )
    if not seen.adc_bits and "full_scale" not in answers:
        usual = f"{_usual_scale(seen):g}"
        typed = ask(
            f"what an input at the supply prints; largest so far {seen.largest:g} [{usual}]: "
        )
        answers["full_scale"] = _number("full_scale", typed or usual)
    return answers


def _ask(text: str) -> str:
    try:
        return input(text).strip()
    except EOFError:  # nobody is there: what is in brackets
        print()
        return ""


def _two(text: str) -> tuple[int, int] | None:
    words = text.lower().replace("x", " ").replace(",", " ").split()
    return (
        (int(words[0]), int(words[1])) if len(words) == 2 and all(map(str.isdigit, words)) else None
    )


def _number(name: str, text: str) -> float:
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        number = 0.0
    if not number > 0.0:
        raise ValueError(f"{name} = {text!r}: must be a number above 0")
    return number


def _usual_scale(seen: Seen) -> float:
    """Return the smallest usual full scale that holds all readings."""
    if seen.decimals and seen.largest <= 1.0:
        return 1.0
    if seen.decimals:
        return next((volts for volts in (3.3, 5.0) if seen.largest <= volts + 0.1), 1023.0)
    bits = next((bits for bits in _WIDTHS[1:] if seen.largest < 2**bits), _WIDTHS[-1])
    return float(2**bits - 1)


def text_of(found: Heard, answers: dict) -> str:
    """Return the parameter file.

    Raises:
        ValueError: an answer that no circuit has.
    """
    seen = found.seen
    scale = answers.get("full_scale", 0.0)
    width = [bits for bits in _WIDTHS if 2**bits - 1 == scale]
    circuit = {name: answers[name] for name in ("rows", "cols", "r_ref")}
    circuit["adc_bits"] = seen.adc_bits or (width[0] if width else _fine(scale, seen.step))
    readout = answers["readout"]
    if readout != "floating":
        circuit |= {"readout": readout, "driven": answers.get("driven", DRIVEN[0])}
        circuit["r_par"] = _R_PAR.get(readout, 0.0)
    if readout == "grounded":
        circuit["r_drive"] = _R_DRIVE
    circuit |= {name: answers[name] for name in ("r_par", "r_drive") if name in answers}
    if answers.get("pull_up"):
        circuit["inverted"] = True
    skin_of({f"circuit.{name}": value for name, value in circuit.items()}, "")
    driver = {"protocol": seen.protocol, "baud": found.baud}
    if (board := identity(answers.get("port", "")))[1:]:
        driver["serial_number"] = board[-1]  # port: auto finds it again on any socket
    form = _form(seen.format, 0.0 if width else scale, found.request)
    if form:
        driver["format"] = form
    data = {"/**": {"circuit": circuit}, "/**/serial_driver": driver}
    if seen.protocol != "binary":  # its frames come at the sketch's pace
        data["/**/stop_on_push"] = {"debounce": 0.01, "lead": 0.0}
    sections = {name: {"ros__parameters": values} for name, values in data.items()}
    how = "sure" if seen.sure else "NOT SURE: compare with the sketch"
    return (
        f"# written by tactile-skin detect: {seen.about} ({how})\n"
        f"# what arrived: {shown(seen.sample or found.data, seen.text)}\n"
        "# geometry (where the skin is on the robot) is not stated: pushes have no direction\n"
        + yaml.safe_dump(sections, sort_keys=False)
    )


def _fine(scale: float, step: float) -> int:
    """Bits of an ADC whose steps are as fine as what is printed."""
    steps = scale / step if step else scale
    return next((bits for bits in _WIDTHS if 2**bits - 1 >= steps), _WIDTHS[-1])


def _form(fmt: Format, scale: float, request: str) -> dict:
    """Return what differs from the protocol's default description."""
    if fmt is None:
        return {}
    fmt = dataclasses.replace(fmt, full_scale=scale, request=request)
    defaults = {field.name: field.default for field in dataclasses.fields(fmt)}
    return {k: v for k, v in dataclasses.asdict(fmt).items() if v != defaults[k]}
