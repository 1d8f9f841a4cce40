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

import numpy as np
from support.chip import TAU
from support.chips import AVR8JS
from support.firmware import (
    CURVE,
    STEPS,
    Chip,
    frames_of,
    on_both,
    resistance,
    steady,
    time_constant,
)

from tactile_skin import Circuit, compensate, forward
from tactile_skin.board.firmware import build
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.simulation import scenes

from .. import harness


def settling(tau: float) -> float:
    """Largest error of a reading [ADC steps] if the ADC's input has this time constant [s]."""
    circuit = Circuit()
    with Chip(circuit, tau=tau) as chip:
        cells = resistance(circuit, "two_fingers")
        chip.feel(cells)
        frame = frames_of(chip, BinaryParser(), 0.3)[-1]
    return float(np.abs(frame.samples / 64 - forward(circuit, cells) * STEPS).max())


def converter(error: float, frames: int = 20, seed: int = 3) -> tuple[float, float]:
    """Share of touched frames that are suspect, and the largest error of a sum of forces, if the
    ADC's error is up to `error` steps, smooth over the scale (three sines of random phase)."""
    circuit, rng = Circuit(), np.random.default_rng(seed)
    suspect, off = [], []
    for scene in ("one_finger", "two_fingers", "push_left"):
        force = scenes.script(scene, *circuit.shape)(0.0)
        u = forward(circuit, CURVE.resistance(force))
        for _ in range(frames):
            phase = rng.uniform(0.0, 2.0 * np.pi, 3)
            sines = [np.sin(2.0 * np.pi * n * u + p) for n, p in zip((1, 3, 8), phase, strict=True)]
            wrong = error * (sines[0] + sines[1] + 0.5 * sines[2]) / 2.5
            reading = u + (wrong + 0.5 * rng.standard_normal(u.shape)) / STEPS
            estimate = compensate(reading, circuit, CURVE, method="map")
            suspect.append(estimate.status != "ok")
            off.append(abs(estimate.force.sum() / force.sum() - 1.0))
    return float(np.mean(suspect)), max(off)


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
