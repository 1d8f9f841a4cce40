# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin detect`: what a board sends, and a parameter file that reads it."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..arguments import split
from ..board.recognise.listen import BAUDS, Heard, listen
from ..board.serial_port import check_port, open_port
from ..files import read_bytes
from ..guide.detection import SECONDS, conclude
from ..middleware.config import read_skin

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
  diode        forward voltage at 1 mA of a diode in each driven line [V]
  adc_table    esp32: the board's converter is one
  r_ref        reference resistor [ohm]
  full_scale   what is printed of an input at the supply: 1023 of 10 bits, 5.0 of volts
  hexadecimal  true: the numbers of a text are"""

_LARGEST = 1 << 26  # bytes of a file
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
    "diode": float,
    "adc_table": str,
    "r_ref": float,
    "full_scale": float,
    "hexadecimal": bool,
}


def register(parser) -> None:
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
    bauds, seconds = (given["baud"],) if "baud" in given else BAUDS, given.get("seconds", SECONDS)
    if not 0.5 <= seconds <= 60.0:
        raise ValueError(f"seconds:={seconds:g}: must be from 0.5 to 60")
    if files:
        found = Heard(read_bytes(files[0], _LARGEST), bauds[0], shape=shape)
    else:
        check_port(given["port"])
        with open_port(given["port"], bauds[0]) as line:
            found = listen(line, bauds, seconds, print, shape)
    text = conclude(found, given, shape, _ask, print)
    if not text:
        return 1
    out.write_text(text)
    print(f"{out} is written. See it live:")
    port, file = f"port:={given.get('port', 'PORT')}", str(out)
    print(" ", shlex.join(["tactile-skin", "launch", port, f"config:={file}"]))
    calibrate = ["tactile-skin", "calibrate", "--config", file, "--out", file, port]
    print("then:", shlex.join(calibrate))
    return 0


def _known(given: dict) -> dict:
    """Return what a parameter file that is given says of the wiring: it is not asked, nor lost."""
    if "config" not in given:
        return {}
    skin = read_skin(Path(given["config"]))
    names = ("readout", "driven", "r_ref", "r_par", "r_drive")
    known = {name: getattr(skin.circuit, name) for name in names}
    return known | {"pull_up": skin.adc.inverted}


def _ask(text: str, read: Callable[[str], Any]) -> Any:
    while True:
        try:
            typed = input(text).strip()
        except EOFError:  # nobody is there: what is in brackets
            typed = ""
            print("no answer: what is in brackets holds; give NAME:=VALUE for another")
        try:
            return read(typed)
        except ValueError as error:
            if not sys.stdin.isatty():
                raise
            print(f"  {error}")
