# SPDX-License-Identifier: Apache-2.0
"""Bytes of the board <-> frames. The parsers take any chunk and never pass on a damaged frame.

Binary frame, little-endian:

    offset  size  field
    0       2     magic, 0xA5 0x5A
    2       1     version, 1
    3       1     rows
    4       1     cols
    5       1     adc_bits, width of the ADC
    6       1     fraction_bits, what the board's low-pass adds below one ADC step
    7       2     sequence number, wraps
    9       4     device time [us], wraps
    13      2     CRC of bytes 0 to 12: a damaged size must not make the parser wait
    15      2*n   samples, row by row, in ADC steps * 2**fraction_bits: below
                  2**(adc_bits + fraction_bits), or the frame counts as damaged
    15+2*n  2     CRC of all bytes before it

Both CRCs are CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF): `binascii.crc_hqx` here,
`_crc_xmodem_update` in avr-libc. The second finds any burst of 16 wrong bits, and any
3 in a frame of up to 4 kB; of those damaged further behind a whole header one in 65,536 passes
(tests/test_fuzz.py).
"""

from __future__ import annotations

import binascii
import struct

import numpy as np

from .frame import SEQUENCES, Frame, Parser

MAGIC = b"\xa5\x5a"
VERSION = 1
MAX_LINES = 64  # rows or columns: bounds the buffer
_HEADER = struct.Struct("<2sBBBBBHI")
_CRC = struct.Struct("<H")
_HEADER_SIZE = _HEADER.size + _CRC.size
_SAMPLES = 1 << 16  # values that a sample's two bytes can hold
_RESTART_GAP = 1000  # a larger jump of the sequence number is a board that restarted


def crc16(data) -> int:
    """CRC-16/CCITT-FALSE."""
    return binascii.crc_hqx(data, 0xFFFF)


def encode(sequence: int, device_time_us: int, samples, adc_bits: int, fraction_bits: int) -> bytes:
    """Return a binary frame; samples: (rows, cols) in ADC steps * 2**fraction_bits.

    Raises:
        ValueError: a sample that its 16 bits cannot hold; cut off it would be another reading.
    """
    rows, cols = samples.shape
    if not ((samples >= 0) & (samples < _SAMPLES)).all():
        raise ValueError(f"samples must be from 0 to {_SAMPLES - 1}")
    body = bytearray(
        _HEADER.pack(
            MAGIC,
            VERSION,
            rows,
            cols,
            adc_bits,
            fraction_bits,
            sequence % SEQUENCES,
            device_time_us % 2**32,
        )
    )
    body += _CRC.pack(crc16(body))
    body += np.ascontiguousarray(samples, "<u2").tobytes()
    return bytes(body + _CRC.pack(crc16(body)))


class BinaryParser(Parser):
    """Frames from a byte stream cut anywhere; finds the next frame after any damage.

    It is for one board: once a frame has arrived, a header of another size or width is damage. It
    would keep the parser waiting for up to 8 kB that never come, and the frames behind it as well.
    """

    def __init__(self):
        super().__init__()
        self._buffer = bytearray()
        self._last_sequence: int | None = None
        self._at_boundary = False  # the buffer starts right behind a good frame
        self._length = 1  # of the last frame [bytes]
        self.layout: tuple[int, ...] | None = None  # its rows, cols, adc_bits, fraction_bits

    @property
    def wanted(self) -> int:
        return max(1, self._length - len(self._buffer))

    def _cut(self, data: bytes) -> list[Frame]:
        self._buffer += data
        frames: list[Frame] = []
        while True:
            self._skip_to_magic()
            if len(self._buffer) < _HEADER_SIZE:
                return frames
            header = self._header()
            if header is None:
                # Behind a good frame this was a frame; elsewhere the magic may be payload.
                self.counters.corrupt += self._at_boundary
                self._skip(1)
                continue
            rows, cols, adc_bits, fraction_bits, sequence, device_time = header
            size = _HEADER_SIZE + 2 * rows * cols
            if len(self._buffer) < size + _CRC.size:
                return frames
            body = memoryview(self._buffer)[:size]
            good = crc16(body) == _CRC.unpack_from(self._buffer, size)[0]
            samples = np.frombuffer(bytes(body[_HEADER_SIZE:]), "<u2").reshape(rows, cols)
            body.release()
            if not good:
                self.counters.corrupt += 1
                self._skip(1)
                continue
            shift = 16 - adc_bits - fraction_bits
            if shift and samples.max() >= _SAMPLES >> shift:  # shifted, it would read as another
                self.counters.corrupt += 1
                self.counters.out_of_range += 1
                self._skip(size + _CRC.size)
                self._at_boundary = True
                continue
            del self._buffer[: size + _CRC.size]
            self._at_boundary = True
            self._length = size + _CRC.size
            self.layout = rows, cols, adc_bits, fraction_bits
            if not self._count(sequence):
                continue
            samples = samples << shift if shift else samples
            frames.append(Frame(samples, adc_bits, sequence, device_time))

    def _header(self):
        """Return the header's fields after the version; None: damaged, or another layout."""
        crc = _CRC.unpack_from(self._buffer, _HEADER.size)[0]
        if crc16(bytes(self._buffer[: _HEADER.size])) != crc:
            return None
        _, version, rows, cols, adc_bits, fraction_bits, *rest = _HEADER.unpack_from(self._buffer)
        sizes = 1 <= rows <= MAX_LINES and 1 <= cols <= MAX_LINES
        if version != VERSION or not sizes or adc_bits < 1 or adc_bits + fraction_bits > 16:
            return None
        if self.layout not in (None, (rows, cols, adc_bits, fraction_bits)):
            return None
        return rows, cols, adc_bits, fraction_bits, *rest

    def _skip_to_magic(self) -> None:
        start = self._buffer.find(MAGIC)
        if start < 0:  # the last byte may be the first half of a magic
            start = len(self._buffer) - self._buffer.endswith(MAGIC[:1])
        if start > 0:
            self._skip(start)

    def _skip(self, n: int) -> None:
        del self._buffer[:n]
        self.counters.skipped_bytes += n
        self._at_boundary = False

    def _count(self, sequence: int) -> bool:
        """Whether the frame is a new one: a board that repeats itself is frozen."""
        if sequence == self._last_sequence:
            self.counters.corrupt += 1
            return False
        self.counters.frames += 1
        if self._last_sequence is not None:
            gap = (sequence - self._last_sequence - 1) % SEQUENCES
            if gap > _RESTART_GAP:
                self.counters.restarts += 1
            else:
                self.counters.lost += gap
        self._last_sequence = sequence
        return True
