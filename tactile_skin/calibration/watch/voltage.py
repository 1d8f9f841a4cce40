"""Whether all readings of a skin at rest are one voltage: no fabric's cells are as alike."""

from __future__ import annotations

import numpy as np
from scipy.special import gammainccinv

from ...physics.circuit import Circuit, forward
from ..rest import usual_resistance

# RMS by which readings of one voltage differ at most: as channels may [ADC steps]; by chance, and
# times the noise of a mean, as a low-pass before it leaves more. Frames that are looked at together
# while they are alike, as cells of a noisy skin seem for a second.
_CHANNELS, _CHANCE, _LOW_PASS, _FRAMES = 0.2, 1e-4, 1.3, 1000
_LEAST_STEPS = 3.0  # ADC steps below which the board may take something off
_LEAST_SCATTER = 0.03  # RMS of log resistance of a good fabric's cells at rest, chosen


class OneVoltage:
    """Looks at one skin's seconds of rest.

    Attributes:
        tells: whether the last one says that no matrix is read: its cells read alike, where those
            of a fabric would not. Before the first one nothing says that one is read.
    """

    def __init__(self, circuit: Circuit):
        self.tells = True
        self._circuit, self._cells = circuit, circuit.populated
        self._alike = np.zeros(circuit.shape), 0  # sum and frames of seconds that read alike

    def window(self, mean: np.ndarray, frames: int, noise: float) -> str:
        """What is wrong with a second of rest; empty if its cells differ.

        Args:
            mean: (rows, cols) of so many frames, ADC ratio.
            noise: of a reading [ADC steps].
        """
        if np.count_nonzero(self._cells) == 1:  # there is nothing to compare it with
            self.tells = False
            return ""
        total, count = self._alike
        total, count = total + frames * mean, count + frames
        for seen, n in ((mean, frames), (total / count, count)):
            if self._spread(seen) > self._at_most(noise, n):
                self._alike, self.tells = (np.zeros(mean.shape), 0), False
                return ""
        kept = min(count, _FRAMES)
        self._alike = total * (kept / count), kept
        self.tells = self._fabric_spread(mean) > _CHANNELS
        steps = mean[self._cells].mean() * self._circuit.full_scale
        ask = "is the matrix connected?"
        if steps < _LEAST_STEPS:
            self.tells = True  # whatever presses there first would look like all that there is
            ask = "is an offset or a threshold taken off, or is no matrix connected?"
        return f"rest not measured: all readings are {steps:.1f} ADC steps, within noise: {ask}"

    def _spread(self, mean: np.ndarray) -> float:
        """RMS by which the cells differ [ADC steps]."""
        return float(mean[self._cells].std()) * self._circuit.full_scale

    def _at_most(self, noise: float, frames: int) -> float:
        """The same of readings of one voltage."""
        half = 0.5 * max(np.count_nonzero(self._cells) - 1, 1)
        by_chance = _LOW_PASS * (gammainccinv(half, _CHANCE) / half) ** 0.5
        return max(_CHANNELS, by_chance * noise / frames**0.5)

    def _fabric_spread(self, mean: np.ndarray) -> float:
        """The same of a good fabric that reads so on average: of cells of a megohm it is less than
        what channels differ by."""
        usual = usual_resistance(mean, self._cells, self._circuit)
        if not 0.0 < usual < np.inf:
            return np.inf
        scatter = np.random.default_rng(0).standard_normal(mean.shape)
        return self._spread(forward(self._circuit, usual * np.exp(_LEAST_SCATTER * scatter)))
