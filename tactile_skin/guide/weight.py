# SPDX-License-Identifier: Apache-2.0
"""Weights as people write them, and what they prove in words."""

from __future__ import annotations

import datetime
import re

import numpy as np

from ..physics.curve import GRAM
from ..physics.proof import UNPROVED, WEIGHT, Proof

_WEIGHT = re.compile(r"\s*([0-9]*[.,]?[0-9]+)\s*(g|kg|N)\s*$")
_UNIT = {"g": GRAM, "kg": 1000.0 * GRAM, "N": 1.0}


def newtons(text: str) -> float | None:
    """ "500 g", "1,2 kg", "5 N" -> N; None: it is no weight above 0, or has no unit."""
    match = _WEIGHT.match(text)
    if not match:
        return None
    value = float(match[1].replace(",", ".")) * _UNIT[match[2]]
    return value if value > 0.0 else None


def concluded(error: float, why: str, loads, today: datetime.date) -> tuple[Proof, str]:
    """Return the proof by loads (n,) [N], and what to say of it.

    Args:
        error: relative standard deviation of a force.
        why: what speaks against it; "": nothing.
    """
    if why:
        return Proof(), (
            f"  Not proved: {why}.\n  Until a weight proves it a stop counts {UNPROVED:g} times "
            "what is felt."
        )
    least, most = float(np.min(loads)), float(np.max(loads))
    span = f"{least:.3g} to {most:.3g} N" if least < most else f"{most:.3g} N"
    words = f"  Proved by {span}: a force is right to {error:.0%} (standard deviation)."
    return Proof(WEIGHT, round(error, 3), today), words
