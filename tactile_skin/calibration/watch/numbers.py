"""Whether a running board sends what its ADC reads, or numbers that its sketch has processed.

Of the latter no rest is learnt: what was taken off is missing under every touch.
"""

from __future__ import annotations

import numpy as np

from ...physics.adc import NOT_READ, Adc
from ...readings.processed import Kind, processed

_KEPT = 64  # frames that are looked at
_FEWEST = 10  # frames that show which cells move
_APART = 0.1  # s between them, at least
_RENEW = 0.05  # share of how often each reading is 0 that each frame renews
_OFTEN = 0.1  # share of the frames in which the usual reading is 0, from which on it is asked soon
_SOON = 0.2  # s after which it is asked again,
_EVERY = 2.0  # and where readings are not 0


class Numbers:
    """Follows what one board sends; all times are of one clock [s].

    Attributes:
        message: what was done to its readings; empty if nothing shows.
    """

    def __init__(self, adc: Adc, threshold: float):
        """Args:
        adc: its converter.
        threshold: ADC ratio up to which it is known to send 0 or no reading.
        """
        circuit = adc.circuit
        self.message = ""
        self._bits, self._cells = circuit.adc_bits, circuit.populated
        self._scale = 2.0 ** (16 - circuit.adc_bits)
        self._known = adc.rising_count(threshold) if threshold else 0.0
        low, high = adc.range
        self._unresolved = (1.0 - high if adc.inverted else low) * adc.full_scale
        self._frames: list[np.ndarray] = []
        self._at_zero = np.zeros(circuit.shape)
        self._kept = self._asked = -np.inf  # s

    def frame(self, t: float, samples: np.ndarray) -> None:
        """Take a frame.

        Args:
            t: when it was read.
            samples: (rows, cols) of skin/adc.
        """
        if self.message:  # a sketch does not change its mind: until somebody has changed it
            return
        self._at_zero += _RENEW * ((samples == 0) - self._at_zero)
        if 0.0 <= t - self._kept < _APART:
            return
        self._kept = t
        steps = np.where(samples == NOT_READ, np.nan, samples / self._scale)
        self._frames = [*self._frames[1 - _KEPT :], np.where(self._cells, steps, np.nan)]
        often = np.median(self._at_zero[self._cells]) > _OFTEN
        due = not 0.0 <= t - self._asked < (_SOON if often else _EVERY)
        if due and len(self._frames) >= _FEWEST:
            self._asked = t
            done = processed(np.array(self._frames), self._bits, self._known, self._unresolved)
            self.message = str(done) if done and done.kind is not Kind.CEILING else ""
