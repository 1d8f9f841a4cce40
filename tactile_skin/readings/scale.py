# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a file are: ADC steps, ratios, volts, or pictures that somebody processed.

What cannot be what an ADC reads is refused by what was seen; what may be two things is refused
until `full_scale` says which.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from .processed import sample_of

VOLTS = 5.5  # V, the most that a board of 5 V prints
# Numbers, and share of the full scale, that a signed ADC reads below 0 at 0 V: offsets of such ADCs
# are up to 3 steps (data sheet of the ADS1115), and noise adds to them.
_BELOW_ZERO = 4.0
_BELOW_ZERO_SHARE = 0.001
_SAMPLE = 200_000  # numbers that are looked at
_DECIMALS = 1e-6  # share of a unit of the last decimal by which a printed number may miss it
_PRINTED = 1000.0  # numbers with three decimals or fewer were printed, and rounded
_WIDTHS = range(8, 17)  # bits of ADCs whose readings may stand as ratios
_ON_GRID = 0.02  # of an ADC step by which a ratio may miss a whole number of steps
_MOSTLY = 0.9  # share of the frames that reach both ends, where each was normalised


class Numbers(Enum):
    """What numbers are."""

    STEPS = "ADC steps"
    RATIOS = "ratios"
    VOLTS = "volts"
    RATIOS_OR_VOLTS = "ratios or volts"
    NORMALISED = "normalised"
    NEGATIVE = "below 0"
    RESISTANCES = "resistances"


class Scale(NamedTuple):
    """What the numbers of some frames are."""

    kind: Numbers  # of them
    # low, high: the smallest and the largest
    low: float
    high: float
    each: bool = False  # of NORMALISED, whether each frame was, and not all together

    def refused(self) -> str:
        """Return why these are not what an ADC reads; empty if they may be."""
        ends = f"numbers from {self.low:.4g} to {self.high:.4g}"
        if self.kind is Numbers.NEGATIVE:
            return (
                f"{ends}: an ADC reads nothing below 0. Was a baseline subtracted? Must be what "
                "the ADC reads"
            )
        if self.kind is Numbers.NORMALISED:
            what = "each frame reaches" if self.each else "the file reaches"
            return f"{what} from exactly 0 to exactly 1: normalised, must be what the ADC reads"
        if self.kind is Numbers.RESISTANCES:
            return (
                f"{ends} with decimals, too small for means of ADC steps or falling under touches: "
                "resistances, in kilo-ohms? Must be what the ADC reads. Means: full_scale:=1023 ..."
            )
        if self.kind in (Numbers.VOLTS, Numbers.RATIOS_OR_VOLTS):
            return (
                f"{ends}: {self.kind.value}? Say what an input at the supply reads: "
                "full_scale:=5.0 of volts, full_scale:=1.0 of ratios"
            )
        return ""


def other_scale(top: float) -> float:
    """Return up to where numbers with decimals may be no means of steps of an ADC that ends at top.

    They may be shares or volts, or resistances in kohm. So little, 10 of 12 bits, reads no board
    that prints means.
    """
    return max(VOLTS, top / 400)


def below_zero(full_scale: float) -> float:
    """Return how far below 0 numbers are an ADC's own error; what is lower was subtracted."""
    return max(_BELOW_ZERO, _BELOW_ZERO_SHARE * full_scale)


def scale_of(values: np.ndarray, top: float = 0.0) -> Scale:
    """Return what the numbers of frames (n, rows, cols) are; NaN: not read.

    Args:
        values: of them.
        top: the largest that the ADC gives [ADC steps]; 0: not known.
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low < 0.0:
        return Scale(Numbers.NEGATIVE, low, high)
    if values.dtype.kind != "f" or high > VOLTS:
        resistances = are_resistances(values, top)
        return Scale(Numbers.RESISTANCES if resistances else Numbers.STEPS, low, high)
    flat = values[~np.isnan(values)]
    flat = flat[:: max(1, flat.size // _SAMPLE)]
    if (flat == np.rint(flat)).all() and high > 1.0:
        return Scale(Numbers.STEPS, low, high)
    if high > 1.0:
        return Scale(Numbers.VOLTS, low, high)
    with np.errstate(all="ignore"):
        ends = np.nanmin(values, (1, 2)) == 0.0, np.nanmax(values, (1, 2)) == 1.0
    if (ends[0] & ends[1]).mean() > _MOSTLY and len(values) > 1:
        return Scale(Numbers.NORMALISED, low, high, each=True)
    if (low, high) == (0.0, 1.0):
        return Scale(Numbers.NORMALISED, low, high)
    printed = np.abs(flat * _PRINTED - np.rint(flat * _PRINTED)).max(initial=0.0) < _DECIMALS
    if printed and not any(_on_grid(flat, bits) for bits in _WIDTHS):
        return Scale(Numbers.RATIOS_OR_VOLTS, low, high)
    return Scale(Numbers.RATIOS, low, high)


def are_resistances(values: np.ndarray, top: float) -> bool:
    """Return whether frames (n, rows, cols) hold resistances, and no means of ADC steps up to top.

    With decimals, below 1/256 of the ADC's range, or below a quarter of it and falling by touches.
    """
    some = sample_of(values).astype(float).reshape(-1, values[0].size)
    some = some[:, ~np.isnan(some).any(0)]
    usual, low, high = np.median(some, axis=0), some.min(0), some.max(0)
    falls = ((low < usual / 2.0) & (high < 1.5 * usual) & (low > 0.0)).sum()
    small = bool((some % 1.0 > 0.0).any()) and some.max() < top / 4.0
    return small and bool(some.max() < top / 256.0 or falls > max(1, (high > 2.0 * usual).sum()))


def _on_grid(ratios: np.ndarray, bits: int) -> bool:
    steps = ratios * (2**bits - 1)
    return bool(np.abs(steps - np.rint(steps)).max(initial=0.0) < _ON_GRID)


def without_sentinel(values: np.ndarray) -> tuple[np.ndarray, int]:
    """Return frames with NaN for -1, and how many, where no other number is below 0."""
    below = values < 0
    if not below.any() or (values[below] != -1).any():
        return values, 0
    return np.where(below, np.float32(np.nan), values), int(below.sum())
