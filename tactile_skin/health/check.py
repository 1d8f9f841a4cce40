# SPDX-License-Identifier: Apache-2.0
"""What a check of a running skin is, and what it sees: frames, and windows of some of them."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from ..findings.finding import Finding
from ..physics.adc import Adc
from ..solvers import Estimate

WINDOW = 10  # frames that are looked at together: 0.1 s at 100 a second
ABOVE = 16.0  # ADC steps over the middle reading: below, nothing presses
CALM = 0.25  # of the readings are not moved by a touch, and of the windows
_KEPT = 100  # windows whose noise is kept: 10 s at 100 frames a second
# Times the noise of calm windows, that another's is at most: what is more is a touch. Chosen on
# tests/health; scored on 120 sound streams (benchmarks.faults, seed 7700): none has a ceiling.
_CHANCE = 1.5


def over(adc: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(rows, cols) what readings are over those at rest, 0 where none came."""
    off = adc - rest
    return np.where(np.isnan(off), 0.0, off)


class Window(NamedTuple):
    """What some frames show."""

    # mean, spread: (rows, cols) of each reading in some frames [ADC steps]
    mean: np.ndarray
    spread: np.ndarray
    noise: float  # RMS of the readings that nothing moves, about as in calm windows [ADC steps]
    low: np.ndarray  # (rows, cols) lowest mean of each reading so far: at rest


class Windows:
    """Cuts the stream into windows."""

    def __init__(self, adc_bits: int):
        self._scale = 1 << (16 - adc_bits)
        self._frames: list[np.ndarray] = []
        self._low: np.ndarray | None = None
        self._noise: deque[float] = deque(maxlen=_KEPT)  # of each window [ADC steps]

    def frame(self, samples: np.ndarray) -> Window | None:
        """Return the window that this frame ends, if it does."""
        self._frames.append(samples)
        if len(self._frames) < WINDOW:
            return None
        steps = np.array(self._frames) / self._scale
        self._frames = []
        mean, spread = steps.mean(0), steps.std(0)
        self._low = mean if self._low is None else np.minimum(self._low, mean)
        # by what changes from frame to frame: a palm on a small skin moves all readings at once
        chance = np.sqrt(np.square(np.diff(steps, axis=0)).mean(0) / 2.0)
        read = chance[mean > 0.0]  # 0: not read, or below the ADC's range
        noise = float(np.quantile(read, CALM)) if read.size else 0.0
        self._noise.append(noise)
        noise = min(noise, _CHANCE * float(np.quantile(self._noise, CALM)))
        return Window(mean, spread, noise, self._low)


class Seen(NamedTuple):
    """Holds one frame of a running skin, and what was found in it."""

    t: float  # when it was read [s]; may be set back
    samples: np.ndarray  # (rows, cols) of skin/adc
    rising: np.ndarray  # the same, so that they rise with pressure; 0 where there is no reading
    adc: np.ndarray  # (rows, cols) ADC ratio; NaN where there is no reading
    estimate: Estimate  # of the frame
    stirs: bool  # whether anything touches, however lightly
    rest: np.ndarray | None  # (rows, cols) ADC ratio of the skin at rest; None: not measured yet
    noise: float  # RMS of a reading, as ADC ratio
    # (rows, cols) of the untouched cells [ohm]; None: not measured yet
    resting: np.ndarray | float | None = None
    opens: float = 0.0  # as `Tare.opens`
    recovers: bool = False  # whether what lies below the rest is what a touch leaves for seconds
    window: Window | None = None  # of the last frames, which this one ends; None: it ends none


class Check:
    """Looks at one skin; all times are of one clock [s]."""

    found: Finding | None = None  # what is wrong by now; None: nothing

    def __init__(self, adc: Adc, threshold: float = 0.0):
        """Start with nothing known of the skin.

        Args:
            adc: the board's converter, with its circuit.
            threshold: ADC ratio up to which it is known to send 0 or no reading.
        """

    def frame(self, seen: Seen) -> None:
        """Take a frame."""

    def findings(self) -> list[Finding]:
        """Return what is wrong by now."""
        return [self.found] if self.found else []

    def forget(self) -> None:
        """Take what only earlier frames show as over: somebody has checked the skin."""
