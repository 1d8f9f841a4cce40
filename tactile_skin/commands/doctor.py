# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin doctor`: what is wrong with a board, from recorded frames or live."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import asdict, replace

import numpy as np

from ..arguments import split
from ..calibration.rest import check_all_is_sent, measure_rest
from ..extras import track
from ..fields import leaves
from ..findings.finding import Finding, Kind
from ..guide.notes import notes
from ..health.doctor import diagnose, played
from ..middleware.config import SkinConfig, part_of, read_skin, skin_of
from ..nodes.compensation import skin_of as running_skin
from ..parameters import shared as parameters
from ..physics.adc import Adc
from ..physics.circuit import Circuit
from ..recording.frames import read_frames, recorded_skin
from ..replay.sources import Live

EXAMPLES = """\
Hands off for some seconds, then press everywhere with fingers and palm, twenty touches or more,
some of them hard, with pauses: a minute of it. FILE holds frames in order, ADC counts or ratios
from 0 to 1: a recording (.mcap), .npy, .npz (its first array, or `frames`) of (n, rows, cols), or
.csv, a frame a line.
examples:
  tactile-skin doctor touches.npy config:=my_skin.yaml
  tactile-skin doctor touches.csv rows:=8 cols:=12 r_ref:=4700 r_par:=70 adc_bits:=12
  tactile-skin doctor port:=/dev/ttyUSB0 config:=my_skin.yaml seconds:=60
options, name:=value:
  config    parameter file with circuit.*, as for launch (default: as recorded, or the paper's)
  rest      recorded frames of the untouched skin (default: found in FILE)
  full_scale  what an input at the supply reads, where FILE holds no ADC steps: 5.0 of volts
  namespace  of the skin, where a recording holds several
  port, baud, protocol, seconds   of the live board (default 1000000, binary, 60)
exit status: 0 nothing found, 1 something found, 2 a mistake."""

BOARD = "the board, in place of config or on top:"  # a heading of the help
_BOARD = {leaf.name: leaf for leaf in leaves(parameters.Circuit)}  # circuit.* are arguments
_KINDS: dict[str, type] = {
    "config": str,
    "rest": str,
    "full_scale": float,
    "namespace": str,
    "port": str,
    "baud": int,
    "protocol": str,
    "seconds": float,
    **{name: type(leaf.default) for name, leaf in _BOARD.items()},
}
_LIVE = ("baud", "protocol", "seconds")
_COUNTED = 10.0  # s after which what is left is said
_SECONDS = 5.0, 3600.0
_CORRUPT = 0.005  # share of the frames damaged, from which the link is bad;
_LOST = 0.05  # the same of frames lost


def register(parser) -> None:
    board = [f"  {name:14}  {leaf.about.description}" for name, leaf in _BOARD.items()]
    parser.epilog = "\n".join([EXAMPLES, BOARD, *board])
    parser.add_argument("words", nargs="*", metavar="FILE | NAME:=VALUE", help="frames; options")


def run(args) -> int:
    """Print what is found; the exit status."""
    files, given = split(args.words, _KINDS)
    if bool(files) == ("port" in given) or len(files) > 1:
        raise ValueError("give one FILE of recorded frames, or port:=DEVICE of a live board")
    for name in _LIVE:
        if files and name in given:
            raise ValueError(f"{name}:= is of a live board: give port:=DEVICE, not a file")
    config = given.get("config")
    namespace = given.get("namespace", "")
    skin = recorded_skin(files[0], config, namespace) if files else read_skin(config)
    board = _board(skin, given)
    described = skin_of(board, "")
    adc, circuit = described.adc, described.circuit
    how = {"namespace": namespace, "full_scale": given.get("full_scale")}
    how["part"] = part_of(described.board)
    found: list[Finding] = []
    if files:
        frames, times = _ratio(files[0], adc, **how)
    else:
        frames, times, found = _listen(given, board)
    check_all_is_sent(frames, circuit, adc.threshold(skin.threshold), skin.threshold)
    rest = None
    if "rest" in given:
        at_rest, _ = _ratio(given["rest"], adc, **how)
        rest = measure_rest(at_rest, circuit)
    found += diagnose(frames, circuit, rest, inverted=adc.inverted, curve=skin.curve)
    live = None
    if not found:
        supposed = replace(skin.given, circuit=described.given.circuit, time_limit=math.inf)
        running = running_skin(supposed, warn=print)
        live = played.stopped_by(running, adc, track(frames), times)
    print(f"{len(frames)} frames of {circuit.rows} x {circuit.cols}")
    print(picture(found, circuit))
    for finding in found:
        print(f"- {finding}")
    if live:
        reason, since = live
        print(
            f"- stops a running skin {since:.1f} s after the first frame, not explained: {reason}"
        )
        found.append(reason)
    for note in notes(found, frames, circuit, rest):
        print(note)
    return 1 if found else 0


def picture(found: list[Finding], circuit: Circuit) -> str:
    """Return the mat in text: `.` a sound cell, `X` a bad one, `-` and `|` bad lines."""
    marks = np.where(circuit.populated, ".", " ")
    rows, cols = {r for f in found for r in f.rows}, {c for f in found for c in f.cols}
    cells = {(f.rows[0], f.cols[0]) for f in found if len(f.rows) == len(f.cols) == 1}
    for finding in found:
        if not finding.cols:
            marks[list(finding.rows)] = "-"
        if not finding.rows:
            marks[:, list(finding.cols)] = "|"
    for cell in cells:
        marks[cell] = "X"
    width = len(str(circuit.rows - 1))
    high = len(str(circuit.cols - 1))
    digits = zip(*(f"{c:>{high}}" for c in range(circuit.cols)), strict=True)
    head = [" " * (width + 1) + " ".join(line) for line in digits]
    body = [
        f"{r:>{width}} " + " ".join(marks[r]) + ("  <" if r in rows else "")
        for r in range(circuit.rows)
    ]
    foot = " " * (width + 1) + " ".join("^" if c in cols else " " for c in range(circuit.cols))
    return "\n".join([*head, *body, foot.rstrip()]).rstrip()


def _board(skin: SkinConfig, given: dict) -> dict:
    """Return the parameters of the board, with what the arguments change of them."""
    board = asdict(skin.board)
    changed = {name: given[name] for name in _BOARD if name in given}
    dropped: dict = {}  # what was another board's
    if {"rows", "cols"} & changed.keys():
        dropped |= {"mask": "", "scanned": ""}
    if changed.get("readout", board["readout"]) != board["readout"]:
        dropped["r_line"] = 0.0
        dropped |= {"diode": 0.0} if changed["readout"] == "grounded" else {"r_drive": 0.0}
    if "adc_bits" in changed:
        dropped["adc_full_scale"] = 0.0
    return {f"circuit.{name}": value for name, value in (board | dropped | changed).items()}


def _ratio(path: str, adc: Adc, **how):
    """(n, rows, cols) ADC ratio of a file, and their times [s]; what was repaired is printed."""
    found = read_frames(path, adc.circuit, **how)
    for note in found.notes:
        print(f"{path}: {note}")
    return found.ratio(adc), found.times


def _listen(given: dict, board: dict) -> tuple[np.ndarray, np.ndarray, list[Finding]]:
    """Frames of the live board, their times [s], and what is wrong with its link."""
    seconds = given.get("seconds", 60.0)
    if not _SECONDS[0] <= seconds <= _SECONDS[1]:
        raise ValueError(f"seconds:={seconds:g}: must be from {_SECONDS[0]:g} to {_SECONDS[1]:g}")
    driver = {name: given[name] for name in ("port", "baud", "protocol") if name in given}
    # frames that repeat are what is looked for: they are not held back
    with closing(Live(given.get("config"), board | driver | {"frozen_after": 0.0})) as live:
        live(0.0)
        print(f"hands off for 5 s, then press everywhere, with pauses: {seconds:g} s", flush=True)
        parts = [live(min(_COUNTED, seconds))]
        while (left := seconds - len(parts) * _COUNTED) > 0.0:
            print(f"{left:g} s left", flush=True)
            parts.append(live(min(_COUNTED, left)))
        frames = np.concatenate(parts)
        counters, reconnects = live.driver.counters, live.driver.reconnects
    print(
        f"{len(frames) / seconds:.0f} frames a second, {counters.corrupt} damaged (CRC or line), "
        f"{counters.lost} lost, {reconnects} reconnections"
    )
    times = np.linspace(0.0, seconds, len(frames))
    return frames, times, _link(counters, len(frames), reconnects)


def _link(counters, frames: int, reconnects: int) -> list[Finding]:
    """Return that frames were damaged or lost on their way."""
    corrupt, lost = counters.corrupt / frames, counters.lost / frames
    if corrupt < _CORRUPT and lost < _LOST and not reconnects:
        return []
    numbers = {"frames": frames, "corrupt": corrupt, "lost": lost, "reconnects": reconnects}
    return [Finding(Kind.LINK, numbers=numbers)]
