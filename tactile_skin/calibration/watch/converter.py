"""Whether the ADC converts all that there is to read: a ceiling, seen over many frames.

One frame with some equal readings proves nothing: a flat touch looks so. Over time a ceiling gives
itself away by readings that stand at the largest value ever seen, without the noise that all
others have; or, if the ceiling lies before the ADC, which adds its own noise, by readings that
stand together at one height while those beside them change: flat touches stand at heights of their
own, and the same touch once more brings the same readings beside them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation

from ...solvers.suspect import ask_what_ends

_STILL = 8  # frames in which a reading that has noise moves
_CHANCE = 1e-6  # of a sound skin's readings standing at one height, in one frame
_PRIOR = 1.0, 1e3  # readings that stood still, of so many, before any was counted
_FORGET = 1e-3  # share of that count which each frame renews
_SELDOM = 1e-8  # share of readings that stand still, at least: none stood still in the whole count
# Share of frames that repeat the reading that does so most, up to which noise moves all readings;
# the least that is counted on; share of it that each frame renews.
_NOISY, _LEAST, _RENEW = 0.6, 0.4, 1.0 / 256.0
_ABOVE = 16.0  # ADC steps over the middle reading: below, nothing presses
_WINDOW = 10  # frames that are looked at together: 0.1 s at 100 a second
_STOOD = 10  # windows in which nothing moves that are looked at together: noise falls to a third
_CALM = 0.25  # of the readings are not moved by a touch
_ROUND = 0.3  # ADC steps by which the mean of rounded readings may be off
_SHELF = 4  # readings at one height
_MOVES = 20.0  # times the noise by which those beside them differ when they stand there again
_BESIDE = np.ones((3, 3))  # a cell and its neighbours
# Times that readings at rest are further apart, which makes, and ends, a fault; readings at least;
# share of the rest by which no fabric changes between two measurements of it.
_ALIKE, _MANY, _RAISED = (3.0, 2.0), 8, 0.3
_BEYOND = 5.0  # standard deviations of noise beyond which a reading is above a ceiling
_NEAR_MOST = 0.9  # of what a short circuit would read: above, all hard touches read alike


class Window(NamedTuple):
    """Attributes:
    mean, spread: (rows, cols) of each reading in some frames [ADC steps].
    noise: spread of the readings that nothing moves.
    low: (rows, cols) lowest mean of each reading so far: at rest.
    """

    mean: np.ndarray
    spread: np.ndarray
    noise: float
    low: np.ndarray


class Windows:
    """Cuts the stream into windows."""

    def __init__(self, adc_bits: int):
        self._scale = 1 << (16 - adc_bits)
        self._frames: list[np.ndarray] = []
        self._low: np.ndarray | None = None

    def frame(self, samples: np.ndarray) -> Window | None:
        """The window that this frame ends, if it does."""
        self._frames.append(samples)
        if len(self._frames) < _WINDOW:
            return None
        steps = np.array(self._frames) / self._scale
        self._frames = []
        mean, spread = steps.mean(0), steps.std(0)
        self._low = mean if self._low is None else np.minimum(self._low, mean)
        read = spread[mean > 0.0]  # 0: not read, or below the ADC's range
        noise = float(np.quantile(read, _CALM)) if read.size else 0.0
        return Window(mean, spread, noise, self._low)


class RestPicture:
    """What becomes of the picture of an untouched skin, whose cells rest apart.

    Where all readings are alike nothing of the matrix is read. Where that picture stands at another
    height a bit of the ADC is stuck: whatever presses changes each cell by its own.
    """

    def __init__(self):
        self._told = ""
        self._mean, self._count = None, 0  # of windows in which nothing moved; how many

    def window(self, window: Window, rest: np.ndarray) -> str:
        """What is wrong; empty if nothing.

        On a small skin noise hides for a window whether all readings are alike.

        Args:
            rest: (rows, cols) what the cells read at rest, as it was measured [ADC steps].
        """
        read = window.mean > 0.0
        if np.count_nonzero(read) < _MANY:
            self._told = ""
            return ""
        now, rest = self._stands(window)[read], rest[read]
        apart, up = rest.std(), float(np.median(now - rest))
        least = _ALIKE[1] if self._told else _ALIKE[0]
        if least * now.std() < apart:
            self._told = "all readings are one voltage, but for noise: is the matrix connected?"
        elif (
            abs(up) > max(_ABOVE, _RAISED * np.median(rest)) and least * (now - rest).std() < apart
        ):
            if not self._told.startswith("all cells"):  # one text for as long as it lasts
                self._told = (
                    f"all cells read {abs(up):.0f} ADC steps {'above' if up > 0.0 else 'below'} "
                    "their rest, to the noise: is a bit of the ADC stuck?"
                )
        else:
            self._told = ""
        return self._told

    def _stands(self, window: Window) -> np.ndarray:
        """(rows, cols) mean of the last windows, as long as nothing moves."""
        limit = _BEYOND * (window.noise + _ROUND) * (2.0 / _WINDOW) ** 0.5
        if self._mean is None or (np.abs(window.mean - self._mean) > limit).any():
            self._mean, self._count = window.mean, 1
        else:
            self._count = min(self._count + 1, _STOOD)
            self._mean = self._mean + (window.mean - self._mean) / self._count
        return self._mean


class Ceiling:
    """Readings that stand still at the largest value: a saturated input.

    Attributes:
        height: where it is [ADC steps]; None: none was seen.
    """

    def __init__(self, adc_bits: int, most: float = math.inf, falls_from: float | None = None):
        """Args:
        most: what a short circuit would read [ADC steps], near which all hard touches read alike.
        falls_from: of a board whose readings fall with pressure, the largest one [ADC steps];
            what is given here is what they have fallen by.
        """
        self._falls_from, self._full = falls_from, 2**adc_bits - 1
        self._scale = 1 << (16 - adc_bits)
        self._most = _NEAR_MOST * most
        # where readings stood still [ADC steps], and what the others read then
        self._shelf, self._picture = math.inf, None
        self.height: float | None = None
        self._noise = 0.0  # ADC steps by which a reading there may exceed it
        self._last: np.ndarray | None = None
        self._still: np.ndarray | None = None  # (rows, cols) frames since each reading moved
        self._count = _PRIOR  # readings that stood still, and all
        # (rows, cols) share of frames in which each repeated, and the frames that tell it
        self._repeats: np.ndarray | None = None
        self._seen: np.ndarray | None = None
        self._present = False  # the last frame shows it

    def frame(self, samples: np.ndarray) -> str:
        """What is wrong, with this frame or since an earlier one; empty if nothing."""
        if self._last is None:
            self._last, self._still = samples, np.zeros(samples.shape, np.int32)
            self._repeats, self._seen = np.ones(samples.shape), np.full(samples.shape, 1)
            return ""
        same = samples == self._last
        self._still = np.where(same, self._still + 1, 0)
        self._last, self._present = samples, False
        top = int(samples.max())
        if self.height is not None and top > (self.height + self._noise) * self._scale:
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
        n = np.count_nonzero(still & at_top)
        told = n and n * math.log(max(stood / max(seen, 1.0), _SELDOM)) < math.log(_CHANCE)
        self._seen[others] += 1
        share = np.maximum(1.0 / self._seen[others], _RENEW)
        self._repeats[others] += share * (same[others] - self._repeats[others])
        if n and not told and others.any():
            # What repeats in a share q of frames has one value in at most sqrt(q) of them.
            repeats = max(self._repeats[others].max(), _LEAST)
            length = self._still[at_top].max()
            told = repeats < _NOISY and length * 0.5 * math.log(repeats) < math.log(_CHANCE)
        if told and top - np.median(samples) > _ABOVE * self._scale:
            self.height, self._noise = top / self._scale, 0.0
            self._present = True
        return self._said()

    def window(self, window: Window) -> str:
        """The same, of a ceiling before the ADC, whose noise is on top of it."""
        self._shelf, told = self._stands(window)
        if told:
            self.height, self._present = self._shelf, True
            self._noise = _BEYOND * (window.noise + _ROUND)
        return self._said()

    def _stands(self, window: Window) -> tuple[float, bool]:
        """Where the largest readings stand together; whether those beside changed since."""
        mean, spread, noise = window.mean, window.spread, window.noise + _ROUND
        top = float(mean.max())
        shelf = mean > top - noise
        if (
            np.count_nonzero(shelf) < _SHELF
            or top > self._most
            or top - np.median(window.low) < _ABOVE
            or spread[shelf].max() > 2.0 * noise
        ):
            return self._shelf, False
        if self._picture is None or abs(top - self._shelf) > noise:
            self._shelf, self._picture = top, mean
            return top, False
        moved = np.abs(mean - self._picture)[binary_dilation(shelf, _BESIDE)]
        return top, bool(moved.max() > _MOVES * noise)

    def forget(self) -> str:
        """Forget what no longer shows; what is wrong with the last frame, empty if nothing."""
        self.height = self.height if self._present else None
        return self._said()

    def _said(self) -> str:
        if self.height is None:
            return ""
        end = self.height if self._falls_from is None else self._falls_from - self.height
        return (
            f"readings end at {end:.0f} ADC steps and stay there while others change: "
            f"{ask_what_ends(self.height / self._full)}"
        )
