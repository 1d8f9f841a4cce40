# SPDX-License-Identifier: Apache-2.0
"""What bytes are that nobody described: one answer for `detect` and for the live messages.

Imports the parsers of board: what is recognised is what a parser then reads.
"""

from __future__ import annotations

import json
import math

from ...readings.scale import VOLTS, other_scale
from ..frame import Parser
from ..packets import PacketFormat, PacketParser
from ..protocol import BinaryParser
from ..text import TextParser
from .lines import of_boards, recognise_lines
from .periods import recognise_packets
from .seen import Seen, shown

_MANY = 64  # bytes that are enough to tell text from noise
_STRANGE = 0.05  # of a text's bytes are no text, at least, where the baud rate is wrong
_PRINTABLE = bytes(range(32, 127)) + b"\t\r\n\x1b"
_SAMPLE = 16_384  # bytes that a live message looks at
BAUD = "is serial_driver.baud that of the board's sketch?"


def recognise(
    data: bytes, shape: tuple[int, int] | None = None, hexadecimal: bool | None = None
) -> Seen:
    """Return what a sample of bytes is.

    Args:
        shape: the (rows, cols) that are expected, if any.
        hexadecimal: whether numbers in a text are; None: nobody knows.
    """
    own = BinaryParser()
    frames = own.feed(data)
    if frames and own.layout:
        rows, cols, bits, _ = own.layout
        about = f"binary frames of {rows} x {cols} at {bits} bits"
        largest = max(float(frame.samples.max()) for frame in frames) / 2 ** (16 - bits)
        return Seen(
            "binary",
            about,
            data[:64],
            None,
            (rows, cols),
            rows * cols,
            len(frames),
            len(frames) > 1,
            largest,
            adc_bits=bits,
        )
    if len(data) < _MANY:
        return Seen("", "too few bytes to tell", data, text=not data.translate(None, _PRINTABLE))
    strange = data.translate(None, _PRINTABLE)
    packets = recognise_packets(data, shape) if strange else None
    if packets and len(strange) > _STRANGE * len(data):
        return packets
    # what a check proves is no text, whatever its bytes look like; nor is what has a head of bytes
    # that no text has, unless lines of numbers are sure
    if packets and isinstance(packets.format, PacketFormat):
        if packets.format.check:
            return packets
        lines = recognise_lines(data, shape, hexadecimal)
        head = bytes.fromhex(packets.format.head.replace("?", ""))
        return lines if lines.sure or head.isascii() else packets
    return recognise_lines(data, shape, hexadecimal)


def explain(parser: Parser) -> str:
    """Why a parser finds no frames in its last bytes, for a person; empty: nothing is known.

    A setting is named only where the bytes leave no other explanation that is known here.
    """
    seen = _last(parser, parser.shape)
    return _reason(parser, seen) if seen else ""


def sample(parser: Parser) -> str:
    """Return a line that shows the last bytes, with what cannot be printed escaped."""
    seen = _last(parser, None)
    return shown(seen.sample, seen.text) if seen else ""


def _last(parser: Parser, shape: tuple[int, int] | None) -> Seen | None:
    """Return what the last bytes are; None: they are too few."""
    data = bytes(parser.tail[-_SAMPLE:])
    seen = recognise(data, shape)
    return seen if len(data) >= _MANY or seen.frames else None


def _reason(parser: Parser, seen: Seen) -> str:
    if seen.protocol == "binary":
        if isinstance(parser, BinaryParser):
            return "samples exceed what the frame's header states: check the board's adc_bits"
        return f"{seen.about} arrive: set serial_driver.protocol: binary"
    if not seen.text:
        what = "neither binary frames nor text"
        if isinstance(parser, PacketParser):
            what = "not the packets that are described"
        elif isinstance(parser, TextParser):
            what = "the bytes are not text"
        return f"{what}: {seen.about or BAUD}"
    if not isinstance(parser, TextParser):
        if seen.sure:
            return f"text arrives, {seen.about}: set serial_driver.protocol: text"
        return f"text arrives: {seen.about}"
    return _of_text(parser, seen)


def _of_text(parser: TextParser, seen: Seen) -> str:
    """Return what is wrong with lines: format, number of readings, or the numbers' scale."""
    counters, top = parser.counters, 2**parser.adc_bits - 1
    full = parser.format.full_scale
    wanted = parser.rows * parser.cols
    if counters.boards:
        return of_boards(counters.boards)
    if not seen.protocol:
        return seen.about
    if seen.cells != wanted or seen.shape not in (None, (parser.rows, parser.cols)):
        return (
            f"{seen.about}; circuit.rows = {parser.rows} x circuit.cols = {parser.cols} are "
            f"{wanted} readings"
        )
    given, found = parser.format, seen.format
    wrong = [
        name
        for name in ("line", "end", "first", "hexadecimal")
        if getattr(given, name) != getattr(found, name)
    ]
    if wrong:
        settings = [
            f"serial_driver.format.{name}: {_typed(getattr(found, name))}" for name in wrong
        ]
        setting = f": set {', '.join(settings)}" if seen.sure else ""
        return f"{seen.about}, not what serial_driver.format describes{setting}"
    if full and counters.out_of_range:
        return f"numbers up to {counters.largest:g}, but format.full_scale = {full:g}"
    if counters.out_of_range:
        return (
            f"numbers up to {counters.largest:g}, but circuit.adc_bits = {parser.adc_bits} ends at "
            f"{top}: {_beyond(seen, counters.largest)}"
        )
    if not full and seen.decimals and seen.largest <= other_scale(top):
        kinds = ("shares of the supply or volts", 1.0), ("volts", VOLTS), ("resistances", math.inf)
        kind = next(name for name, most in kinds if seen.largest <= most)
        ohms = "" if seen.largest <= 1.0 else " Resistances cannot be read: print the ADC's steps"
        return (
            f"numbers up to {seen.largest:g}: these look like {kind}: set "
            f"serial_driver.format.full_scale to what is printed at the supply, {top} if they are "
            f"ADC steps.{ohms}"
        )
    return f"{seen.about}, but not one arrives whole"


def _typed(value: str | int) -> str:
    """Return a value as it is typed into a YAML file."""
    if isinstance(value, int):
        return str(value).lower()
    return "'" + value.replace("'", "''") + "'" if value.isprintable() else json.dumps(value)


def _beyond(seen: Seen, largest: float) -> str:
    """Return what numbers beyond the ADC's range may be."""
    bits = int(largest).bit_length()
    kinds = []
    if bits <= 16 and not seen.decimals:
        if largest == 2**bits - 1 and seen.at_largest >= 3:
            return f"{largest:.0f} is the end of {bits} bits: set circuit.adc_bits: {bits}"
        kinds.append(f"an ADC of {bits} bits or more")
    if largest <= 1000.0 * VOLTS:
        kinds.insert(0, "millivolts (serial_driver.format.full_scale)")
    return f"{', or '.join([*kinds, 'sums of several readings', 'resistances'])}?"
