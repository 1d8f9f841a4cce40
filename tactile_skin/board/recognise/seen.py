# SPDX-License-Identifier: Apache-2.0
"""What a sample of a board's bytes was recognised as, and the sample in one line."""

from __future__ import annotations

from dataclasses import dataclass

from ..formats import Format

_SHOWN = 60  # characters of a sample in a message


@dataclass(frozen=True)
class Seen:
    """What a sample of a board's bytes is."""

    protocol: str  # of formats.PROTOCOLS, where a description reads the sample; empty: none does
    about: str  # what was seen, in words
    sample: bytes  # the bytes of some frames
    format: Format = None  # the description that reads it
    shape: tuple[int, int] | None = None  # (rows, cols) where the bytes say it
    cells: int = 0  # readings of a frame; 0: unknown
    frames: int = 0  # that the description reads in the sample
    sure: bool = False  # whether nothing else that is known here reads like this
    # largest, step: of the readings: the largest number, and the least difference of two
    largest: float = 0.0
    step: float = 1.0
    at_largest: int = 0  # readings that are this number
    digits: int = 0  # of each number, where only whether it is hexadecimal is not sure
    decimals: bool = False  # whether a decimal point is printed
    adc_bits: int = 0  # width of the ADC, where the bytes say it
    text: bool = False  # whether the bytes are text


def shown(sample: bytes, text: bool, most: int = _SHOWN) -> str:
    """Return a sample in one line, with what cannot be printed escaped."""
    cut = sample[:most]
    line = (
        cut.decode("ascii", "backslashreplace").encode("unicode_escape").decode()
        if text
        else (cut[: most // 3].hex(" ").upper())
    )
    return line[:most] + ("..." if len(line) > most or len(sample) > len(cut) else "")
