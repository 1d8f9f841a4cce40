# SPDX-License-Identifier: Apache-2.0
"""Whether the ADC converts all that there is to read: a ceiling, seen over many frames.

One frame with some equal readings proves nothing: a flat touch looks so. Over time a ceiling gives
itself away by readings that stand at the largest value ever seen, without the noise that all
others have; or, if the ceiling lies before the ADC, which adds its own noise, by readings that
stand together at one height while those beside them change: flat touches stand at heights of their
own, and the same touch once more brings the same readings beside them.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import binary_dilation

from ..calibration.identify import SHELF
from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from ..solvers.reading import ROUNDING_NOISE
from ..solvers.suspect import BEYOND
from .check import ABOVE, Check, Seen, Window

_CHANCE = 1e-5  # of a sound skin's readings standing at one height, in one window
_FORGET = 0.01  # share of the count of readings that stood still, and of all, that a window renews
_MOVES = 20.0  # times the noise by which those beside them differ when they stand there again
_BESIDE = np.ones((3, 3))  # a cell and its neighbours
_NEAR_MOST = 0.9  # of what a short circuit would read: above, all hard touches read alike


class Ceiling(Check):
    """Readings that stand still at the largest value: a saturated input.

    Attributes:
        height: where it is [ADC steps]; None: none was seen.
    """

    def __init__(self, adc: Adc, threshold: float = 0.0):
        circuit = adc.circuit
        # what is given here is what readings have risen by
        self._falls_from = circuit.full_scale if adc.inverted else None
        self._scale = 1 << (16 - circuit.adc_bits)
        # what a short circuit would read [ADC steps]
        self._most = _NEAR_MOST * adc.rising_count(float(circuit.ratio(0.0)))
        # the solvers know what a reading there means
        known = adc.bounds(np.array(adc.range[1]))
        self._known_end = circuit.full_scale if known else math.inf  # ADC steps
        # where readings stood together [ADC steps], and what all read then
        self._shelf = math.inf
        self._picture: np.ndarray | None = None
        self.height: float | None = None
        self._noise = 0.0  # ADC steps by which a reading there may exceed it
        self._count = 1.0, 1.0 / _FORGET  # readings that stood still, and all: at first a guess
        self._present = False  # the last window shows it

    def frame(self, seen: Seen) -> None:
        self.look(seen.rising, seen.window)

    def look(self, rising: np.ndarray, window: Window | None) -> None:
        """Take the samples and the window of a frame, as `Seen` has them."""
        if self.height is not None:
            most = (self.height + self._noise) * self._scale
            self.height = None if rising.max() > most else self.height  # it was none
        if window is None:
            return
        still, stands = self._still(window), self._stands(window)
        self._present = still or stands
        if self._present:
            self.height = float(window.mean.max())
            self._noise = BEYOND * (window.noise + ROUNDING_NOISE) if stands else 0.0

    def _still(self, window: Window) -> bool:
        """Whether the ADC ends there, or what is behind it: the largest readings do not move."""
        mean, top = window.mean, window.mean.max()
        if top >= self._known_end:
            return False
        still, at_top = window.spread == 0.0, mean == top
        others = ~at_top & (mean > 0.0)
        stood, seen = self._count
        keep = 1.0 - _FORGET
        stood_now, seen_now = np.count_nonzero(still & others), np.count_nonzero(others)
        self._count = keep * stood + stood_now, keep * seen + seen_now
        n = np.count_nonzero(still & at_top)
        share = max(stood / max(seen, 1.0), _CHANCE**2)  # none stood still in all that is counted
        return bool(n * math.log(share) < math.log(_CHANCE) and top - np.median(mean) > ABOVE)

    def _stands(self, window: Window) -> bool:
        """Whether it ends before the ADC, whose noise is on top of it.

        The largest readings stand together where they stood before, and those beside have changed.
        """
        mean, spread, noise = window.mean, window.spread, window.noise + ROUNDING_NOISE
        top = float(mean.max())
        shelf = mean > top - noise
        if (
            np.count_nonzero(shelf) < SHELF
            or top > self._most
            or top - np.median(window.low) < ABOVE
            or spread[shelf].max() > 2.0 * noise
        ):
            return False
        near, self._shelf = abs(top - self._shelf) <= noise, top
        if self._picture is None or not near:
            self._picture = mean
            return False
        moved = np.abs(mean - self._picture)[binary_dilation(shelf, _BESIDE)]
        return bool(moved.max() > _MOVES * noise)

    def forget(self) -> None:
        self.height = self.height if self._present else None

    def findings(self) -> list[Finding]:
        if self.height is None:
            return []
        end = self.height if self._falls_from is None else self._falls_from - self.height
        return [Finding(Kind.SATURATION, "live", severity=Severity.FAULT, numbers={"steps": end})]
