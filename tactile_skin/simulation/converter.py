# SPDX-License-Identifier: Apache-2.0
"""From voltages to counts: noise, rounding, and an input that ends before full scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

OVERSAMPLED = 4  # scans of which a board of 100 frames a second sends the mean


@dataclass
class Converter:
    """An ADC."""

    full_scale: int  # its largest count
    noise: float = 1.0  # RMS of a sample [ADC steps]
    # ADC ratio above which nothing is seen, before the noise; ceiling: the same of counts
    rail: float = np.inf
    ceiling: float = 1.0

    def count(self, ratio: np.ndarray, rng) -> np.ndarray:
        """Return the counts (n, rows, cols) of ADC ratios (n, rows, cols) in turn."""
        return self._counted(ratio, np.minimum(ratio, self.rail) * self.full_scale, self.noise, rng)

    def _counted(self, ratio: np.ndarray, steps: np.ndarray, noise, rng) -> np.ndarray:
        steps = np.rint(steps + noise * rng.standard_normal(steps.shape))
        # full scale is no analogue value: a line tied to it passes any ceiling
        top = np.where(ratio >= 1.0, self.full_scale, np.rint(self.ceiling * self.full_scale))
        return np.clip(steps, 0, top).astype(np.int32)

    def frame(self, ratio: np.ndarray, rng) -> np.ndarray:
        """Return the mean of four samples of an ADC ratio (rows, cols), as an ADC ratio."""
        samples = np.broadcast_to(ratio, (OVERSAMPLED, *ratio.shape))
        return self.count(samples, rng).mean(0) / self.full_scale
