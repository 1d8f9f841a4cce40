# SPDX-License-Identifier: Apache-2.0
"""Whether a matrix is read at all: cells of a fabric rest apart, and that picture is its own.

Where all readings are alike no matrix is read.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincinv

from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from ..solvers.reading import FEW
from .check import CALM, WINDOW, Check, Seen

_ALIKE = 3.0  # times that readings at rest are further apart than now, which makes a fault,
_STILL_ALIKE = 2.0  # and which ends it
# `Window.noise` over the noise: what changes from one of its frames to the next has twice so many
# degrees of freedom (von Neumann 1941), and `CALM` of such spreads lie below.
_FREE = (WINDOW - 1) ** 2 / (3 * WINDOW - 4)
_OF_NOISE = (gammaincinv(_FREE, CALM) / _FREE) ** 0.5


class RestPicture(Check):
    """Follows the picture of one skin, whose rest is known."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._adc = adc
        self._before: Finding | None = None  # what the last window showed

    def frame(self, seen: Seen) -> None:
        window = seen.window
        if window is None or seen.rest is None or seen.opens:
            return
        read = window.mean > 0.0
        if np.count_nonzero(read) < FEW:
            self.found = self._before = None
            return
        now, rest = window.mean[read], self._adc.rising_count(seen.rest)[read]
        noise = window.noise / _OF_NOISE / WINDOW**0.5
        found = self._look(now, rest, noise)
        # On a small skin noise may hide in one window how far readings are apart, not in two.
        again = found == self._before or _ALIKE * noise < rest.std()
        self.found, self._before = found if again else None, found

    def _look(self, now: np.ndarray, rest: np.ndarray, noise: float) -> Finding | None:
        """Return what (n,) mean readings show, whose noise is known [ADC steps]."""
        times = _STILL_ALIKE if self.found else _ALIKE
        if now.var() - noise**2 >= (rest.std() / times) ** 2:
            return None
        # what shakes all cells is no noise between them: their picture is still that at rest
        if (now - now.mean()) @ (rest - rest.mean()) / rest.size >= rest.var() / times:
            return None
        numbers = {"steps": float(now.mean())}
        return Finding(Kind.NO_SIGNAL, severity=Severity.FAULT, numbers=numbers)
