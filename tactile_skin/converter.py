"""Whether the ADC converts all that there is to read: a ceiling, seen over many frames.

One frame with some equal readings proves nothing: a flat touch looks so. Over time a ceiling gives
itself away by readings that stand at the largest value ever seen, without the noise that all
others have.
"""

from __future__ import annotations

import math

import numpy as np

_STILL = 8  # frames in which a reading that has noise moves
_CHANCE = 1e-6  # of a sound skin's readings standing at one height, in one frame
_PRIOR = 1.0, 1e3  # readings that stood still, of so many, before any was counted
_FORGET = 1e-3  # share of that count which each frame renews
_SELDOM = 1e-8  # share of readings that stand still, at least: none stood still in the whole count
_ABOVE = 16.0  # ADC steps over the middle reading: below, nothing presses


class Ceiling:
    """Readings that stand still at the largest value: a saturated input.

    Attributes:
        height: where it is [ADC steps]; None: none was seen.
    """

    def __init__(self, adc_bits: int):
        self._scale = 1 << (16 - adc_bits)
        self.height: float | None = None
        self._last: np.ndarray | None = None
        self._still: np.ndarray | None = None  # (rows, cols) frames since each reading moved
        self._count = _PRIOR  # readings that stood still, and all
        self._present = False  # the last frame shows it

    def frame(self, samples: np.ndarray) -> str:
        """What is wrong, with this frame or since an earlier one; empty if nothing."""
        if self._last is None:
            self._last, self._still = samples, np.zeros(samples.shape, np.int32)
            return ""
        self._still = np.where(samples == self._last, self._still + 1, 0)
        self._last, self._present = samples, False
        top = int(samples.max())
        if self.height is not None and top > self.height * self._scale:
            self.height = None  # it was none
        still = self._still >= _STILL
        at_top = samples == top
        others = ~at_top & (samples > 0)
        stood, seen = self._count
        keep = 1.0 - _FORGET
        self._count = (
            keep * stood + np.count_nonzero(still & others),
            keep * seen + np.count_nonzero(others),
        )
        if top - np.median(samples) > _ABOVE * self._scale:
            n = np.count_nonzero(still & at_top)
            if n and n * math.log(max(stood / max(seen, 1.0), _SELDOM)) < math.log(_CHANCE):
                self.height = top / self._scale
                self._present = True
        return self._said()

    def forget(self) -> str:
        """Forget what no longer shows; what is wrong with the last frame, empty if nothing."""
        self.height = self.height if self._present else None
        return self._said()

    def _said(self) -> str:
        if self.height is None:
            return ""
        return (
            f"readings end at {self.height:.0f} ADC steps and stand there without noise: "
            "is the input saturated?"
        )
