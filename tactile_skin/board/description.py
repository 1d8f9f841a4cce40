# SPDX-License-Identifier: Apache-2.0
"""What a board with the firmware says of itself, and the commands that it takes.

Description, little-endian: sent at the start, and as the answer to a command.

    offset  size  field
    0       2     magic, 0xA5 0xD5
    2       1     version of the protocol, 1
    3       1     version of the firmware
    4       1     rows
    5       1     cols
    6       1     adc_bits
    7       1     fraction_bits
    8       1     rate, frames a second
    9       1     filter, eighths of a new reading that the low-pass takes; 8: no low-pass
    10      2     time of one scan [us]
    12      1     cause of the last reset: 1 power-on, 2 reset pin, 4 brown-out, 8 watchdog
    13      2     CRC of all bytes before it

Command: magic 0xC5, a letter, a value, and the CRC of these three (2 bytes).

    letter  value
    d       any: describe yourself
    r       frames a second, 1 to 100
    f       filter, 1 to 8
    u       any: the next frame holds one unfiltered scan; its samples have no fraction

A value out of range changes nothing. The CRC is that of frames (protocol.py).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from .protocol import VERSION, crc16

MAGIC = b"\xa5\xd5"
COMMAND_MAGIC = 0xC5
DESCRIBE, RATE, FILTER, RAW = "drfu"
RATES = 1, 100  # frames a second, the least and the most
FILTERS = 1, 8  # eighths of a new reading that the low-pass takes, the same
_BODY = struct.Struct("<2s8BHB")
_COMMAND = struct.Struct("<BcB")
_CRC = struct.Struct("<H")
SIZE = _BODY.size + _CRC.size
_CAUSES = ((4, "brown-out"), (8, "watchdog"), (1, "power-on"), (2, "reset pin"))  # worst first


@dataclass(frozen=True)
class Description:
    """What a board says of itself; the fields are those of the table above."""

    firmware: int
    rows: int
    cols: int
    adc_bits: int
    fraction_bits: int
    rate: int
    filter: int
    scan_us: int
    reset_cause: int

    @property
    def scans_per_second(self) -> float:
        return 1e6 / self.scan_us

    @property
    def time_constant(self) -> float:
        """Of the low-pass [s]: after so long 63 % of a step have arrived; 0 without one."""
        if self.filter == FILTERS[1]:
            return 0.0
        return -self.scan_us * 1e-6 / math.log(1.0 - self.filter / FILTERS[1])

    def __str__(self) -> str:
        causes = [name for bit, name in _CAUSES if self.reset_cause & bit]
        return (
            f"firmware {self.firmware}, {self.rows} x {self.cols} at {self.adc_bits} + "
            f"{self.fraction_bits} bits, {self.scans_per_second:.0f} scans and {self.rate} frames "
            f"a second, low-pass of {1e3 * self.time_constant:.1f} ms, last reset: "
            f"{causes[0] if causes else 'unknown'}"
        )


def find_description(data: bytes) -> Description | None:
    """Return the last complete description among the bytes of a board; None if there is none."""
    start = len(data)
    while (start := data.rfind(MAGIC, 0, start)) >= 0:
        body, crc = data[start : start + _BODY.size], data[start + _BODY.size : start + SIZE]
        if len(crc) == _CRC.size and _CRC.unpack(crc)[0] == crc16(body):
            _, version, *fields = _BODY.unpack(body)
            if version == VERSION:
                return Description(*fields)
    return None


def command(letter: str, value: int = 0) -> bytes:
    """Return the bytes of a command: DESCRIBE, RATE, FILTER or RAW.

    Raises:
        ValueError: a value that the board would not take.
    """
    least, most = {RATE: RATES, FILTER: FILTERS}.get(letter, (0, 255))
    if not least <= value <= most:
        raise ValueError(f"command {letter!r}: value {value} must be from {least} to {most}")
    body = _COMMAND.pack(COMMAND_MAGIC, letter.encode(), value)
    return body + _CRC.pack(crc16(body))
