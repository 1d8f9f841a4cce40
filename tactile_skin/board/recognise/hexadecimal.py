# SPDX-License-Identifier: Apache-2.0
"""Whether the numbers of a text are hexadecimal."""

from __future__ import annotations

import re

from ..text import HEX
from .columns import FEW

_FEW_TENS = 6  # of n of them, with a share of (5/8)^n no last digit is a letter by chance


def with_letters(lines: list[bytes]) -> bool:
    """Whether letters stand in numbers, in more than one line and place: no class, no damage."""
    where = set()
    for n, line in enumerate(lines):
        words = [word.strip(b"[](){}<>\r ") for word in re.split(rb"[\s,;]+", line)]
        numbers = [(k, word) for k, word in enumerate(words) if HEX.fullmatch(word)]
        if len(numbers) >= FEW:
            where |= {(n, k) for k, word in numbers if not word.isdigit()}
    return all(len(set(places)) >= 2 for places in zip(*where, strict=True)) and len(where) >= FEW


def may_be_hexadecimal(words: list[bytes]) -> int:
    """Return the digits of numbers that are all as wide, and of few tens; 0: they are decimal.

    From 9 to 0 of the next ten no number is left out, as the letters would be.
    """
    widths = {len(word) for word in words if word.isdigit()} if all(words) else set()
    numbers = {int(word) for word in words if word.isdigit()}
    next_ten = any(n % 10 == 9 and n + 1 in numbers for n in numbers)
    if len(widths) != 1 or next_ten or len({n // 10 for n in numbers}) > _FEW_TENS:
        return 0
    return max(widths) if max(widths) > 1 else 0
