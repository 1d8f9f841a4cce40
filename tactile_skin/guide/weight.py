# SPDX-License-Identifier: Apache-2.0
"""Weights as people write them."""

from __future__ import annotations

import re

from ..physics.curve import GRAM

_WEIGHT = re.compile(r"\s*([0-9]*[.,]?[0-9]+)\s*(g|kg|N)\s*$")
_UNIT = {"g": GRAM, "kg": 1000.0 * GRAM, "N": 1.0}


def newtons(text: str) -> float | None:
    """ "500 g", "1,2 kg", "5 N" -> N; None: it is no weight above 0, or has no unit."""
    match = _WEIGHT.match(text)
    if not match:
        return None
    value = float(match[1].replace(",", ".")) * _UNIT[match[2]]
    return value if value > 0.0 else None
