# SPDX-License-Identifier: Apache-2.0
"""Known totals explained by what each cell says: slopes that all cells share, and a gain for each.

A total is linear in both. The cells' gains are taken for independent of one another, of a scatter
that is found; whatever else makes a total miss, for noise. What the totals do not tell of a cell's
gain leaves it at 1 (docs/derivation.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

# The slope of each ramp over that of the one before is 1 to within a step; how far the cells' gains
# scatter; relative noise of a total besides. What is tried, and the most probable taken.
_STEPS = 0.03, 0.06, 0.12, 0.25, 0.5
_SCATTERS = 0.02, 0.04, 0.08, 0.16, 0.32
_NOISES = 0.005, 0.01, 0.02, 0.04, 0.08
_USUAL_SCATTER = 0.1
_USUAL_NOISE = 0.012
_SPREAD = 0.7  # standard deviation of the logarithm of both
_PROBABLE = 2.0  # logarithm of a probability below the largest, down to which a fit may be true
_LEVEL = 0.5  # standard deviation of the first slope over the median level
LEAST = 0.02  # times the usual one that a slope and a total have at least: both are above 0
_LEAST_GAIN = 0.2  # of a cell that conducts at all


class Totals(NamedTuple):
    """What the cells say of each total, by which it is divided.

    Attributes:
        data: (n, k) how far the cells rise along each ramp, summed: times the slopes it is to be 1.
        shares: (n, cells) that each cell has in it.
        kernel: (n, n) covariance of what the gains add to two of them, of a scatter of 1.
    """

    data: np.ndarray
    shares: np.ndarray
    kernel: np.ndarray

    @classmethod
    def of(cls, ramps: np.ndarray, total: np.ndarray, slope: np.ndarray | None = None) -> Totals:
        """Return the sums over frames of known total force.

        Args:
            ramps: (n, rows, cols, k) [S] how far each cell rises along each ramp.
            total: (n,) [N].
            slope: (k,) of the ramps [N/S], as far as they are known; None: all alike.
        """
        data = ramps.sum((1, 2)) / total[:, None]
        if slope is None:
            slope = np.full(data.shape[1], _level(data))
        shares = (ramps @ slope).reshape(len(ramps), -1) / total[:, None]
        if shares.shape[1] == 1:  # a single cell's gain is the curve's level
            shares = np.zeros_like(shares)
        return cls(data, shares, shares @ shares.T)

    def only(self, used: np.ndarray) -> Totals:
        """Those that are used (n,) bool."""
        return Totals(self.data[used], self.shares[used], self.kernel[np.ix_(used, used)])

    def explained(self) -> Fit:
        """By the most probable step, scatter and noise."""
        return max(self._tried(), key=lambda fit: fit.evidence)

    def probable(self) -> list[Fit]:
        """By all steps, scatters and noises that may be true: few totals hardly determine them."""
        tried = list(self._tried())
        least = max(fit.evidence for fit in tried) - _PROBABLE
        return [fit for fit in tried if fit.evidence >= least]

    def stiff(self) -> Fit:
        """Bent to no single total."""
        return self.solve(_NOISES[-1], _SCATTERS[-1], _STEPS[0])

    def solve(self, noise: float, scatter: float, step: float) -> Fit:
        """Nonnegative least squares, of totals that err together as their cells do."""
        return next(self._fits(noise, scatter, (step,)))

    def _tried(self) -> Iterator[Fit]:
        for noise in _NOISES:
            for scatter in _SCATTERS:
                yield from self._fits(noise, scatter, _STEPS)

    def _fits(self, noise: float, scatter: float, steps: tuple[float, ...]) -> Iterator[Fit]:
        """Yield what `solve` returns for each step; they share the totals' covariance."""
        from scipy.optimize import nnls  # here: it takes 0.2 s, and a running skin does without

        (n, k), data = self.data.shape, self.data
        covariance = noise**2 * np.eye(n) + scatter**2 * self.kernel
        factor = cho_factor(covariance, lower=True)
        level = _level(data)
        white = solve_triangular(factor[0], np.column_stack([data * level, np.ones(n)]), lower=True)
        between, first = np.diff(np.eye(k), axis=0), np.eye(1, k) / _LEVEL
        goal = np.concatenate([white[:, k], np.zeros(k - 1), [1.0 / _LEVEL]])
        least = np.full(k, LEAST)
        half_log_det = np.log(factor[0].diagonal()).sum()
        for step in steps:
            root = np.vstack([white[:, :k], between / step, first])  # of slopes over the level
            slope, left = nnls(root, goal - root @ least)
            slope = level * (least + slope)
            log_det = np.linalg.slogdet(root.T @ root)[1]
            evidence = -0.5 * (left**2 + log_det) - (k - 1) * np.log(step)
            evidence -= half_log_det
            evidence -= 0.5 * (np.log(noise / _USUAL_NOISE) / _SPREAD) ** 2
            evidence -= 0.5 * (np.log(scatter / _USUAL_SCATTER) / _SPREAD) ** 2
            left_over = cho_solve(factor, 1.0 - data @ slope)
            yield Fit(self, slope, root / level, factor, left_over, evidence, noise, scatter, step)


class Fit(NamedTuple):
    """Slopes and gains that explain the totals.

    Attributes:
        slope: (k,) of the ramps [N/S].
        root: (n + k, k) whose square is the slopes' precision.
        factor: Cholesky's, of the totals' covariance.
        left: (n,) what the slopes leave of the totals, weighed by the covariance's inverse.
        evidence: log probability of the totals, but for a constant.
        noise, scatter, step: with which they were found.
    """

    totals: Totals
    slope: np.ndarray
    root: np.ndarray
    factor: tuple
    left: np.ndarray
    evidence: float
    noise: float
    scatter: float
    step: float

    @property
    def gain(self) -> np.ndarray:
        """(cells,) of each cell, of which the usual one has 1."""
        added = self.scatter**2 * self.totals.shares.T @ self.left
        return np.maximum(1.0 + added, _LEAST_GAIN)

    def of(self, new: Totals) -> np.ndarray:
        """(m,) what other objects weigh, over the weight that they are given."""
        by_gain = self.scatter**2 * (new.shares @ self.totals.shares.T) @ self.left
        return new.data @ self.slope + by_gain

    def std(self, new: Totals) -> float:
        """Of the mean of the same."""
        shares, data = new.shares.mean(0), new.data.mean(0)
        common = self.scatter**2 * (self.totals.shares @ shares)
        weighed = cho_solve(self.factor, common)
        by_slope = np.linalg.lstsq(self.root.T, data - weighed @ self.totals.data, rcond=None)[0]
        by_gain = self.scatter**2 * (shares @ shares) - common @ weighed
        return float(np.sqrt(self.noise**2 + max(by_gain, 0.0) + by_slope @ by_slope))


def _level(data: np.ndarray) -> float:
    """Of all slopes, if they were alike."""
    return float(np.median(1.0 / data.sum(1)))
