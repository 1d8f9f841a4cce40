# SPDX-License-Identifier: Apache-2.0
"""Tell readings that somebody processed from what an ADC reads, by a window of frames.

An untouched fabric conducts, and every reading has noise. A stream in which usual cells read 0 was
cut there: an offset or a threshold was taken off, or the ADC resolves no more. A sheet that is open
until it is touched reads 0, too: its curve says so.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

_FRAMES = 400  # that are looked at, at most
AT_END = 0.1  # share of the frames in which a usual cell reads 0, or another end, at least
_GAP = 3.0  # ADC steps above 0 in which no number lies, at least
_STRAYS = 0.002  # share of the numbers that may lie in the gap
# Above a threshold numbers set in at once: as many within a quarter of it as in the next one, but
# for this share.
_BAND = 0.25
_SETS_IN = 0.6
_FEWEST = 20  # numbers there
# Times by which a fabric's resistance falls from no load to a kilogram at most: 35 to 370 in
# published series of velostat, 470 by the shipped curve. Readings rise by less.
_MOST_FALL = 500.0
_HALF_STEP = 0.5
_CALM = 0.3  # of the frames, the lowest ones, are those in which least touches
_NOISE = 2.0  # ADC steps RMS: of less, rounding makes much the same
# Share of its calm frames in which a cell reads 0 whose mean was taken off: at least, at most.
_CUT_LEAST = 0.25
_CUT_MOST = 0.9
_MEAN_OF_HALF = 0.8  # mean over standard deviation of a half normal distribution
_PILE = 5  # readings at the largest number, and as many as in all of the tenth below it
_BESIDE = 0.9  # of the largest number: where that tenth begins
_ROUND = 50  # ADC steps: an end that somebody chose is at least so much, a ceiling a multiple
_EACH = 0.98  # share of the frames that reach both ends, where each was normalised
_MOVES = 0.95  # share of the frames in which one cell is at an end, at most
SEVERAL = 10  # frames, at least, that show it


class Done(Enum):
    """What was done to readings."""

    OFFSET = "an offset was taken off"
    THRESHOLD = "what lies below a threshold was dropped"
    CEILING = "what lies above a ceiling was cut"
    NORMALISED = "each frame was stretched"


class Processed(NamedTuple):
    """What was done to the readings of a board."""

    kind: Done  # the first that shows
    level: float  # below which there is none but 0, or where each frame ends [ADC steps]
    ceiling: float | None  # where many end [ADC steps]; None: nowhere
    share: float  # of the readings that are exactly 0

    def __str__(self) -> str:
        if self.kind is Done.NORMALISED:
            return (
                f"these are not ADC readings: each frame reaches from 0 to "
                f"{self.level:g}: normalised"
            )
        top = "" if self.ceiling is None else f"a ceiling at {self.ceiling:g}"
        if self.kind is Done.CEILING:
            return f"many readings are exactly {self.ceiling:g} ADC steps, none is above: {top}?"
        seen = f"{self.share:.0%} are exactly 0"
        if self.kind is Done.THRESHOLD:
            seen += f", and none lies between that and {self.level:g}: a threshold"
        else:
            seen += (
                ": an offset or a threshold is taken off, the ADC reads nothing so low, or the "
                "sheet is open until it is touched, and its curve is not"
            )
        return "these are not ADC readings: " + ", ".join(filter(None, [top, seen]))


def sample_of(steps: np.ndarray) -> np.ndarray:
    """Return those of (n, rows, cols) that `processed` looks at."""
    return steps[:: -(-len(steps) // _FRAMES)]


def processed(
    steps, adc_bits: int, threshold: float = 0.0, unresolved: float = 0.0, *, opens: float = 0.0
) -> Processed | None:
    """Return what was done to the readings of a board; None: nothing that shows.

    Args:
        steps: (n, rows, cols) as the board sends them [ADC steps]; NaN: not read.
        adc_bits: of its ADC.
        threshold: up to which it is known to send 0 [ADC steps].
        unresolved: what a reading of 0 may stand for [ADC steps], of an ADC that reads too low.
        opens: up to which nothing touches a sheet that is open at rest [ADC steps]: zeros show no
            offset, and no threshold so low; 0: it conducts.
    """
    steps = np.asarray(sample_of(steps), float)
    steps = steps.reshape(len(steps), -1)
    live = ~np.isnan(steps).any(0)
    if len(steps) >= SEVERAL:
        live[live] = np.ptp(steps[:, live], axis=0) > 0.0
    if not live.any():
        return None
    steps = steps[:, live]
    if _is_stretched(steps):
        return Processed(Done.NORMALISED, float(steps.max()), None, float(np.mean(steps == 0.0)))
    top, at_zero = float(steps.max()), steps == 0.0
    share = float(at_zero.mean())
    ceiling = _ceiling(steps, adc_bits)
    if np.median(at_zero.mean(0)) > AT_END:
        level = _gap(steps[~at_zero])
        if level is not None:
            known = level <= max(threshold, opens) + _GAP
            return None if known else Processed(Done.THRESHOLD, level, ceiling, share)
        if opens:
            return None
        least = _mean(steps) + max(_HALF_STEP, unresolved)
        if ceiling is not None or top > _MOST_FALL * least or _is_cut(steps, unresolved):
            return Processed(Done.OFFSET, 0.0, ceiling, share)
        return None
    if ceiling is not None:
        return Processed(Done.CEILING, 0.0, ceiling, share)
    return None


def _calm(steps: np.ndarray) -> np.ndarray:
    """Return the frames in which least touches."""
    level = steps.sum(1)
    return steps[level <= np.quantile(level, _CALM)]


def _mean(steps: np.ndarray) -> float:
    """Return what a usual cell reads where least touches."""
    return float(np.median(_calm(steps).mean(0)))


def _is_cut(steps: np.ndarray, unresolved: float) -> bool:
    """Whether noise is cut in its middle in nearly all cells, where nothing touches."""
    calm = _calm(steps)
    low, high = np.quantile((calm == 0.0).mean(0), (0.1, 0.9))
    above = calm[calm > 0.0]
    if not (low > _CUT_LEAST and high < _CUT_MOST and above.size):
        return False
    return float(np.mean(above)) / _MEAN_OF_HALF > _NOISE + unresolved


def _gap(numbers: np.ndarray) -> float | None:
    """Where numbers above 0 set in, if not at once; None: they do."""
    above = np.sort(numbers)
    if len(above) < _FEWEST:
        return None
    level = above[int(_STRAYS * len(above))]
    if level < _GAP:
        return None
    begin, middle, end = np.searchsorted(above, level * (1.0 + _BAND * np.arange(3)))
    if middle - begin < max(_FEWEST, _SETS_IN * (end - middle)):
        return None
    return float(above[0] if above[0] > _BESIDE * level else level)


def _ceiling(steps: np.ndarray, adc_bits: int) -> float | None:
    """Where readings of several cells end exactly, which is no end of an ADC; None: nowhere."""
    top = float(steps.max())
    ends = {(2**b - 1) << k for b in range(6, 17) for k in range(17 - b)} | {1 << adc_bits}
    if top < _ROUND or top % _ROUND or top in ends:
        return None
    there = steps == top
    below = steps[(steps >= _BESIDE * top) & ~there]
    several = there.any(0).sum() > 1
    return top if several and there.sum() >= max(_PILE, below.size) else None


def _is_stretched(steps: np.ndarray) -> bool:
    """Whether each frame reaches from 0 to one largest number, in changing cells."""
    top = float(steps.max())
    if len(steps) < SEVERAL or top < _ROUND:
        return False
    ends = steps == 0.0, steps == top
    reached = all(at_end.any(1).mean() >= _EACH for at_end in ends)
    return reached and all(at_end.mean(0).max() <= _MOVES for at_end in ends)
