# SPDX-License-Identifier: Apache-2.0
"""Binary frames of another make -> frames, as a description says: head, words, check, tail.

All packets of a board have one size, once nothing is escaped in them. Without a check and a tail a
packet counts only once the head of the next one stands behind it: no packet that lost or gained
bytes passes.
"""

from __future__ import annotations

import binascii
import dataclasses
import re
from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from .frame import Frame, Parser, about
from .protocol import crc16

# name -> bits of a reading, one behind the other: be, from its highest bit; le, from its lowest
WORDS = {
    **{"u8": 8, "u16le": 16, "u16be": 16, "u24le": 24, "u24be": 24},
    **{"u12be": 12, "u12le": 12, "u10be": 10, "u10le": 10},
}


def bytes_of(word: str, cells: int) -> int:
    """Return how many bytes so many readings take."""
    return -(-WORDS[word] * cells // 8)


def readings_of(data: np.ndarray, word: str) -> np.ndarray:
    """Return (..., n) readings in (..., bytes) uint8."""
    bits, order = WORDS[word], "little" if word.endswith("le") else "big"
    n = data.shape[-1] * 8 // bits
    ones = np.unpackbits(data, axis=-1, bitorder=order)[..., : n * bits]  # type: ignore[call-overload]
    powers = 2.0 ** np.arange(bits)
    return ones.reshape(*data.shape[:-1], n, bits) @ (powers if order == "little" else powers[::-1])


def _xor(data: bytes) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8))) if data else 0


def _sum(data: bytes) -> int:
    return int(np.frombuffer(data, np.uint8).sum(dtype=np.uint64))


def _fletcher(data: bytes) -> int:
    each = np.frombuffer(data, np.uint8).astype(np.uint64)
    return int(each.sum() % 255 + (each * np.arange(len(each), 0, -1)).sum() % 255 * 256)


def _table(polynomial: int, reflected: bool) -> list[int]:
    """Return what a CRC makes of each byte, its polynomial of 8 bits or reflected."""
    table = list(range(256))
    for _ in range(8):
        if reflected:
            table = [c >> 1 ^ polynomial * (c & 1) for c in table]
        else:
            table = [(c << 1 ^ polynomial * (c >> 7)) & 255 for c in table]
    return table


_CRC8, _MODBUS = _table(0x07, False), _table(0xA001, True)


def _crc(table: list[int], crc: int, data: bytes) -> int:
    for byte in data:
        crc = table[(crc ^ byte) & 255] ^ crc >> 8
    return crc


# name -> (bytes, their order, what they are of the bytes before them)
CHECKS: dict[str, tuple[int, Literal["little", "big"], Callable[[bytes], int]]] = {
    "sum8": (1, "little", _sum),
    "xor8": (1, "little", _xor),
    "crc8": (1, "little", partial(_crc, _CRC8, 0)),
    "sum16le": (2, "little", _sum),
    "sum16be": (2, "big", _sum),
    "crc16le": (2, "little", crc16),
    "crc16be": (2, "big", crc16),
    "modbus": (2, "little", partial(_crc, _MODBUS, 0xFFFF)),
    "fletcher16le": (2, "little", _fletcher),
    "fletcher16be": (2, "big", _fletcher),
    "crc32le": (4, "little", binascii.crc32),
    "crc32be": (4, "big", binascii.crc32),
}


def _slip(data: bytes) -> bytes:
    first, *others = data.split(b"\xdb")
    if not all(part[:1] in (b"\xdc", b"\xdd") for part in others):
        return b""
    return first + b"".join(b"\xc0\xdb"[part[0] - 0xDC :][:1] + part[1:] for part in others)


def _cobs(data: bytes) -> bytes:
    found, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        if at + code > len(data):
            return b""
        found += data[at + 1 : at + code]
        at += code
        found += b"\0" * (code < 255 and at < len(data))
    return bytes(found)


# name -> (the byte that stands between packets alone, what undoes this; empty: it was not so)
ESCAPES: dict[str, tuple[bytes, Callable[[bytes], bytes]]] = {
    "slip": (b"\xc0", _slip),
    "cobs": (b"\0", _cobs),
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
            unknown word, check or escape.
    """

    head: str = about("bytes that begin a packet, in hexadecimal; ?? is any byte", "")
    word: str = about(f"of a reading: {', '.join(WORDS)}", "u16le")
    check: str = about(f"behind the readings: {', '.join(CHECKS)}; empty: none", "")
    unchecked: int = about("bytes at the begin that the check leaves out", 0, 0, 64)
    tail: str = about("bytes that end a packet, as head", "")
    escape: str = about(
        f"how bytes are that stand between packets alone, the first of head: {', '.join(ESCAPES)}; "
        "empty: none do",
        "",
    )
    full_scale: float = about(
        "the reading of an input at the supply; 0: 2^adc_bits - 1", 0.0, 0.0, 2e7
    )
    request: str = about("what asks the board for a frame; empty: it sends by itself", "")

    def __post_init__(self):
        _pattern("head", self.head), _pattern("tail", self.tail)
        if not self.head.split() or self.head.split()[0] == "??":
            raise ValueError(f"format.head = {self.head!r}: must begin with a byte such as FF")
        names = {"word": (*WORDS,), "check": ("", *CHECKS), "escape": ("", *ESCAPES)}
        for name, allowed in names.items():
            if getattr(self, name) not in allowed:
                raise ValueError(
                    f"format.{name} = {getattr(self, name)!r}: must be one of "
                    f"{', '.join(filter(None, allowed))}"
                )
        if self.escape and self.head[:2].upper() != (mark := ESCAPES[self.escape][0].hex().upper()):
            raise ValueError(
                f"format.head = {self.head!r}: must begin with {mark}, by format.escape"
            )


class PacketParser(Parser):
    """Packets of one size; a reading beyond the ADC's range makes its packet a damaged one."""

    def __init__(self, rows: int, cols: int, adc_bits: int, fmt: PacketFormat):
        super().__init__((rows, cols), fmt.request)
        self.adc_bits, self.format = adc_bits, fmt
        head, tail = fmt.head.split(), fmt.tail.split()
        self._head, self._tail = _pattern("head", fmt.head), _pattern("tail", fmt.tail)
        self._head_size = len(head)
        self._check_size = CHECKS[fmt.check][0] if fmt.check else 0
        self._check_at = len(head) + bytes_of(fmt.word, rows * cols)
        self.size = self._check_at + self._check_size + len(tail)
        sure = fmt.check or set(tail) - {"??"}
        self._confirm = 0 if sure else len(head)  # bytes of the next packet that are waited for
        self._begin, self._cells = self._head, rows * cols
        self._mark, self._plain = ESCAPES.get(fmt.escape, (b"", _slip))
        if self._mark:
            self._begin, self._confirm = re.compile(re.escape(self._mark)), 1
        self._buffer = bytearray()
        self._aligned = False  # the buffer begins right behind a sound packet

    @property
    def wanted(self) -> int:
        return max(1, self.size + self._confirm - len(self._buffer))

    def _cut(self, data: bytes) -> list[Frame]:
        self._buffer += data
        frames: list[Frame] = []
        while True:
            head = self._begin.search(self._buffer)
            # without one, the last bytes may be the first of a head
            start = head.start() if head else max(0, len(self._buffer) - self._head_size + 1)
            if start:
                self._skip(start)
            if len(self._buffer) < self.size + self._confirm:
                return frames
            packet, size = bytes(self._buffer[: self.size]), self.size
            if self._mark and not (self._whole(packet) and self._buffer[size] == self._mark[0]):
                size = self._buffer.find(self._mark, 1)
                if size < 0 and len(self._buffer) <= 2 * self.size:  # all of it escaped, at most
                    return frames
                packet = self._mark + self._plain(bytes(self._buffer[1 : max(size, 1)]))
            if not self._whole(packet):
                if size == 1:  # two marks between packets
                    del self._buffer[:1]
                else:
                    self._skip(1)
                continue
            del self._buffer[:size]
            self._aligned = True
            frames += self._frame(packet)

    def _skip(self, n: int) -> None:
        self.counters.corrupt += self._aligned
        self._aligned = False
        del self._buffer[:n]
        self.counters.skipped_bytes += n

    def _whole(self, packet: bytes) -> bool:
        """Whether the size, head, tail and check of a packet are right."""
        tail = self._check_at + self._check_size
        if not (self._head.match(packet) and self._tail.fullmatch(packet, tail)):
            return False
        if len(packet) != self.size:
            return False
        if self.format.check:
            body = packet[self.format.unchecked : self._check_at]
            if packet[self._check_at : tail] != check_of(self.format.check, body):
                return False
        sure = self._mark or not self._confirm
        return bool(sure or self._head.match(self._buffer, self.size))

    def _frame(self, packet: bytes) -> list[Frame]:
        top = 2**self.adc_bits - 1
        inner = np.frombuffer(packet[self._head_size : self._check_at], np.uint8)
        steps = readings_of(inner, self.format.word)[: self._cells]
        largest = float(steps.max())
        if self.format.full_scale:
            steps = np.minimum(steps * (top / self.format.full_scale), top)
        if largest > (self.format.full_scale or top):
            self.counters.corrupt += 1
            self.counters.out_of_range += 1
            self.counters.largest = max(largest, self.counters.largest)
            return []
        return [self._numbered(steps, self.adc_bits)]
