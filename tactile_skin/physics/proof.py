# SPDX-License-Identifier: Apache-2.0
"""What showed that a skin's newtons are right, and by how much they may be off since."""

from __future__ import annotations

import datetime
from dataclasses import dataclass

import numpy as np

NOTHING = "none"  # has proved the scale: circuit and curve are as somebody entered them
WEIGHT = "weight"  # a known weight or force on the skin, by calibrate
RESISTOR = "resistor"  # a known resistor in place of a cell, and the fabric's own data sheet
SIMULATED = "simulated"  # the board is simulated with the same curve
PROOFS = NOTHING, WEIGHT, RESISTOR
NOT_PROVED = "not proved: stops early, lay a known weight"  # what is said of such a skin

# The most that a force may be over what is felt while nothing proved it: the shipped curve on
# another fabric (19 to 142 % of error over seven public data sets).
UNPROVED = 2.5
# Standard deviations of the scale that its bound covers: one force in six is above it. With 1.64,
# one in twenty, a skin whose gain days raise by 30 % stops at half of the limit (chosen with
# benchmarks.fabric.living).
CONFIDENCE = 1.0
# Relative standard deviation that days add to a proof, and days after which it is there to 63 %:
# force-sensing resistors and Velostat gain or lose 15 to 30 % in three days.
_OF_DAYS = 0.15
_DAYS = 3.0
MOST = 1.3  # times what is felt that a proved force counts at most


@dataclass(frozen=True)
class Proof:
    """The evidence for a skin's newtons.

    Attributes:
        by: one of `PROOFS`, or SIMULATED.
        error: relative standard deviation of a contact force when it was proved.
        date: the day; None: not said, then days count in full.
    """

    by: str = NOTHING
    error: float = 0.1
    date: datetime.date | None = None

    @property
    def proved(self) -> bool:
        """Whether anything absolute was seen."""
        return self.by != NOTHING

    def factor(self, today: datetime.date) -> float:
        """Return times what is felt that a force is at most, at `CONFIDENCE`."""
        if self.by == SIMULATED:
            return 1.0
        if self.by == NOTHING:
            return UNPROVED
        days = np.inf if self.date is None else max((today - self.date).days, 0)
        error = np.hypot(self.error, _OF_DAYS * -np.expm1(-days / _DAYS))
        return float(min(1.0 + CONFIDENCE * error, MOST))
