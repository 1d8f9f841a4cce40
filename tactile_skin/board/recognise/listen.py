# SPDX-License-Identifier: Apache-2.0
"""Listen to an unknown board at one baud rate after the other."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

from ..serial_port import PORT_ERRORS, why_not
from . import recognise
from .seen import Seen

BAUDS = (115_200, 1_000_000, 9_600, 500_000, 57_600, 250_000, 230_400, 921_600, 2_000_000, 38_400)
# What makes boards answer that send nothing by themselves, in the order in which they are tried.
REQUESTS = ("A", "\n", "r", "?")
_ASKED = 1.0  # s that an answer may take
_MOST = 100_000  # bytes that are enough


class Heard:
    """What arrived at one baud rate, and what it was recognised as."""

    def __init__(self, data: bytes, baud: int, request: str = "", shape=None, seconds=0.0):
        self.data, self.baud, self.request = data, baud, request
        self.seen: Seen = recognise(data, shape)
        # frames a second; 0: unknown, or only when they are asked for
        self.rate = self.seen.frames / seconds if seconds and not request else 0.0

    def fits(self, shape: tuple[int, int]) -> bool:
        """Whether it is a board of this shape; it is recognised again where that may say more.

        A reading that never changes looks like the head of a packet, and columns that are numbered
        look like rows.
        """
        if not (self.seen.sure and _is_of(self.seen, shape)):
            seen = recognise(self.data, shape)
            if seen.protocol and _is_of(seen, shape):
                self.seen = seen
        return _is_of(self.seen, shape)

    @property
    def rank(self) -> tuple:
        """The higher, the better it is understood."""
        return self.seen.sure, bool(self.seen.protocol), self.seen.text, self.seen.frames


def _is_of(seen: Seen, shape: tuple[int, int]) -> bool:
    return shape[0] * shape[1] == seen.cells and seen.shape in (None, shape)


def listen(line, bauds, seconds: float, say: Callable[[str], None], shape=None) -> Heard:
    """Return the best understood of what arrives at an open port, some seconds at each baud rate.

    Raises:
        ValueError: the port fails, or no byte arrives at any rate.
    """
    best: Heard | None = None
    say(f"listening for {seconds:g} s at each of {len(bauds)} baud rates, until one is sure ...")
    try:
        for k, heard in enumerate(_at_each(line, bauds, seconds, shape), 1):
            n, seen = len(heard.data), heard.seen
            about = seen.about or "not recognised" if n else "silent"
            say(f"{heard.baud:>8} baud ({k} of {len(bauds)}): {n} bytes: {about}")
            best = heard if best is None or heard.rank > best.rank else best
            if seen.sure:
                break
    except PORT_ERRORS as error:
        raise ValueError(why_not(line.port, error)) from error
    if best is None or not best.data:
        raise ValueError(
            f"port {line.port}: no byte arrives at {', '.join(map(str, bauds))} baud, nor an "
            f"answer to {', '.join(map(repr, REQUESTS))}: is the board supplied, does its sketch "
            "print?"
        )
    return best


def _at_each(line, bauds, seconds: float, shape) -> Iterator[Heard]:
    patience = math.inf
    for baud in bauds:
        line.baudrate = baud
        line.reset_input_buffer()
        (data, lasted), request = _read(line, seconds, patience), ""
        if not data:  # what sends by itself sends bytes at any rate: less is enough at the others
            patience = _ASKED
        for asked in () if data else REQUESTS:
            line.write(asked.encode())
            if data := _read(line, _ASKED)[0]:
                request, until = asked, time.monotonic() + seconds
                while time.monotonic() < until:
                    line.write(asked.encode())
                    data += _read(line, 0.25 * _ASKED)[0]
                break
        yield Heard(data, baud, request, shape, lasted)


def _read(line, seconds: float, patience: float = math.inf) -> tuple[bytes, float]:
    """Return what arrives, and the time from its first to its last byte [s]."""
    data, now = b"", time.monotonic()
    first = last = begin = now
    while now < begin + (seconds if data else min(seconds, patience)) and len(data) < _MOST:
        new = line.read(max(1, line.in_waiting))
        now = time.monotonic()
        if new:
            first, last = first if data else now, now
        data += new
    return data, last - first
