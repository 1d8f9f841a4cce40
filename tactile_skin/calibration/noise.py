"""How much each reading varies by itself, measured while nothing touches the skin."""

from __future__ import annotations

import numpy as np

from ..findings.finding import Finding, Kind

_JUDGED = 10  # frames after which the result is taken anew
_FRAMES = 30  # at rest before the noise counts
_FORGET = 1.0 / 500.0  # share of a measurement that each frame renews, once it is made
_FOLLOW = 1.0 / 30.0  # the same of the mean, from which a reading's noise counts
_PAUSE = 0.5  # s after a touch: the fabric recovers
_CLIP = 5.0  # standard deviations beyond which a change is no noise
_NOISY = 4.0  # times the skin's noise that a noisy cell's is, and
_LEAST = 2.0  # ADC steps at least
_MOST = 0.05  # of the cells may be noisy; if more are, the noise is the skin's


class Noise:
    """Noise of one skin's readings.

    Attributes:
        rms: of a usual reading [ADC steps]; None: not measured yet.
        noisy: (rows, cols) bool, cells whose readings have much more.
    """

    def __init__(self, cells: np.ndarray):
        """Args:
        cells: (rows, cols) bool, those that exist.
        """
        self._cells = cells
        self._rests_from = -np.inf  # s
        self._frames = 0  # at rest
        self._since = 0  # of these, since the last touch: the fabric may rest elsewhere
        self._mean = np.zeros(cells.shape)  # ADC steps
        self._square = np.zeros(cells.shape)  # ADC steps squared
        self.rms: float | None = None
        self.noisy = np.zeros(cells.shape, bool)

    def frame(self, t: float, steps: np.ndarray, touched: bool) -> None:
        """Take a frame.

        Args:
            t: when it was read [s].
            steps: (rows, cols) reading [ADC steps]; NaN where there is none.
            touched: whether anything touches the skin.
        """
        if touched or t < self._rests_from - _PAUSE:
            self._rests_from, self._since = t + _PAUSE, 0
        if t < self._rests_from:
            return
        steps = np.nan_to_num(steps)
        # Not from one frame to the next: a board's low-pass makes these alike.
        self._since += 1
        off = steps - self._mean
        weight = max(1.0 / self._since, _FOLLOW)
        self._mean += weight * off
        if self._since == 1:
            return
        self._frames += 1
        count = self._frames
        square = np.square(off) * (1.0 - weight)
        if self.rms is not None:
            square = np.minimum(
                square, np.square(_CLIP * np.maximum(np.sqrt(self._square), self.rms))
            )
        self._square += max(1.0 / count, _FORGET) * (square - self._square)
        if count >= _FRAMES and count % _JUDGED == 0:
            self._judge()

    def _judge(self) -> None:
        # a reading that never moves is below a threshold of the board, or averaged away
        known = self._cells & (self._square > 0.0)
        if 2 * np.count_nonzero(known) < np.count_nonzero(self._cells):
            return
        self.rms = float(np.sqrt(np.median(self._square[known])))
        level = max(_NOISY * self.rms, _LEAST)
        noisy = known & (self._square > level**2)
        few = np.count_nonzero(noisy) <= max(1, _MOST * np.count_nonzero(self._cells))
        self.noisy = noisy if few else np.zeros(noisy.shape, bool)

    @property
    def each(self) -> float | np.ndarray | None:
        """Of each reading [ADC steps]; a number unless cells are noisy, None: not measured yet."""
        if self.rms is None or not self.noisy.any():
            return self.rms
        return np.where(self.noisy, np.sqrt(self._square), self.rms)

    def findings(self) -> list[Finding]:
        """Return which cells are noisy."""
        rows, cols = (tuple(k.tolist()) for k in np.nonzero(self.noisy))
        return [Finding(Kind.NOISY, "live", rows=rows, cols=cols)] if rows else []
