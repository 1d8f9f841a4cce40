# SPDX-License-Identifier: Apache-2.0
"""The mat that simulated people touch, and how unevenly skin and cloth press on it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FINE = 3  # points a cell along each axis, over which pressure is averaged
_TEXTURE = 0.02  # m over which the pressure of skin and cloth varies


class Mat(NamedTuple):
    """The mat that is touched."""

    rows: int
    cols: int
    pitch: float  # [m]

    @property
    def size(self) -> np.ndarray:
        """(2,) width and height [m]."""
        return np.array([self.cols, self.rows]) * self.pitch

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (1, cols * FINE) and (rows * FINE, 1), places of the points [m]."""
        x = (np.arange(self.cols * FINE) + 0.5) * self.pitch / FINE
        y = (np.arange(self.rows * FINE) + 0.5) * self.pitch / FINE
        return x[None], y[:, None]

    def around(self, at: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the points seen from `at` (2,), turned by an angle [rad]: along, across [m]."""
        x, y = self.points()
        dx, dy = x - at[0], y - at[1]
        sin, cos = np.sin(angle), np.cos(angle)
        return cos * dx + sin * dy, -sin * dx + cos * dy

    def noise(self, grain: float, rng: np.random.Generator) -> np.ndarray:
        """Return (rows * FINE, cols * FINE) noise that varies over a length [m]."""
        from scipy.ndimage import gaussian_filter  # here: most simulated boards feel no hands

        white = rng.standard_normal((self.rows * FINE, self.cols * FINE))
        return gaussian_filter(white, grain / self.pitch * FINE)

    def cells(self, picture: np.ndarray) -> np.ndarray:
        """Return (rows, cols) sums over the points of each cell."""
        return picture.reshape(self.rows, FINE, self.cols, FINE).sum((1, 3))


def texture(mat: Mat, rough: float, rng: np.random.Generator) -> np.ndarray:
    """Return (rows * FINE, cols * FINE) factors of the pressure, of mean 1 and std `rough`."""
    smooth = mat.noise(_TEXTURE, rng)
    return np.clip(1.0 + rough * smooth / smooth.std(), 0.1, None)
