# SPDX-License-Identifier: Apache-2.0
"""Listen to an unknown board at one baud rate after the other."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

from ..packets import PacketFormat
from ..serial_port import LONGEST_BOOT, PORT_ERRORS, why_not
from . import recognise
from .seen import Seen

BAUDS = (115_200, 1_000_000, 9_600, 500_000, 57_600, 250_000, 230_400, 921_600, 2_000_000, 38_400)
# What makes boards answer that send nothing by themselves, in the order in which they are tried.
REQUESTS = ("A", "\n", "r", "?")
_ASKED = 0.6  # s that an answer may take
_OVER = 2.5 * _ASKED  # s without a byte behind which nothing is sent by itself
_MOST = 100_000  # bytes that are enough


class Heard:
    """What arrived at one baud rate, and what it was recognised as."""

    def __init__(
        self, data: bytes, baud: int, request: str = "", shape=None, seconds=0.0, over=False
    ):
        self.data, self.baud, self.request, self.over = data, baud, request, over
        self.seen: Seen = recognise(data, shape)
        self._hexadecimal: bool | None = None  # as was said
        if over:  # a banner, perhaps
            self.seen = replace(self.seen, sure=False)
        # frames a second; 0: unknown, or only when they are asked for
        self.rate = self.seen.frames / seconds if seconds and not request else 0.0

    def fits(self, shape: tuple[int, int]) -> bool:
        """Whether it is a board of this shape; it is recognised again where that may say more.

        A reading that never changes looks like the head of a packet, and columns that are numbered
        look like rows.
        """
        if not (self.seen.sure and _is_of(self.seen, shape)):
            seen = recognise(self.data, shape, self._hexadecimal)
            if seen.protocol and _is_of(seen, shape):
                self.seen = seen
        return _is_of(self.seen, shape)

    def read_as(self, hexadecimal: bool) -> None:
        """Take the numbers of a text as hexadecimal ones, or as decimal ones."""
        self._hexadecimal = hexadecimal
        self.seen = recognise(self.data, None, hexadecimal)

    @property
    def settled(self) -> bool:
        """Whether no other baud rate can read like this: lines, or what a check proves."""
        checked = isinstance(self.seen.format, PacketFormat) and bool(self.seen.format.check)
        return self.seen.sure or bool(self.seen.digits) or (checked and not self.over)

    @property
    def rank(self) -> tuple:
        """The higher, the better it is understood."""
        return self.seen.sure, bool(self.seen.protocol), self.seen.text, self.seen.frames


def _is_of(seen: Seen, shape: tuple[int, int]) -> bool:
    return shape[0] * shape[1] == seen.cells and seen.shape in (None, shape)


def listen(line, bauds, seconds: float, say: Callable[[str], None], shape=None) -> Heard:
    """Return the best understood of what arrives at an open port, some seconds at each baud rate.

    A board that the opening has reset may need as long as the driver gives it. Where it was silent
    until then, or printed something else than readings, it is listened to again.

    Raises:
        ValueError: the port fails, or no byte arrives at any rate.
    """
    best: Heard | None = None
    say(f"listening for {seconds:g} s at each of {len(bauds)} baud rates, until one is sure ...")
    opened, to_do = time.monotonic(), list(bauds)
    again: list[int] = []  # rates at which it may not have begun
    try:
        while to_do:
            baud = to_do.pop(0)
            # what sends by itself sends bytes at any rate: less is enough while it is silent
            patience = seconds if best is None or best.data else _ASKED
            heard = _at(line, baud, seconds, patience, shape)
            n, seen = len(heard.data), heard.seen
            about = seen.about or "not recognised" if n else "silent"
            say(f"{baud:>8} baud ({bauds.index(baud) + 1} of {len(bauds)}): {n} bytes: {about}")
            best = heard if best is None or heard.rank > best.rank else best
            if heard.settled:
                break
            if n and not heard.over and (seen.protocol or not seen.text):  # the stream has begun
                to_do, again = again + to_do, []
            elif time.monotonic() - opened < LONGEST_BOOT:
                again.append(baud)
            if not to_do:
                to_do, again = again, []
    except PORT_ERRORS as error:
        raise ValueError(why_not(line.port, error)) from error
    if best is None or not best.data:
        raise ValueError(
            f"port {line.port}: no byte arrives at {', '.join(map(str, bauds))} baud, nor an "
            f"answer to {', '.join(map(repr, REQUESTS))}: is the board supplied, does its sketch "
            "print?"
        )
    return best


def _at(line, baud: int, seconds: float, patience: float, shape) -> Heard:
    """Return what arrives at one rate by itself, or else as answers to a request."""
    line.baudrate = baud
    line.reset_input_buffer()
    data, lasted, quiet = _read(line, seconds, patience)
    for request in () if data else REQUESTS:
        line.write(request.encode())
        if not _read(line, _ASKED)[0]:
            continue
        data, lasted, quiet = _read(line, seconds, _OVER, _OVER)
        if quiet < _OVER:  # it goes on without being asked
            break
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            line.write(request.encode())
            data += _read(line, 0.5 * _ASKED)[0]
        return Heard(data, baud, request, shape)
    return Heard(data, baud, "", shape, lasted, over=quiet >= _OVER)


def _read(line, seconds: float, patience: float = 0.0, pause: float = math.inf):
    """Return what arrives, the time from its first to its last byte, and since then [s].

    Args:
        patience: in which the first byte must arrive; 0: in all of them.
        pause: how long no byte may arrive behind others.
    """
    data, now = b"", time.monotonic()
    first = last = begin = now
    while len(data) < _MOST:
        if now >= begin + (seconds if data else patience or seconds) or now >= last + pause:
            break
        new = line.read(max(1, line.in_waiting))
        now = time.monotonic()
        if new:
            first, last = first if data else now, now
        data += new
    return data, last - first, now - last
