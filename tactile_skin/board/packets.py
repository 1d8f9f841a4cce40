# SPDX-License-Identifier: Apache-2.0
"""Binary frames of another make -> frames, as a description says: head, words, check, tail.

All packets of a board have one size. Without a check and a tail a packet counts only once the head
of the next one stands behind it: no packet that lost or gained bytes passes.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import Literal

import numpy as np

from .frame import Frame, Parser, about
from .protocol import crc16

WORDS = {"u8": "u1", "u16le": "<u2", "u16be": ">u2"}


def _xor(data: bytes) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8))) if data else 0


def _sum(data: bytes) -> int:
    return int(np.frombuffer(data, np.uint8).sum(dtype=np.uint64))


# name -> (bytes, their order, what they are of the bytes before them)
CHECKS: dict[str, tuple[int, Literal["little", "big"], Callable[[bytes], int]]] = {
    "sum8": (1, "little", _sum),
    "xor8": (1, "little", _xor),
    "sum16le": (2, "little", _sum),
    "sum16be": (2, "big", _sum),
    "crc16le": (2, "little", crc16),
    "crc16be": (2, "big", crc16),
}


def check_of(name: str, data: bytes) -> bytes:
    """Return the bytes of a check of CHECKS over `data`."""
    size, order, function = CHECKS[name]
    return (function(data) % (1 << 8 * size)).to_bytes(size, order)


def _pattern(name: str, text: str) -> re.Pattern[bytes]:
    """Return what the bytes of a pattern such as "FF ??" match."""
    words = text.split()
    if not all(re.fullmatch("[0-9A-Fa-f]{2}|[?]{2}", word) for word in words):
        raise ValueError(f"format.{name} = {text!r}: must be bytes such as FF 0A ??")
    each = [b"." if word == "??" else re.escape(bytes.fromhex(word)) for word in words]
    return re.compile(b"".join(each), re.DOTALL)


@dataclasses.dataclass(frozen=True)
class PacketFormat:
    """How the packets of a board are built, from the first byte to the last.

    Raises:
        ValueError: a pattern that is none, a head that does not begin with a byte of its own, an
            unknown word or check.
    """

    head: str = about("bytes that begin a packet, in hexadecimal; ?? is any byte", "")
    word: str = about(f"of a reading: {', '.join(WORDS)}", "u16le")
    check: str = about(f"behind the readings: {', '.join(CHECKS)}; empty: none", "")
    unchecked: int = about("bytes at the begin that the check leaves out", 0, 0, 64)
    tail: str = about("bytes that end a packet, as head", "")
    full_scale: float = about(
        "the reading of an input at the supply; 0: 2^adc_bits - 1", 0.0, 0.0, 1e6
    )
    request: str = about("what asks the board for a frame; empty: it sends by itself", "")

    def __post_init__(self):
        _pattern("head", self.head), _pattern("tail", self.tail)
        if not self.head.split() or self.head.split()[0] == "??":
            raise ValueError(f"format.head = {self.head!r}: must begin with a byte such as FF")
        for name, allowed in (("word", WORDS), ("check", ("", *CHECKS))):
            if getattr(self, name) not in allowed:
                raise ValueError(
                    f"format.{name} = {getattr(self, name)!r}: must be one of "
                    f"{', '.join(filter(None, allowed))}"
                )


class PacketParser(Parser):
    """Packets of one size; a reading beyond the ADC's range makes its packet a damaged one."""

    def __init__(self, rows: int, cols: int, adc_bits: int, fmt: PacketFormat):
        super().__init__((rows, cols), fmt.request)
        self.adc_bits, self.format = adc_bits, fmt
        head, tail = fmt.head.split(), fmt.tail.split()
        self._head, self._tail = _pattern("head", fmt.head), _pattern("tail", fmt.tail)
        self._head_size = len(head)
        self._word = np.dtype(WORDS[fmt.word])
        self._check_size = CHECKS[fmt.check][0] if fmt.check else 0
        self._check_at = len(head) + rows * cols * self._word.itemsize
        self.size = self._check_at + self._check_size + len(tail)
        sure = fmt.check or set(tail) - {"??"}
        self._confirm = 0 if sure else len(head)  # bytes of the next packet that are waited for
        self._buffer = bytearray()
        self._aligned = False  # the buffer begins right behind a sound packet

    @property
    def wanted(self) -> int:
        return max(1, self.size + self._confirm - len(self._buffer))

    def _cut(self, data: bytes) -> list[Frame]:
        self._buffer += data
        frames: list[Frame] = []
        while True:
            head = self._head.search(self._buffer)
            # without one, the last bytes may be the first of a head
            start = head.start() if head else max(0, len(self._buffer) - self._head_size + 1)
            if start:
                self._skip(start)
            if len(self._buffer) < self.size + self._confirm:
                return frames
            packet = bytes(self._buffer[: self.size])
            if not self._whole(packet):
                self._skip(1)
                continue
            del self._buffer[: self.size]
            self._aligned = True
            frames += self._frame(packet)

    def _skip(self, n: int) -> None:
        self.counters.corrupt += self._aligned
        self._aligned = False
        del self._buffer[:n]
        self.counters.skipped_bytes += n

    def _whole(self, packet: bytes) -> bool:
        """Whether tail and check of a packet that begins with a head are right."""
        tail = self._check_at + self._check_size
        if not self._tail.fullmatch(packet, tail):
            return False
        if self.format.check:
            body = packet[self.format.unchecked : self._check_at]
            if packet[self._check_at : tail] != check_of(self.format.check, body):
                return False
        return not self._confirm or bool(self._head.match(self._buffer, self.size))

    def _frame(self, packet: bytes) -> list[Frame]:
        top = 2**self.adc_bits - 1
        steps = np.frombuffer(packet[self._head_size : self._check_at], self._word).astype(float)
        largest = float(steps.max())
        if self.format.full_scale:
            steps = np.minimum(steps * (top / self.format.full_scale), top)
        if largest > (self.format.full_scale or top):
            self.counters.corrupt += 1
            self.counters.out_of_range += 1
            self.counters.largest = max(largest, self.counters.largest)
            return []
        return [self._numbered(steps, self.adc_bits)]
