# SPDX-License-Identifier: Apache-2.0
"""A stranger's board on a pseudo-terminal: any bytes at a given rate, while the port is open."""

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable


class PtyBoard:
    """Plays chunks on a serial device in a thread; use as a context manager.

    Args:
        chunks: k -> bytes of the k-th chunk, from when the port is opened.
        rate: chunks a second; 0: only answers.
        answer: what to send for bytes that arrive; None: nothing.

    Attributes:
        port: path of the device.
        received: all bytes that arrived.
    """

    def __init__(
        self,
        chunks: Callable[[int], bytes],
        rate: float,
        answer: Callable[[bytes], bytes] | None = None,
    ):
        self._chunks, self._rate, self._answer = chunks, rate, answer
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.port, self.received = os.ttyname(slave), b""
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN | select.POLLHUP)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._play, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._closing.set()
        self._thread.join()
        os.close(self._master)

    @property
    def _open(self) -> bool:
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def _read(self) -> bytes:
        try:
            return os.read(self._master, 4096)
        except OSError:  # nothing there, or the port is closed
            return b""

    def _write(self, data: bytes) -> None:
        while data and not self._closing.is_set():
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                if not self._open:
                    return
                time.sleep(0.002)

    def _play(self) -> None:
        while not self._open and not self._closing.wait(0.002):
            pass
        begun, k = time.monotonic(), 0
        while not self._closing.wait(0.002):
            data = self._read()
            self.received += data
            if data and self._answer:
                self._write(self._answer(data))
            while self._rate and k <= (time.monotonic() - begun) * self._rate:
                if self._open:
                    self._write(self._chunks(k))
                k += 1
