# SPDX-License-Identifier: Apache-2.0
"""Put the firmware on a board by avrdude: its chip's signature is read first, and must be right."""

from __future__ import annotations

import re
import time
from pathlib import Path

import serial

from ...errors import FirmwareError
from .. import description
from . import build

SIGNATURES = {0x1E950F: "ATmega328P", 0x1E9516: "ATmega328PB"}  # the latter runs its binary
BAUDS = (115_200, 57_600)  # of the boot loaders: Optiboot's, and that of older Nanos
_SIGNATURE = re.compile(r"signature = (?:0x)?([0-9a-f]{2}) ?([0-9a-f]{2}) ?([0-9a-f]{2})", re.I)
_ANSWERS_WITHIN = 10.0  # s; a boot loader listens for a second or two after a reset
_WRITTEN_WITHIN = 60.0  # s; it takes some seconds


def find_chip(port: str) -> tuple[int, int]:
    """Return the chip's signature and the boot loader's baud rate; write nothing.

    Raises:
        FirmwareError: no boot loader answers.
    """
    for baud in BAUDS:
        try:
            text = _avrdude(port, baud)
        except FirmwareError as error:
            if "open" in str(error) or "needs" in str(error):  # the port, or avrdude itself
                raise
            continue
        if found := _SIGNATURE.search(text):
            return int("".join(found.groups()), 16), baud
    raise FirmwareError(
        f"port {port}: no boot loader answers at {' or '.join(map(str, BAUDS))} baud: is another "
        "program using the port, is it an Arduino Nano or Uno?"
    )


def check_signature(port: str, signature: int) -> str:
    """Return the name of the chip (FirmwareError: it is another one than the firmware is for)."""
    if signature not in SIGNATURES:
        known = ", ".join(f"{name} (0x{number:06x})" for number, name in SIGNATURES.items())
        raise FirmwareError(
            f"port {port}: the chip's signature is 0x{signature:06x}, the firmware is for {known}: "
            "nothing was written"
        )
    return SIGNATURES[signature]


def write(port: str, baud: int, signature: int, image: Path) -> None:
    """Write the image, an Intel HEX file, and read it back.

    Raises:
        FirmwareError: avrdude reports an error.
    """
    # a part of the other chip would be refused by avrdude as well
    part = "m328pb" if SIGNATURES[signature].endswith("B") else "m328p"
    _avrdude(port, baud, part, "-D", "-U", f"flash:w:{image}:i")


def ask(port: str) -> description.Description | None:
    """Ask the board what it says of itself; None if it does not answer in some seconds."""
    received = b""
    with serial.serial_for_url(port, 1_000_000, timeout=0.1) as line:
        until = time.monotonic() + _ANSWERS_WITHIN
        while time.monotonic() < until:
            line.write(description.command(description.DESCRIBE))
            received = (received + line.read(1024))[-4096:]
            if found := description.find_description(received):
                return found
    return None


def _avrdude(port: str, baud: int, part: str = "m328p", *action: str) -> str:
    """Run avrdude, and return what it prints; without an action it only reads the signature."""
    # -F: another signature is reported by check_signature, in one line
    what = action or ("-F", "-n")
    command = ["avrdude", "-c", "arduino", "-p", part, "-P", port, "-b", str(baud), *what]
    return build.run(command, "avrdude", _WRITTEN_WITHIN if action else _ANSWERS_WITHIN)
