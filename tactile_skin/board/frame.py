# SPDX-License-Identifier: Apache-2.0
"""One reading of all cells, what a parser counts, and what a parameter file says of it."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

SEQUENCES = 1 << 16  # numbers that frames have in turn
NAMES = 64  # frames whose names are compared: chance does not order two names for so long


@dataclass(frozen=True, eq=False)
class Frame:
    """One reading of the whole skin."""

    # (rows, cols) uint16, ADC steps * 2**(16 - adc_bits), whatever fraction was sent
    samples: np.ndarray
    adc_bits: int  # width of the ADC
    sequence: int  # the board's number of the frame; text frames are counted on arrival
    device_time_us: int | None  # the board's clock [us]; None where it sends none
    # (rows, cols) bool, crossings that the board says it did not read, whose samples are 0; None:
    # it read all of them
    unread: np.ndarray | None = None

    def only(self, part: Callable[[np.ndarray], np.ndarray]) -> Frame:
        """Return what `part` takes of pictures (rows, cols): `middleware.config.Part.of`."""
        unread = None if self.unread is None else part(self.unread)
        return replace(self, samples=part(self.samples), unread=unread)


@dataclass
class Counters:
    """What a parser has seen."""

    frames: int = 0  # passed on
    # frames dropped for their CRC, a repeated number or a sample out of range, or lines of numbers
    # that are no frame
    corrupt: int = 0
    lost: int = 0  # frames that the sequence numbers say are missing
    restarts: int = 0  # jumps of the sequence number that only a restarted board explains
    skipped_bytes: int = 0  # bytes that belonged to no frame that counts
    # of the corrupt ones, frames with right CRCs and a sample beyond what their header says the ADC
    # can give: the board's adc_bits or fraction_bits are wrong. Of text, lines of the right length
    # with such a number.
    out_of_range: int = 0
    passed: int = 0  # lines that are no frame and do not look like one: status lines, headings
    # of these numbers, the largest one that was named [ADC steps]
    largest: float = field(default=0.0, compare=False)
    # Of text, the names of boards that print in turn, and what the last frames were named
    boards: tuple[bytes, ...] = ()
    names: deque = field(default_factory=lambda: deque(maxlen=NAMES), compare=False, repr=False)


TAIL = 16_384  # bytes that a parser keeps for whoever asks what arrives: some frames of most boards


class Parser:
    """What the parsers of all protocols share: bytes in, frames out, and the last bytes kept.

    Attributes:
        shape: (rows, cols) that its frames have; None: those that the first frame says.
        counters: what was seen.
        tail: the last bytes, for `recognise`.
        request: bytes that ask the board for a frame; empty: it sends by itself.
    """

    def __init__(self, shape: tuple[int, int] | None = None, request: str = ""):
        self.shape, self.request = shape, request.encode()
        self.counters, self.tail = Counters(), bytearray()

    @property
    def wanted(self) -> int:
        """Bytes that a frame like the last one still lacks, at least 1."""
        return 1

    def feed(self, data: bytes) -> list[Frame]:
        """Take a chunk; return the frames that it completes, oldest first."""
        self.tail += data
        if len(self.tail) > 2 * TAIL:
            del self.tail[:-TAIL]
        return self._cut(data)

    def _cut(self, data: bytes) -> list[Frame]:
        raise NotImplementedError

    def _numbered(self, steps: np.ndarray, adc_bits: int, unread=None) -> Frame:
        """Count a frame of a board that numbers none; steps: (rows * cols,) [ADC steps]."""
        samples = np.rint(steps * 2 ** (16 - adc_bits)).astype(np.uint16).reshape(self.shape)
        self.counters.frames += 1
        return Frame(samples, adc_bits, self.counters.frames % SEQUENCES, None, unread)


def about(text: str, default, *bounds):
    """Declare a field of a description of a format: what the parameter of its name is."""
    return dataclasses.field(default=default, metadata={"about": text, "bounds": bounds})
