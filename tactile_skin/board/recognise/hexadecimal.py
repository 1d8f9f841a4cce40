# SPDX-License-Identifier: Apache-2.0
"""Whether the numbers of a text are hexadecimal."""

from __future__ import annotations

import re

from ..text import HEX
from .columns import FEW, STEADY


def with_letters(lines: list[bytes]) -> bool:
    """Whether letters stand in numbers, in more than one line and place: no class, no damage."""
    where = set()
    for n, line in enumerate(lines):
        words = enumerate(re.split(rb"[\s,;\[\](){}<>]+", line))
        numbers = [(k, word) for k, word in words if HEX.fullmatch(word)]
        if len(numbers) >= FEW:
            where |= {(n, k) for k, word in numbers if not word.isdigit()}
    return all(len(set(places)) >= 2 for places in zip(*where, strict=True)) and len(where) >= FEW


def may_be_hexadecimal(words: list[bytes]) -> int:
    """Return the digits of numbers that are all as wide; 0: they are decimal.

    Decimal are numbers on both sides of a ten, between which letters would stand, and those of so
    many tens that chance spares no letter: (5/8)^n.
    """
    width = len(words[0]) if all(map(bytes.isdigit, words)) else 0
    if width < 2 or any(len(word) != width for word in words):
        return 0
    numbers = {int(word) for word in words}
    next_ten = any(n % 10 == 9 and n + 1 in numbers for n in numbers)
    spared = (5 / 8) ** len({n // 10 for n in numbers})
    return 0 if next_ten or spared < 1.0 - STEADY else width
