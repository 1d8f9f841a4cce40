# SPDX-License-Identifier: Apache-2.0
"""The firmware's binary, built where it is used."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from ...errors import FirmwareError

HERE = Path(__file__).parent
MAX_LINES = 16  # channels of a multiplexer
ADC_MHZ = 2, 1  # clocks of the ADC: board.h says what each costs
CHIP = "atmega328p"
FLASH = 32256  # bytes: 32 KiB less those of the boot loader (ATmega328P)
RAM = 2048  # bytes
_COMPILE = ("avr-gcc", f"-mmcu={CHIP}", "-DF_CPU=16000000UL", "-std=c11", "-O2", "-g")
_WARNINGS = ("-Wall", "-Wextra")


class Size(NamedTuple):
    """What the binary takes [bytes]; the stack comes on top of `ram`."""

    flash: int
    ram: int


def firmware(folder: Path, rows: int = 16, cols: int = 16, adc_mhz: int = 2) -> Path:
    """Compile the firmware for a skin of this size: the path of the ELF file in `folder`.

    Raises:
        FirmwareError: a size that two multiplexers cannot read, another clock of the ADC, no
            compiler, or one that fails.
    """
    for name, value in (("rows", rows), ("cols", cols)):
        if not 1 <= value <= MAX_LINES:
            raise FirmwareError(f"{name} = {value}: the firmware reads from 1 to {MAX_LINES}")
    if adc_mhz not in ADC_MHZ:
        raise FirmwareError(f"adc_mhz = {adc_mhz}: must be one of {ADC_MHZ}")
    elf = folder / "firmware.elf"
    constants = (f"-DROWS={rows}", f"-DCOLS={cols}", f"-DADC_MHZ={adc_mhz}")
    run([*_COMPILE, *_WARNINGS, *constants, HERE / "firmware.c", "-o", elf], "gcc-avr avr-libc")
    return elf


def size(elf: Path) -> Size:
    """Flash and RAM that the binary takes."""
    text = run(["avr-size", elf], "binutils-avr")
    code, data, zeros = map(int, re.findall(r"\d+", text.splitlines()[1])[:3])
    return Size(code + data, data + zeros)


def hex_file(elf: Path) -> Path:
    """Make the binary as Intel HEX next to the ELF file: what a programmer takes."""
    path = elf.with_suffix(".hex")
    run(["avr-objcopy", "-O", "ihex", "-R", ".eeprom", elf, path], "binutils-avr")
    return path


def run(command: list, packages: str, seconds: float = 60.0) -> str:
    """Run a tool, and return what it prints within some seconds.

    Raises:
        FirmwareError: it is not there, or fails; with what to install, or its first complaint.
    """
    tool = str(command[0])
    if shutil.which(tool) is None:
        raise FirmwareError(f"needs {tool}: on Debian and Ubuntu, apt-get install {packages}")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        raise FirmwareError(f"{tool}: not done after {seconds:g} s") from None
    if done.returncode:
        lines = done.stderr.split("\n")
        first = next((line for line in lines if "error" in line), lines[0]).strip()
        raise FirmwareError(f"{tool}: {first} (Debian packages: {packages})")
    return done.stdout + done.stderr
