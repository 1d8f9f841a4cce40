# SPDX-License-Identifier: Apache-2.0
"""The firmware on a simulated ATmega328P: its frames, its timing, and another simulator of it."""

from __future__ import annotations

import ctypes
import json
import subprocess
import time
from typing import NamedTuple

import numpy as np

from support import chip as simulated
from support.chip import CLOCK, TAU
from support.chips import AVR8JS
from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.board import description
from tactile_skin.board.firmware import build
from tactile_skin.board.frame import Counters
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.simulation import scenes

STEPS = 1024  # of the ADC in the supply's voltage (data sheet: ADC = V * 1024 / V_ref)
CURVE = PressureCurve()
_CHUNK = 0.01  # s
BROWN_OUT, WATCHDOG = 4, 8  # causes of a reset, as in MCUSR


class Measured(NamedTuple):
    """What was seen of the chip's work, in cycles of its clock."""

    cycles: int  # since the start
    conversions: int  # of the ADC
    settling: int  # least time from a switch of the multiplexers to the next conversion
    hold: int  # least time from the begin of a conversion to the next switch
    # early, late: most that a conversion began before or after its tick
    early: int
    late: int
    overruns: int  # bytes that came faster than the program took them


class Chip(simulated.Chip):
    """A chip that is measured, and that things happen to."""

    def hang(self) -> None:
        """Let the program run astray, into a loop that never ends."""
        assert self._library.chip_hang(self._chip)

    def slow_line(self, cycles: int) -> None:
        """Let the serial line take so many cycles for a byte, instead of 160."""
        self._library.chip_set_byte_cycles(self._chip, cycles)

    def measured(self) -> Measured:
        values = (ctypes.c_int64 * len(Measured._fields))()
        self._library.chip_measured(self._chip, values)
        return Measured(*values)


def resistance(circuit: Circuit, scene: str, t: float = 0.0) -> np.ndarray:
    """(rows, cols) [ohm] of the cells under a scripted scene."""
    return CURVE.resistance(scenes.script(scene, *circuit.shape)(t))


def frames_of(chip: Chip, parser: BinaryParser, seconds: float) -> list:
    """The frames that the chip sends in this time."""
    count = max(1, round(seconds / _CHUNK))
    return [frame for _ in range(count) for frame in parser.feed(chip.run(seconds / count))]


class Steady(NamedTuple):
    """Of some time in which nothing changes."""

    # scans, cells, frames: a second
    scans: float
    cells: float
    frames: float
    # largest difference of a reading from the model, in ADC steps of 1/1024 of the supply
    error: float
    counters: Counters
    measured: Measured
    speed: float  # of the simulation, in real time


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
