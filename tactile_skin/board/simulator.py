"""The simulated board: the real bytes, on a real serial device (a pseudo-terminal).

It does what the ATmega328P does: scan the matrix, low-pass every sample in integers, send a frame
now and then. `Board` is the electronics and knows no port; `serve` puts it behind a pty.
"""

from __future__ import annotations

import errno
import os
import select
import time
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from . import protocol

SCANS_PER_SECOND = 390  # paper section III-B
FRAMES_PER_SECOND = 100
_DIGITS = "0123456789"
_CATCHES_UP = 0.02  # s that the simulation may lag; what it lags more, it leaves out
BAUD = 1_000_000  # exact on a 16 MHz ATmega328P; a 16x16 frame of 529 bytes takes 5.3 ms


class Board:
    """The electronics: forward model, ADC noise and rounding, recursive low-pass, framing.

    Args:
        scene: time since start [s] -> (rows, cols) force per cell [N].
        noise: RMS noise of one sample, in ADC steps.
        frames_per_second: frames sent, at most SCANS_PER_SECOND.
    """

    def __init__(
        self,
        circuit: Circuit,
        curve: PressureCurve,
        scene: Callable[[float], np.ndarray],
        noise: float = 1.0,
        frames_per_second: float = FRAMES_PER_SECOND,
        seed: int = 0,
    ):
        if not 0 < frames_per_second <= SCANS_PER_SECOND:
            raise ValueError(
                f"frames_per_second = {frames_per_second!r}: "
                f"must be above 0, at most {SCANS_PER_SECOND}"
            )
        if not noise >= 0:
            raise ValueError(f"noise = {noise!r} ADC steps: must be 0 or more")
        self.circuit, self.curve, self.scene = circuit, curve, scene
        self.noise, self.frames_per_second = noise, frames_per_second
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
        """Read the whole matrix once; the frame if one is due, else nothing."""
        t = self._scans / SCANS_PER_SECOND
        force = self.scene(t)
        adc = forward(self.circuit, self.curve.resistance(force)) * self.circuit.full_scale
        sample = np.rint(adc + self.noise * self._rng.standard_normal(adc.shape))
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
) -> None:
    """Put the board behind a pty whose name is the symbolic link `link`, in real time.

    As on a USB board, opening the port restarts it, and what nobody reads is lost. A pty knows no
    baud rate, so the bytes are paced here. Returns when `running()` is no longer true; calls
    `on_ready()` once the link is there.

    Raises:
        FileNotFoundError: there is no folder for `link`.
        FileExistsError: `link` is there; only the link of a board that is gone is replaced.
    """
    if not link.parent.is_dir():
        raise FileNotFoundError(f"{link.parent}: no such folder for a link to a simulated board")
    master, slave = os.openpty()
    try:
        tty.setraw(slave)
        name = os.ttyname(slave)
        os.close(slave)  # from here on the master's end tells whether somebody has the port open
        os.set_blocking(master, False)
        _make_link(link, name)
        try:
            on_ready()
            _pump(board, master, running, baud)
        finally:
            if link.is_symlink() and os.readlink(link) == name:
                link.unlink()
    finally:
        os.close(master)


def _make_link(link: Path, name: str) -> None:
    """Link to the pty of this name; what is there and no dead board's stays as it is."""
    target = os.readlink(link) if link.is_symlink() else ""
    # The pty of a board that was killed is gone, and its link dangles. A link to an unplugged
    # device dangles as well, but leads elsewhere.
    if target.rstrip(_DIGITS) == name.rstrip(_DIGITS) and not os.path.exists(target):
        link.unlink()
    try:
        link.symlink_to(name)
    except FileExistsError:
        what = f"is a link to {target}, made by somebody else" if target else "is no link"
        raise FileExistsError(
            f"{link} exists and {what}: remove it, or give the simulated board another link"
        ) from None


def _pump(board: Board, master: int, running: Callable[[], bool], baud: int) -> None:
    tick = 1.0 / SCANS_PER_SECOND
    bytes_per_tick = baud / 10 * tick  # 8N1: ten bits a byte
    poller = select.poll()
    poller.register(master, select.POLLIN)
    connected = False
    pending = bytearray()
    allowance = 0.0
    next_tick = time.monotonic()
    while running():
        next_tick += tick
        ahead = next_tick - time.monotonic()
        time.sleep(max(0.0, ahead))
        if ahead < -_CATCHES_UP:  # a real board's clock does not stand still meanwhile
            missed = int(-ahead / tick)
            board.skip(missed)
            next_tick += missed * tick
        events = dict(poller.poll(0)).get(master, 0)
        was, connected = connected, not events & select.POLLHUP
        if not connected:
            next_tick = time.monotonic()
            continue
        if not was:
            board.restart()
            pending.clear()
            allowance, next_tick = 0.0, time.monotonic()
        if events & select.POLLIN:
            _read_away(master)
        frame = board.scan()
        if not pending:  # a frame that is due while the last one still goes out is skipped
            pending += frame
        allowance = min(allowance + bytes_per_tick, len(pending))
        n = int(allowance)
        if n:
            try:
                written = os.write(master, pending[:n])
            except OSError as error:  # the reader lags, or left between poll and write
                if error.errno not in (errno.EAGAIN, errno.EIO):
                    raise
                written = n  # like a UART: what is not taken is gone
            del pending[:written]
            allowance -= written


def _read_away(master: int) -> None:
    """The board takes no commands; unread input would stop the pty."""
    try:
        os.read(master, 4096)
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EIO):
            raise
