# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin flash`: the firmware onto a board, and what the board then says of itself."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ..arguments import split
from ..board.firmware import build, flash
from ..board.serial_port import check_port
from ..middleware.config import read_skin

EXAMPLES = """\
Its present program is overwritten. The chip's signature is read first, and another chip is left
as it is.
Needs apt-get install gcc-avr avr-libc avrdude.
examples:
  tactile-skin flash port:=/dev/ttyUSB0
  tactile-skin flash port:=/dev/ttyUSB0 config:=my_skin.yaml
options, name:=value:
  port      serial device of the board; always to be named
  config    parameter file with circuit.rows and circuit.cols (default: 16 x 16)
  adc_mhz   clock of the ADC, 2 or 1: docs/board.md (default 2)"""
_KINDS = {"port": str, "config": str, "adc_mhz": int}


def register(parser) -> None:
    parser.add_argument("words", nargs="*", metavar="NAME:=VALUE", help="port, and options")


def run(args) -> int:
    """Compile, read the signature, write, and ask the board what it is; each is said before."""
    files, given = split(args.words, _KINDS)
    if files:
        raise ValueError(f"{files[0]!r}: must be NAME:=VALUE, NAME one of {', '.join(_KINDS)}")
    if "port" not in given:
        raise ValueError("port is missing: name the board's, such as port:=/dev/ttyUSB0")
    port, adc_mhz = given["port"], given.get("adc_mhz", build.ADC_MHZ[0])
    if port == "auto":
        raise ValueError("port:=auto: name the port, since its program will be overwritten")
    check_port(port)
    if adc_mhz not in build.ADC_MHZ:
        raise ValueError(f"adc_mhz:={adc_mhz}: must be 2 or 1")
    circuit = read_skin(given.get("config")).circuit
    with tempfile.TemporaryDirectory(prefix="tactile_skin") as folder:
        print(f"compiling the firmware for {circuit.rows} x {circuit.cols}", flush=True)
        elf = build.firmware(Path(folder), circuit.rows, circuit.cols, adc_mhz)
        image, size = build.hex_file(elf), build.size(elf)
        print(f"  {size.flash} of {build.FLASH} bytes of flash, {size.ram} of {build.RAM} of RAM")
        print(f"reading the signature of the chip on {port}; nothing is written yet", flush=True)
        signature, baud = flash.find_chip(port)
        print(f"  {flash.check_signature(port, signature)}, boot loader at {baud} baud")
        print("writing the firmware over the present program, and reading it back", flush=True)
        flash.write(port, baud, signature, image)
    print("asking the board what it is", flush=True)
    found = flash.ask(port)
    if found is None:
        print("  no answer: is it wired to the USB converter that the port belongs to?")
        return 1
    print(f"  {found}")
    return 0
