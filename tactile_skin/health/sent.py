# SPDX-License-Identifier: Apache-2.0
"""Whether a running board sends what its ADC reads, or numbers that its sketch has processed.

Of the latter no rest is learnt: what was taken off is missing under every touch.
"""

from __future__ import annotations

import numpy as np

from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import NOT_READ, Adc
from ..readings import processed as readings
from .check import Check, Seen

_KEPT = 64  # frames that are looked at
_APART = 0.1  # s between them, at least
_EVERY = 0.5  # s after which it is asked again


class Sent(Check):
    """Follows what one board sends."""

    def __init__(self, adc: Adc, threshold: float):
        circuit = adc.circuit
        self._bits, self._cells = circuit.adc_bits, circuit.populated
        self._full = circuit.full_scale
        self._scale = 2.0 ** (16 - circuit.adc_bits)
        self._known = adc.rising_count(threshold) if threshold else 0.0
        low, high = adc.range
        self._unresolved = (1.0 - high if adc.inverted else low) * adc.full_scale
        # Where readings fall with pressure 0 is a short circuit. Pressed cells keep tens of ohm,
        # behind r_par: usual cells that stand there are none. An ADC that is a step too low reads 0
        # earlier.
        self._zero_is_short = adc.inverted and self._unresolved < 1.0
        self.forget()

    def forget(self) -> None:
        """Begin anew: the sketch may have been changed."""
        self.found: Finding | None = None
        self._shorted_since, self._shorted = np.inf, 0.0  # s; share of the cells
        self._frames: list[np.ndarray] = []
        self._kept = self._asked = -np.inf  # s

    def frame(self, seen: Seen) -> None:
        t, samples = seen.t, seen.samples
        if self.found:  # a sketch does not change its mind: until somebody has changed it
            return
        if self._zero_is_short and seen.rest is None:
            self._look_for_short(t, samples)
        if 0.0 <= t - self._kept < _APART:
            return
        self._kept = t
        steps = np.where(samples == NOT_READ, np.nan, samples / self._scale)
        self._frames = [*self._frames[1 - _KEPT :], np.where(self._cells, steps, np.nan)]
        if len(self._frames) >= readings.SEVERAL and not 0.0 <= t - self._asked < _EVERY:
            self._asked = t
            frames = np.array(self._frames)
            done = readings.processed(
                frames, self._bits, self._known, self._unresolved, opens=seen.opens * self._full
            )
            if done and done.kind is not readings.Done.CEILING:
                self._find(done)

    def _look_for_short(self, t: float, samples: np.ndarray) -> None:
        """By time, not by frames: those that repeat are taken for frozen, and are not seen."""
        share = float(np.mean(samples[self._cells] == 0))
        short = share >= 0.5  # the usual cell is
        if short:
            self._shorted_since, self._shorted = min(self._shorted_since, t), share
        if t - self._shorted_since >= _EVERY:
            self._find(readings.Processed(readings.Done.OFFSET, 0.0, None, self._shorted))
        elif not short:
            self._shorted_since = np.inf

    def _find(self, done: readings.Processed) -> None:
        self.found = Finding(Kind.ZEROS, severity=Severity.FAULT, detail=str(done))
