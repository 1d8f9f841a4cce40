# SPDX-License-Identifier: Apache-2.0
"""The simulated board: the real bytes, on a real serial device (a pseudo-terminal).

It does what the ATmega328P does: scan the matrix, low-pass every sample in integers, send a frame
now and then. `Board` is the electronics and knows no port; `serve` puts it behind a pty.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..board import protocol, terminal, text
from ..physics.adc import Adc
from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from .matrix import Matrix, resting_curve

SCANS_PER_SECOND = 390  # paper section III-B
FRAMES_PER_SECOND = 100
_CATCHES_UP = 0.02  # s that the simulation may lag; what it lags more, it leaves out
SPOKEN = "binary", "text"  # protocols
BAUD = 1_000_000  # exact on a 16 MHz ATmega328P; a 16x16 frame of 529 bytes takes 5.3 ms


class Board:
    """The electronics: a matrix, ADC noise and rounding, recursive low-pass, framing.

    Attributes:
        matrix: as it truly is; may be changed.
        curve: that of its cells.

    Args:
        seed: of the fabric and of the noise.
        scene: time since start [s] -> (rows, cols) force per cell [N].
        noise: RMS noise of one sample, in ADC steps.
        frames_per_second: frames sent, at most SCANS_PER_SECOND.
        kind: the protocol that it speaks, "binary" or "text".
        adc: its converter; None: a count is the ratio times 2^bits - 1.
    """

    def __init__(
        self,
        circuit: Circuit,
        curve: PressureCurve,
        scene: Callable[[float], np.ndarray],
        noise: float = 1.0,
        frames_per_second: float = FRAMES_PER_SECOND,
        seed: int = 0,
        kind: str = "binary",
        adc: Adc | None = None,
    ):
        if kind not in SPOKEN:
            raise ValueError(f"protocol {kind!r}: must be one of {', '.join(SPOKEN)}")
        if not 0 < frames_per_second <= SCANS_PER_SECOND:
            raise ValueError(
                f"frames_per_second = {frames_per_second!r}: "
                f"must be above 0, at most {SCANS_PER_SECOND}"
            )
        if not noise >= 0:
            raise ValueError(f"noise = {noise!r} ADC steps: must be 0 or more")
        self.circuit, self.scene, self._adc = circuit, scene, adc or Adc(circuit)
        self.matrix = Matrix.resting(circuit, curve, seed)
        self.curve = resting_curve(curve, circuit.shape, seed)
        self.noise, self.frames_per_second, self.kind = noise, frames_per_second, kind
        self._fraction_bits = min(6, 16 - circuit.adc_bits)
        self._rng = np.random.default_rng(seed)
        self.restart()

    def restart(self) -> None:
        """As the reset line of a real board does when its port is opened."""
        self._scans = 0
        self._frames = self._sent = 0
        self._filtered: np.ndarray | None = None

    def skip(self, scans: int) -> None:
        """Let the time of so many scans go by without them: the computer was too slow for them."""
        self._scans += scans
        self._frames = int(self._scans * self.frames_per_second / SCANS_PER_SECOND)

    def scan(self) -> bytes:
        """Read the matrix once; the frame if one is due, else nothing."""
        t = self._scans / SCANS_PER_SECOND
        steps = self._adc.count(self.matrix.ratio(self.scene(t)[None])[0])
        sample = np.rint(steps + self.noise * self._rng.standard_normal(steps.shape))
        sample = np.clip(sample, 0, self.circuit.full_scale).astype(np.int32)
        sample <<= self._fraction_bits
        if self._filtered is None:
            self._filtered = sample
        else:  # y += 3/8 (x - y): in noise like a mean of 4 scans, 5 ms behind
            self._filtered = self._filtered + ((3 * (sample - self._filtered)) >> 3)
        self._scans += 1
        due = int(self._scans * self.frames_per_second / SCANS_PER_SECOND)
        if due == self._frames:
            return b""
        self._frames = due
        self._sent += 1
        if self.kind == "text":
            return text.line(self._filtered >> self._fraction_bits)
        return protocol.encode(
            self._sent - 1,
            round(self._scans / SCANS_PER_SECOND * 1e6),
            self._filtered,
            self.circuit.adc_bits,
            self._fraction_bits,
        )


def serve(
    board: Board,
    link: Path,
    running: Callable[[], bool],
    baud: int = BAUD,
    on_ready: Callable[[], None] = lambda: None,
    once: bool = False,
) -> None:
    """Put the board behind a pty as `terminal.serve` does, at a baud rate, which a pty has not."""
    tick = 1.0 / SCANS_PER_SECOND
    bytes_per_tick = baud / 10 * tick  # 8N1: ten bits a byte
    pending, allowance = bytearray(), 0.0

    def restart() -> None:
        nonlocal allowance
        board.restart()
        pending.clear()
        allowance = 0.0

    def turn(port: terminal.Terminal, late: float) -> float:
        nonlocal allowance
        # a real board's clock does not stand still meanwhile
        if missed := int(late / tick) if late > _CATCHES_UP else 0:
            board.skip(missed)
        port.read()  # the board takes no commands; unread input would stop the pty
        frame = board.scan()
        if not pending:  # a frame that is due while the last one still goes out is skipped
            pending.extend(frame)
        allowance = min(allowance + bytes_per_tick, len(pending))
        if n := int(allowance):
            written = port.write(bytes(pending[:n]))
            del pending[:written]
            allowance -= written
        return missed * tick

    terminal.serve(link, running, tick, restart, turn, on_ready, once)
