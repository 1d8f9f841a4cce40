# SPDX-License-Identifier: Apache-2.0
"""A board that was listened to: what was found in words, what no byte can show, and its file."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from typing import Any

from ..board.recognise.columns import sides
from ..board.recognise.listen import Heard
from ..board.recognise.seen import Seen, shown
from ..board.serial_port import identity
from ..calibration.tracker import PIN
from ..health.doctor.advice import WIDTHS
from ..middleware.config import skin_of
from ..physics.readouts import DRIVEN, READOUTS
from ..readings.scale import VOLTS
from ..yaml_files import write_yaml

SECONDS = 4.0  # s to listen at each rate: an Arduino that is opened is in its boot loader for 2
_SAMPLE = 200  # characters of what arrives
_USUAL_WIDTHS = (10, 12)  # bits of the ADCs of nearly all boards
_SCALES = (
    "1023 or 4095 of ADC steps or their means, 3.3 or 5 of volts, 3300 or 5000 of millivolts, 1 or "
    "100 of ratios; resistances and forces cannot be read: print what the ADC reads"
)
_DIODE = 0.58  # V at 1 mA, of the commonest: a 1N4148 (data sheet)
_R_REF = 1780  # ohm, of the paper's board
_PULL_UP = 35000  # ohm, in the middle of an Arduino's INPUT_PULLUP, which has 20 to 50 kohm
_R_PAR = {"loaded": PIN, "grounded": 0.0, "virtual_ground": 0.0}  # ohm

# A question, and what reads its answer, by ValueError if it is none: it is asked again then.
Ask = Callable[[str, Callable[[str], Any]], Any]


def conclude(
    found: Heard,
    given: dict,
    shape: tuple[int, int] | None,
    ask: Ask,
    say: Callable[[str], None],
) -> str:
    """Say what was found, ask for the rest, and return the text of a parameter file.

    It is empty where nothing was recognised.

    Args:
        given: answers that are known: port, readout, driven, pull_up, diode, adc_table, r_ref,
            r_par, r_drive, full_scale, hexadecimal.
        shape: (rows, cols), if it is known.

    Raises:
        ValueError: an answer that no circuit has, or a shape that no frame has.
    """
    seen = found.seen
    say(f"what arrives:\n  {shown(seen.sample or found.data, seen.text, _SAMPLE)}")
    if not seen.protocol:
        about = seen.about or "neither text, nor packets that begin alike"
        say(f"not recognised: {about}.\ndocs/detect.md says how to describe it.")
        return ""
    say(_recognised(found))
    hexadecimal = given.get("hexadecimal")
    if seen.digits and hexadecimal is None:
        about = f"numbers of {seen.digits} digits: decimal or hexadecimal [decimal]: "
        hexadecimal = ask(about, _base)
    if seen.text and hexadecimal is not None:
        found.read_as(hexadecimal)
        seen = found.seen
    port = given.get("port", "")
    if board := identity(port)[1:]:  # on USB
        say(f"USB board {board[-1]} at {port}")
    if shape and not found.fits(shape):
        raise ValueError(f"rows = {shape[0]}, cols = {shape[1]}: must be {_size(found.seen)}")
    rows, cols = shape or _cells(found, ask)
    if found.seen is not seen:  # the cells that were typed are not the numbers of a line
        seen = found.seen
        say(_recognised(found))
    answers = _answers(seen, given | {"rows": rows, "cols": cols}, ask)
    circuit = _circuit(seen, answers)
    say(f"{rows} x {cols} cells at {circuit['adc_bits']} bits, {answers['readout']}")
    # port: auto finds a USB board again on any socket, and no other
    at = port if "://" in port or not port else os.path.abspath(port)
    where = {"serial_number": board[-1]} if board else {"port": at} if at else {}
    return _text(found, answers, circuit, where)


def _base(typed: str) -> bool | None:
    if not typed or typed[:3] in ("dec", "hex"):
        return typed[:3] == "hex" if typed else None
    raise ValueError(f"{typed!r}: must be decimal or hexadecimal")


def _recognised(found: Heard) -> str:
    """Return what the bytes were recognised as, and how sure that is."""
    seen = found.seen
    how = "sure" if seen.sure else "not sure: compare with the sketch"
    rate = f", {found.rate:.0f} a second" if found.rate else ""
    return f"{seen.about}: {seen.protocol}, {seen.frames} frames at {found.baud} baud{rate} ({how})"


def _cells(found: Heard, ask: Ask) -> tuple[int, int]:
    """Rows and columns, as the bytes say, or as typed."""
    if found.seen.shape and found.seen.sure:
        return found.seen.shape
    cells = found.seen.cells
    usual = " x ".join(map(str, found.seen.shape or sides(cells)))

    def read(typed: str) -> tuple[int, int]:
        words = (typed or usual).lower().replace("x", " ").replace(",", " ").split()
        if len(words) == 2 and all(map(str.isdecimal, words)):
            shape = int(words[0]), int(words[1])
            if found.fits(shape):
                return shape
        raise ValueError(f"{typed!r}: must be rows x columns, {_size(found.seen)}")

    about = f"rows x columns of its {cells} cells, the outer loop of its sketch first [{usual}]: "
    return ask(about, read)


def _size(seen: Seen) -> str:
    if seen.shape:
        return f"{seen.shape[0]} x {seen.shape[1]}, as the lines show"
    return f"{seen.cells} cells together, as a frame has"


def _answers(seen: Seen, answers: dict, ask: Ask) -> dict:
    """Return what no byte shows: readout, resistor and scale, as given or typed."""
    if "readout" not in answers:
        about = (
            f"wiring: {', '.join(READOUTS)}; with -columns behind if the columns, the inner loop "
            "of its sketch, are driven, -pullup if readings fall, -diodes if each driven line has "
            "one, -esp32 if the ADC is an ESP32's [floating]: "
        )
        answers = ask(about, _wiring) | answers
    if "r_ref" not in answers:
        usual = f"{_PULL_UP if answers.get('pull_up') else _R_REF:g}"
        about = f"reference resistor r_ref [ohm] [{usual}]: "
        answers["r_ref"] = ask(about, lambda typed: _number("r_ref", typed or usual))
    if not seen.adc_bits and "full_scale" not in answers:
        usual = f"{scale:g}" if (scale := _usual_scale(seen)) else ""
        brackets = f" [{usual}]" if usual else f" ({_SCALES})"
        about = f"what an input at the supply prints; largest so far {seen.largest:g}{brackets}: "
        answers["full_scale"] = ask(about, lambda typed: _full_scale(seen, typed or usual))
    elif not seen.adc_bits:
        _full_scale(seen, f"{answers['full_scale']:g}")
    return answers


def _full_scale(seen: Seen, text: str) -> float:
    """Return what an input at the supply prints; ValueError: as decimals only resistances do."""
    scale = _number("full_scale", text)
    steps = any(scale in (2**bits - 1, 2**bits) for bits in WIDTHS)
    volts = scale <= VOLTS or scale == 100.0 or 1e3 <= scale <= 1e3 * VOLTS
    if seen.decimals and not (steps or volts):
        raise ValueError(f"full_scale = {text}: must be {_SCALES}")
    return scale


def _wiring(typed: str) -> dict:
    readout, *ends = (typed or READOUTS[0]).split("-")
    if readout not in READOUTS:
        raise ValueError(f"wiring {readout!r}: must be one of {', '.join(READOUTS)}")
    if strange := set(ends) - {"columns", "pullup", "diodes", "esp32"}:
        raise ValueError(f"wiring -{strange.pop()}: must be -columns, -pullup, -diodes or -esp32")
    found: dict[str, Any] = {"readout": readout}
    found["driven"] = "columns" if "columns" in ends else DRIVEN[0]
    found |= {"diode": _DIODE} if "diodes" in ends else {}
    found |= {"adc_table": "esp32"} if "esp32" in ends else {}
    return found | {"pull_up": "pullup" in ends}


def _number(name: str, text: str) -> float:
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        number = 0.0
    if not number > 0.0:
        raise ValueError(f"{name} = {text!r}: must be a number above 0")
    return number


def _usual_scale(seen: Seen) -> float:
    """Return the end of 10 or 12 bits where that may hold all readings; 0: they may be anything."""
    ends = [] if seen.decimals else [2.0**bits - 1 for bits in _USUAL_WIDTHS]
    return next((end for end in ends if seen.largest <= end), 0.0)


def _circuit(seen: Seen, answers: dict) -> dict:
    """Return the parameters circuit.*; ValueError: an answer that no circuit has."""
    circuit = {name: answers[name] for name in ("rows", "cols", "r_ref")}
    # those of an ADC whose steps are as fine as what is printed
    steps = answers.get("full_scale", 0.0) / (seen.step or 1.0)
    circuit["adc_bits"] = seen.adc_bits or _width(answers) or _bits_of(steps)
    readout = answers["readout"]
    if readout != READOUTS[0]:
        circuit |= {"readout": readout, "driven": answers.get("driven", DRIVEN[0])}
        circuit["r_par"] = _R_PAR.get(readout, 0.0)
    if readout == "grounded":
        circuit["r_drive"] = PIN
    others = ("r_par", "r_drive", "diode", "adc_table")
    circuit |= {name: answers[name] for name in others if name in answers}
    if answers.get("pull_up"):
        circuit["inverted"] = True
    skin_of({f"circuit.{name}": value for name, value in circuit.items()}, "")
    return circuit


def _width(answers: dict) -> int | None:
    """Return the bits of the ADC whose full scale was answered; None: it is that of none."""
    return next((bits for bits in WIDTHS if 2**bits - 1 == answers.get("full_scale")), None)


def _bits_of(steps: float) -> int:
    """Return the bits of the smallest ADC with so many steps."""
    return next((bits for bits in WIDTHS if 2**bits - 1 >= steps), WIDTHS[-1])


def _text(found: Heard, answers: dict, circuit: dict, where: dict) -> str:
    """Return the parameter file."""
    seen = found.seen
    driver = {"protocol": seen.protocol, "baud": found.baud} | where
    if seen.format:  # what differs from the protocol's default description
        scale = 0.0 if _width(answers) else answers.get("full_scale", 0.0)
        form = dataclasses.replace(seen.format, full_scale=scale, request=found.request)
        usual = {field.name: field.default for field in dataclasses.fields(form)}
        if differs := {k: v for k, v in dataclasses.asdict(form).items() if v != usual[k]}:
            driver["format"] = differs
    data = {"/**": {"circuit": circuit}, "/**/serial_driver": driver}
    if seen.protocol != "binary":  # its frames come at the sketch's pace
        data["/**/stop_on_push"] = {"debounce": 0.01, "lead": 0.0}
    sections = {name: {"ros__parameters": values} for name, values in data.items()}
    how = "sure" if seen.sure else "NOT SURE: compare with the sketch"
    diode = "# circuit.diode: as of a 1N4148; enter that of yours at 1 mA, and circuit.supply\n"
    return (
        f"# written by tactile-skin detect: {seen.about} ({how})\n"
        f"# what arrived: {shown(seen.sample or found.data, seen.text)}\n"
        "# geometry (where the skin is on the robot) is not stated: pushes have no direction\n"
        + (diode if "diode" in circuit else "")
        + write_yaml(sections)
    )
