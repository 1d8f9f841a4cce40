"""What the firmware does on a simulated ATmega328P:
`python tests/yardsticks/firmware.py [--seconds T]`.

simavr runs the binary; the voltages are those of the circuit model, settling included, without
noise unless it is said. `steady` is what a minute of scans is like, `time_constant` what a step of
load is like behind the low-pass, `settling` how slow the ADC's input may be, `converter` what an
error of the ADC costs, `on_both` what avr8js sends for the same load and noise. Needs gcc-avr,
avr-libc, libsimavr-dev and libelf-dev; avr8js needs node, and `npm ci` in tests/avr8js.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.board import description
from tactile_skin.board.firmware import build
from tactile_skin.board.firmware.chip import CLOCK, TAU, Chip, Measured
from tactile_skin.board.frame import Counters
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.learning import scenes

STEPS = 1024  # of the ADC in the supply's voltage (data sheet: ADC = V * 1024 / V_ref)
CURVE = PressureCurve()
_CHUNK = 0.01  # s


def resistance(circuit: Circuit, scene: str, t: float = 0.0) -> np.ndarray:
    """(rows, cols) [ohm] of the cells under a scripted scene."""
    return CURVE.resistance(scenes.script(scene, *circuit.shape)(t))


def frames_of(chip: Chip, parser: BinaryParser, seconds: float) -> list:
    """The frames that the chip sends in this time."""
    count = max(1, round(seconds / _CHUNK))
    return [frame for _ in range(count) for frame in parser.feed(chip.run(seconds / count))]


class Steady(NamedTuple):
    """Of some time in which nothing changes.

    Attributes:
        scans, cells, frames: a second.
        error: largest difference of a reading from the model, in ADC steps of 1/1024 of the supply
        speed: of the simulation, in real time.
    """

    scans: float
    cells: float
    frames: float
    error: float
    counters: Counters
    measured: Measured
    speed: float


def steady(
    seconds: float, scene: str = "two_fingers", circuit: Circuit | None = None, adc_mhz: int = 2
) -> Steady:
    circuit = circuit or Circuit()
    with Chip(circuit, adc_mhz=adc_mhz) as chip:
        cells = resistance(circuit, scene)
        chip.feel(cells)
        parser = BinaryParser()
        frames_of(chip, parser, 0.2)
        before, begun = chip.measured(), time.perf_counter()
        frames = frames_of(chip, parser, seconds)
        speed = seconds / (time.perf_counter() - begun)
        now = chip.measured()
    passed = (now.cycles - before.cycles) / CLOCK
    conversions = (now.conversions - before.conversions) / passed
    u = forward(circuit, cells)
    error = max(np.abs(f.samples / 2 ** (16 - f.adc_bits) - u * STEPS).max() for f in frames)
    per_frame = np.diff([frames[0].device_time_us, frames[-1].device_time_us])[0] * 1e-6
    return Steady(
        conversions / circuit.populated.size,
        conversions,
        (len(frames) - 1) / per_frame,
        float(error),
        parser.counters,
        now,
        speed,
    )


def time_constant(filter_eighths: int, steps: int = 24) -> tuple[float, float]:
    """Of the low-pass, measured by steps of load and as the board states it [s].

    The steps come at any moment between two frames, so that they are seen at all delays.
    """
    circuit, rng = Circuit(), np.random.default_rng(0)
    cells = [resistance(circuit, scene) for scene in ("idle", "push_left")]
    mean = [STEPS * 64 * forward(circuit, each).mean() for each in cells]
    delays, left = [], []
    with Chip(circuit) as chip:
        parser = BinaryParser()
        chip.feel(cells[0])
        chip.run(0.1)
        chip.send(description.command(description.FILTER, filter_eighths))
        said = description.find_description(chip.run(0.2))
        for k in range(1, steps + 1):
            frames_of(chip, parser, 0.2 + rng.uniform(0.0, 0.01))
            chip.feel(cells[k % 2])
            begun, old, new = chip.measured().cycles / CLOCK, mean[1 - k % 2], mean[k % 2]
            for frame in frames_of(chip, parser, 0.05):
                delays.append(frame.device_time_us * 1e-6 - begun)
                left.append((new - frame.samples.mean()) / (new - old))
    delays, left = np.array(delays), np.array(left)
    use = (left > 0.01) & (left < 0.8)
    return -1.0 / np.polyfit(delays[use], np.log(left[use]), 1)[0], said.time_constant


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


AVR8JS = Path(__file__).parents[1] / "avr8js"


def on_both(seconds: float, noise: float = 1.0, seed: int = 5) -> tuple[bytes, bytes]:
    """The bytes that simavr and avr8js send of the same three scenes, a third of the time each."""
    circuit = Circuit()
    world = {"seconds": seconds, "tau": TAU * CLOCK, "noise": noise, "seed": seed, "ratio": []}
    sent = b""
    with Chip(circuit, noise=noise, seed=seed) as chip:
        for k, scene in enumerate(("idle", "two_fingers", "push_left")):
            cells = resistance(circuit, scene)
            chip.feel(cells)
            world["ratio"].append((seconds * k / 3, forward(circuit, cells).ravel().tolist()))
            end = round(seconds * CLOCK * (k + 1) / 3)  # cycles
            while (left := end - chip.measured().cycles) > 0:
                sent += chip.run(min(0.5, left / CLOCK))
        image = build.hex_file(chip.elf)
        file = image.with_suffix(".json")
        file.write_text(json.dumps(world))
        command = ["node", AVR8JS / "run.mjs", image, file]
        return sent, subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of board time (default 60)")
    seconds = parser.parse_args().seconds
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
    main()
