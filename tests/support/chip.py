# SPDX-License-Identifier: Apache-2.0
"""The firmware on a simulated ATmega328P: its binary, byte for byte, on simavr.

chip.c is what is wired to the chip; the voltages that it finds are those of the circuit model, and
settle as a resistor and a capacitor do. `serve` puts the board behind a pty, as simulator.py does.
"""

from __future__ import annotations

import ctypes
import functools
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactile_skin.board import terminal
from tactile_skin.board.firmware import build
from tactile_skin.errors import FirmwareError
from tactile_skin.physics.adc import Adc
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import PressureCurve

CLOCK = 16_000_000  # Hz
_ADC_STEPS = 1024.0  # that the chip reads at its reference, of which it sends 1023 at most
TAU = 0.27e-6  # s: R_ref, 1.78 kohm, and 150 pF of multiplexers, wires and the chip's input
RESET_PIN = 2  # cause of a reset, as in MCUSR
_BUFFER = 1 << 16  # bytes that chip.c keeps
_TICK = 0.005  # s between two looks at the scene and at the port


def _library(folder: Path) -> Path:
    """Compile what is wired to the simulated chip, chip.c, against simavr's library."""
    library, source = folder / "chip.so", Path(__file__).with_name("chip.c")
    flags, libraries = ["-O2", "-Wall", "-Wextra", "-shared", "-fPIC"], ["-lsimavr", "-lelf", "-lm"]
    packages = "gcc libc6-dev libsimavr-dev libelf-dev"
    build.run(["gcc", *flags, source, "-o", library, *libraries], packages)
    return library


@functools.cache
def _built(rows: int, cols: int, adc_mhz: int):
    """Return the library of chip.c, the firmware's binary, and the folder that keeps them."""
    folder = tempfile.TemporaryDirectory(prefix="tactile_skin")
    library = ctypes.CDLL(str(_library(Path(folder.name))))
    return library, build.firmware(Path(folder.name), rows, cols, adc_mhz), folder


class Chip:
    """The chip, with the binary in its flash; use it with `with`.

    Args:
        circuit: the skin; its rows and cols are compiled in.
        tau: time constant of the ADC's input after a switch [s].
        noise: RMS of a reading [ADC steps].
        seed: of the noise.
        adc_mhz: clock of the ADC, 2 or 1 [MHz]; it is compiled in.
        adc: how the input is wired, as the configuration says; None: its reference is the supply.

    Raises:
        FirmwareError: the firmware does not compile, or simavr is not installed.
    """

    def __init__(
        self,
        circuit: Circuit,
        tau: float = TAU,
        noise: float = 0.0,
        seed: int = 1,
        adc_mhz: int = 2,
        adc: Adc | None = None,
    ):
        if circuit.adc_bits != 10:
            raise FirmwareError(f"adc_bits = {circuit.adc_bits}: the ATmega328P has 10")
        self.circuit, self._adc = circuit, adc or Adc(circuit, full_scale=_ADC_STEPS)
        self._library, self.elf, _ = _built(circuit.rows, circuit.cols, adc_mhz)
        new = self._library.chip_new
        new.restype = ctypes.c_void_p
        new.argtypes = [ctypes.c_char_p, ctypes.c_double, ctypes.c_double, ctypes.c_uint32]
        pointer = new(str(self.elf).encode(), tau * CLOCK, noise, seed)
        if not pointer:
            raise FirmwareError(f"{self.elf}: simavr cannot run it")
        self._chip = ctypes.c_void_p(pointer)
        self._bytes = ctypes.create_string_buffer(_BUFFER)

    def __enter__(self) -> Chip:
        return self

    def __exit__(self, *_) -> None:
        self._library.chip_free(self._chip)

    def feel(self, resistance: np.ndarray) -> None:
        """Let the cells conduct so from now on: (rows, cols) [ohm]."""
        steps = self._adc.count(forward(self.circuit, resistance))
        ratio = np.zeros((build.MAX_LINES, build.MAX_LINES))
        ratio[: self.circuit.rows, : self.circuit.cols] = np.clip(steps / _ADC_STEPS, 0.0, 1.0)
        self._library.chip_feel(self._chip, ratio.ctypes.data_as(ctypes.c_void_p))

    def run(self, seconds: float) -> bytes:
        """Let the chip work; the bytes that it sent, at most 65,536.

        Raises:
            FirmwareError: the program ended: it ran into an instruction that there is not.
        """
        runs = self._library.chip_run(self._chip, ctypes.c_uint64(round(seconds * CLOCK)))
        n = self._library.chip_sent(self._chip, self._bytes)
        if not runs:
            raise FirmwareError("the program of the simulated chip crashed")
        return self._bytes.raw[:n]

    def send(self, data: bytes) -> None:
        """Bytes to the chip: they arrive one by one while it runs."""
        self._library.chip_receive(self._chip, data, len(data))

    def reset(self, cause: int = RESET_PIN) -> None:
        """Begin anew, in the middle of whatever it does."""
        self._library.chip_reset(self._chip, cause)


def serve(
    chip: Chip,
    curve: PressureCurve,
    scene: Callable[[float], np.ndarray],
    link: Path,
    running: Callable[[], bool],
    on_ready: Callable[[], None] = lambda: None,
    once: bool = False,
) -> None:
    """Put the chip behind a pty as `terminal.serve` does; `scene`: time [s] -> force [N]."""
    ticks = 0

    def restart() -> None:
        nonlocal ticks
        chip.reset()
        ticks = 0

    def turn(port: terminal.Terminal, late: float) -> float:
        nonlocal ticks
        chip.send(port.read())
        chip.feel(curve.resistance(scene(ticks * _TICK)))
        port.write(chip.run(_TICK))
        ticks += 1
        return 0.0

    terminal.serve(link, running, _TICK, restart, turn, on_ready, once)
