"""From voltages to counts: noise, rounding, and what an ADC and its supply do wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

SCANS = 390  # a second, paper section III-B
OVERSAMPLED = 4  # scans of which a board of 100 frames a second sends the mean
_CHANGES = 10.0  # a second, of a loose contact


@dataclass
class Converter:
    """An ADC, with what may be wrong with it.

    Attributes:
    full_scale: its largest count.
    noise: RMS of a sample [ADC steps]; extra_noise: the same on top, (rows, cols).
    gain, offset: function of a time [s] -> factor, ADC steps.
    rail: ADC ratio above which nothing is seen, before the noise; ceiling: the same of counts.
    signal: whether it sees the matrix; else `stuck_ratio`.
    or_mask, and_mask: bits of a count that are always 1; and that may be 1.
    settling: share of the previous reading that stays on the sampling capacitor.
    dips: (row, column) -> share of the samples that are taken badly, what is left of them.
    flicker: (axis, line, share of time open) of a loose lead, or None.
    stuck_samples: what every sample reads instead, or None.
    """

    full_scale: int
    noise: float = 1.0
    extra_noise: np.ndarray | float = 0.0
    gain: Callable[[float], float] = lambda t: 1.0
    offset: Callable[[float], float] = lambda t: 0.0
    rail: float = np.inf
    ceiling: float = 1.0
    signal: bool = True
    stuck_ratio: float = 0.0
    or_mask: int = 0
    and_mask: int = -1
    settling: float = 0.0
    dips: dict[tuple[int, int], tuple[float, float]] = field(default_factory=dict)
    flicker: tuple[int, int, float] | None = None
    stuck_samples: int | None = None
    _closed: bool = field(default=True, repr=False)

    def count(self, ratio: np.ndarray, rng, t: np.ndarray | None = None) -> np.ndarray:
        """Return the counts (n, rows, cols) of ADC ratios (n, rows, cols) in turn.

        Args:
            t: (n,) that `gain` and `offset` are given [s]; 0 by default.
        """
        full, t = self.full_scale, np.zeros(len(ratio)) if t is None else t
        for cell, (share, left) in self.dips.items():
            ratio = ratio.copy()
            ratio[(rng.random(len(ratio)) < share, *cell)] *= left
        if not self.signal:
            ratio = np.full_like(ratio, self.stuck_ratio)
        if self.flicker:
            ratio = ratio * self._contact(self.flicker, ratio.shape, rng)
        if self.settling:
            from scipy.signal import lfilter  # here: it takes 0.3 s, and most boards settle

            flat = ratio.reshape(len(ratio), -1)
            flat = lfilter([1.0 - self.settling], [1.0, -self.settling], flat, axis=1)
            ratio = flat.reshape(ratio.shape)
        gain, offset = (np.vectorize(f)(t)[:, None, None] for f in (self.gain, self.offset))
        steps = np.minimum(ratio * gain, self.rail) * full + offset
        noise = np.hypot(self.noise, self.extra_noise)
        steps = np.rint(steps + noise * rng.standard_normal(steps.shape))
        # full scale is no analogue value: a line tied to it passes any ceiling
        top = np.where(ratio >= 1.0, full, np.rint(self.ceiling * full))
        steps = np.clip(steps, 0, top).astype(np.int32)
        if self.stuck_samples is not None:
            steps[:] = self.stuck_samples
        return steps & self.and_mask | self.or_mask

    def frame(self, ratio: np.ndarray, rng) -> np.ndarray:
        """Return the mean of four samples of an ADC ratio (rows, cols), as an ADC ratio."""
        samples = np.broadcast_to(ratio, (OVERSAMPLED, *ratio.shape))
        return self.count(samples, rng).mean(0) / self.full_scale

    def _contact(self, flicker: tuple[int, int, float], shape, rng) -> np.ndarray:
        """(n, rows, cols), 0 while a loose contact is open; it lasts a tenth of a second or so."""
        axis, line, share = flicker
        state = np.ones(shape)
        for k, (change, chance) in enumerate(rng.random((shape[0], 2))):
            if change < _CHANGES / SCANS:
                self._closed = chance > share
            if not self._closed:
                state[k].swapaxes(0, axis)[line] = 0.0
        return state
