"""One reading of the whole skin, and what a parser counts, whatever the protocol."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Frame:
    """One reading of the whole skin.

    Attributes:
        samples: (rows, cols) uint16, ADC steps * 2**(16 - adc_bits), whatever fraction was sent.
        adc_bits: width of the ADC.
        sequence: the board's number of the frame; text frames are counted on arrival.
        device_time_us: the board's clock [us]; None where it sends none.
        unread: (rows, cols) bool, crossings that the board says it did not read, whose samples are
            0; None: it read all of them.
    """

    samples: np.ndarray
    adc_bits: int
    sequence: int
    device_time_us: int | None
    unread: np.ndarray | None = None


@dataclass
class Counters:
    """What a parser has seen.

    Attributes:
        frames: passed on.
        corrupt: frames dropped for their CRC, a repeated number or a sample out of range, or lines
            that are no frame.
        lost: frames that the sequence numbers say are missing.
        restarts: jumps of the sequence number that only a restarted board explains.
        skipped_bytes: bytes that belonged to no frame that counts.
        out_of_range: of the corrupt ones, frames with right CRCs and a sample beyond what their
            header says the ADC can give: the board's adc_bits or fraction_bits are wrong. Of text,
            lines of the right length with such a number.
        largest: of these numbers, the largest one that was named [ADC steps].
    """

    frames: int = 0
    corrupt: int = 0
    lost: int = 0
    restarts: int = 0
    skipped_bytes: int = 0
    out_of_range: int = 0
    largest: float = field(default=0.0, compare=False)
