# SPDX-License-Identifier: Apache-2.0
"""What the firmware does on a simulated ATmega328P.

simavr runs the binary; the voltages are those of the circuit model, settling included, without
noise unless it is said. `steady` is what a minute of scans is like, `time_constant` what a step of
load is like behind the low-pass, `settling` how slow the ADC's input may be, `converter` what an
error of the ADC costs, `on_both` what avr8js sends for the same load and noise. Needs gcc-avr,
avr-libc, libsimavr-dev and libelf-dev; avr8js needs node, and `npm ci` in tests/avr8js.
"""

from __future__ import annotations

import time

from support.chips import AVR8JS
from support.firmware import Chip, converter, on_both, settling, steady, time_constant

from tactile_skin import Circuit
from tactile_skin.board.firmware import build
from tactile_skin.board.firmware.chip import TAU
from tactile_skin.board.protocol import BinaryParser

from .. import harness


def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of board time (default 60)")
    seconds = parser.parse_args(arguments).seconds
    with Chip(Circuit()) as chip:
        size = build.size(chip.elf)
    print(f"binary: {size.flash} of {build.FLASH} bytes of flash, {size.ram} of {build.RAM} of RAM")
    found = steady(seconds)
    print(
        f"{seconds:g} s: {found.scans:.1f} scans, {found.cells:.0f} cells, {found.frames:.2f} "
        f"frames a second; {found.counters.corrupt} CRC errors, {found.counters.lost} lost; "
        f"a reading is off by {found.error:.2f} ADC steps at most"
    )
    m = found.measured
    print(
        f"settling {m.settling / 16:.1f} us, hold {m.hold / 16:.1f} us at least; conversions begin "
        f"{-m.early} cycles early to {m.late} late; {found.speed:.1f} times real time"
    )
    for eighths in (1, 3, 6):
        measured, said = time_constant(eighths)
        print(f"filter {eighths}: {1e3 * measured:.2f} ms measured, {1e3 * said:.2f} ms stated")
    for factor in (1.0, 2.0, 4.0, 6.0):
        tau = factor * TAU
        print(f"input of {1e6 * tau:.2f} us: off by {settling(tau):.2f} steps at most")
    for error in (0.0, 2.0, 4.5):
        suspect, off = converter(error)
        print(
            f"ADC wrong by up to {error:g} steps: {100 * suspect:.0f} % of touched frames suspect, "
            f"a sum of forces off by up to {100 * off:.0f} %"
        )
    if (AVR8JS / "node_modules").is_dir():
        begun = time.perf_counter()
        one, other = on_both(seconds)
        n = min(len(one), len(other))
        frames = len(BinaryParser().feed(one[:n]))
        what = "all equal" if one[:n] == other[:n] else "NOT equal"
        print(
            f"simavr and avr8js: {frames} frames with noise, {n} bytes, {what}; both at "
            f"{seconds / (time.perf_counter() - begun):.2f} times real time"
        )


if __name__ == "__main__":
    harness.run(main)
