# SPDX-License-Identifier: Apache-2.0
"""Whether integers are ADC steps that a sketch has multiplied, as for millivolts.

Steps times a factor, rounded, leave some numbers out, or hit some twice, at even distances: a
rhythm that no noise and no touch has. It is a line in the spectrum of how many cells have read each
number, and shows a scale where no touch does, as each moves all readings.
"""

from __future__ import annotations

import numpy as np

_MOST_BITS = 14  # of an ADC: with more, readings of any scale are integers
_WHOLE = 0.02  # of a step by which an integer may be missed: as ratios keep them
_SLOWEST = 0.05  # lines a number: below, touches have such rhythms
_FASTEST = 0.45  # the same: above, the least bit of an ADC has
_BITS_RHYTHM = 32  # an ADC's own steps differ in the rhythm of its bits, multiples of 1 in so many
_WIDTH = 3.0  # of a line, over the numbers that were read
_BESIDE = 256  # places of the spectrum whose median a line is compared with
# Times that median: 2^-40 of all places by chance. Of a minute of touches none of 60 boards that
# print steps exceeded 18; of 30 that print millivolts 21 exceeded this, all loaded ones 50
# (benchmarks/doctor/entries.py, seeds 5010 to 5039). A few readings may exceed it by chance.
_LINE = 40.0


def is_multiplied(steps: np.ndarray, adc_bits: int) -> bool:
    """Return whether (frames, cells) numbers [ADC steps; NaN: not read] are so.

    Args:
        steps: as the board sends them, of some touches or more.
    """
    there = ~np.isnan(steps)
    nearest = np.rint(np.where(there, steps, 0.0)).astype(int)
    # means of some readings are no integers, nor are numbers of a scale that is configured
    if adc_bits > _MOST_BITS or np.abs(steps - nearest)[there].max(initial=0.0) > _WHOLE:
        return False
    read = np.zeros((steps.shape[1], 1 << adc_bits), bool)
    each = np.broadcast_to(np.arange(steps.shape[1]), steps.shape)
    read[each[there], nearest[there]] = True
    counts = read.sum(0)
    (numbers,) = counts.nonzero()
    size = 2 * counts.size
    power = np.square(np.abs(np.fft.rfft(counts, size)))[:-1]
    place = np.arange(power.size) / size
    usual = np.median(power.reshape(-1, min(_BESIDE, power.size)), axis=1)
    line = power > _LINE * np.repeat(usual, power.size // usual.size)
    off = np.abs(place * _BITS_RHYTHM - np.rint(place * _BITS_RHYTHM)) / _BITS_RHYTHM
    line &= (place > _SLOWEST) & (place < _FASTEST)
    span = numbers[-1] - numbers[0] if numbers.size > 1 else 1
    return bool(line[off > _WIDTH / span].any())
