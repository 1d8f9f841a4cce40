# SPDX-License-Identifier: Apache-2.0
"""Whether integers are ADC steps that a sketch has multiplied, as for millivolts.

Steps times a factor, rounded, leave some numbers out, or hit some twice, at even distances: a
rhythm that no noise and no touch has. It is a line in the spectrum of how many cells have read each
number, and shows a scale where no touch does, as each moves all readings.
"""

from __future__ import annotations

import numpy as np

_MOST_BITS = 14  # of an ADC: with more, readings of any scale are integers
_MOST_CELLS = 256  # that are followed
_WHOLE = 0.02  # of a step by which an integer may be missed: as ratios keep them
_SLOWEST = 0.05  # lines a number: below, touches have such rhythms
_FASTEST = 0.45  # the same: above, the least bit of an ADC has
_BITS_RHYTHM = 32  # an ADC's own steps differ in the rhythm of its bits, multiples of 1 in so many
_WIDTH = 3.0  # of a line, over the numbers that were read
_BESIDE = 256  # places of the spectrum whose median a line is compared with
# Times that median: 2^-40 of all places by chance. None of 60 boards that print steps exceeded 18;
# of 30 that print millivolts 21 exceeded this, all loaded ones 50 (benchmarks/doctor/entries.py,
# seeds 5010 to 5039, a minute of touches).
_LINE = 40.0


class Multiplied:
    """Follows which numbers each cell of a board has read."""

    def __init__(self, shape: tuple[int, int], adc_bits: int):
        """Start with none, of (rows, cols) readings."""
        self._cells = np.arange(0, shape[0] * shape[1], -(-shape[0] * shape[1] // _MOST_CELLS))
        self._each = np.arange(self._cells.size)
        self._integers = adc_bits <= _MOST_BITS
        self._read = np.zeros((self._cells.size, 1 << adc_bits if self._integers else 0), bool)

    def frame(self, steps: np.ndarray) -> None:
        """Take (rows, cols) numbers as the board sends them [ADC steps]; NaN: not read."""
        if not self._integers:
            return
        steps = steps.ravel()[self._cells]
        there = ~np.isnan(steps)
        steps = np.where(there, steps, 0.0)
        nearest = np.rint(steps).astype(int)
        if np.abs(steps - nearest).max() > _WHOLE:  # means of some, or another scale is configured
            self._integers = False
            return
        self._read[self._each[there], nearest[there]] = True

    @property
    def found(self) -> bool:
        """Whether they are so, as far as is known by now."""
        if not self._integers:
            return False
        counts = self._read.sum(0)
        (there,) = counts.nonzero()
        size = 2 * counts.size
        power = np.square(np.abs(np.fft.rfft(counts, size)))[:-1]
        place = np.arange(power.size) / size
        usual = np.median(power.reshape(-1, min(_BESIDE, power.size)), axis=1)
        line = power > _LINE * np.repeat(usual, power.size // usual.size)
        off = np.abs(place * _BITS_RHYTHM - np.rint(place * _BITS_RHYTHM)) / _BITS_RHYTHM
        line &= (place > _SLOWEST) & (place < _FASTEST)
        span = there[-1] - there[0] if there.size > 1 else 1
        return bool(line[off > _WIDTH / span].any())
