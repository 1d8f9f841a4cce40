# SPDX-License-Identifier: Apache-2.0
"""How a fabric conducts more and more under a load that stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Floats

# Velostat under a force sensor gains 0.16 to 0.46 a decade (docs/calibrate.md), an FSR 0 to 0.05
MAX_SHARE = 0.5
LEAST_TIME = 0.03  # s, of the same: a frame or two of a slow board


@dataclass(frozen=True)
class Creep:
    """A load has added 1 + share * log10(1 + t / time) times what it added as it came.

    Attributes:
        share: of the conductance, a decade of time; 0: a load gains nothing.
        time: after which it begins to count [s].
        std: one standard deviation of the share, where it was measured.
    """

    share: float = 0.0
    time: float = 1.0
    std: float = 0.0

    def gain(self, t: float | Floats) -> Floats:
        """Return times what a load adds as it comes that it adds after t [s]."""
        return 1.0 + self.share * np.log10(1.0 + np.asarray(t) / self.time)


NO_CREEP = Creep()
