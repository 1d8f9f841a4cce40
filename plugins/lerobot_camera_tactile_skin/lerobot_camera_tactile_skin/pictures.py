# SPDX-License-Identifier: Apache-2.0
"""Pressure as pictures that LeRobot can store, and back.

Both kinds leave room for a mark, a picture that no skin can send: it stands where there was none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ZERO = 10  # depth of no pressure: LeRobot's encoder has no depth below 10 mm by default,
TOP = 10_000  # nor above 10 m
KNEE = 100  # steps of pressure up to which grey rises about linearly, and then as a logarithm
FULL = float(np.log1p(TOP / KNEE))
MARKED = 0.5  # of a marked picture's colour that is left after compression, at least
RED = np.array((255, 0, 0), np.uint8)


def _cells(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the mean of each block of (..., height, width): (..., rows, cols)."""
    (rows, cols), (height, width) = shape, picture.shape[-2:]
    if height % rows or width % cols:
        raise ValueError(f"picture of {height} x {width}: must be a multiple of {rows} x {cols}")
    parts = picture.reshape(*picture.shape[:-2], rows, height // rows, cols, width // cols)
    return parts.mean((-3, -1), dtype=float)


@dataclass(frozen=True)
class Depth:
    """16 bits, (height, width, 1): 10 + pressure / step; all 65535 where there is no picture.

    Args:
        step: Pa a step. With LeRobot's defaults video holds 9,990 of them: 99.9 kPa at 10 Pa.
    """

    step: float = 10.0

    def picture(self, pressure: np.ndarray | None, shape: tuple[int, int], pixels: int):
        """Return it of a pressure (rows, cols) [Pa]; None: the mark."""
        values = np.full(shape, 65535.0)
        if pressure is not None:
            values = np.clip(np.rint(pressure / self.step) + ZERO, ZERO, 65534)
        return values.astype(np.uint16).repeat(pixels, 0).repeat(pixels, 1)[..., None]

    def pressure(self, picture, shape: tuple[int, int]) -> np.ndarray:
        """Return (..., rows, cols) [Pa] of (..., 1, height, width) or (..., 1); marked: NaN."""
        values = np.asarray(picture, dtype=float)
        values = values[..., 0] if values.shape[-1] == 1 else values[..., 0, :, :]
        cells = _cells(values, shape)
        marked = (cells >= TOP - KNEE).all((-2, -1), keepdims=True)
        return np.where(marked, np.nan, np.maximum(cells - ZERO, 0.0) * self.step)


@dataclass(frozen=True)
class Rgb:
    """8 bits, (height, width, 3), grey: a logarithm of the pressure; red: there is no picture.

    grey = 255 log(1 + p / 100 steps) / log(1 + 10,000 steps / 100 steps): 1.8 % a grey at most.

    Args:
        step: Pa, as of `Depth`.
    """

    step: float = 10.0

    def picture(self, pressure: np.ndarray | None, shape: tuple[int, int], pixels: int):
        """Return it of a pressure (rows, cols) [Pa]; None: the mark."""
        if pressure is None:
            return np.broadcast_to(RED, (shape[0] * pixels, shape[1] * pixels, 3)).copy()
        grey = 255.0 * np.log1p(np.maximum(pressure, 0.0) / (KNEE * self.step)) / FULL
        values = np.rint(np.minimum(grey, 255.0)).astype(np.uint8)[..., None]
        return values.repeat(pixels, 0).repeat(pixels, 1).repeat(3, 2)

    def pressure(self, picture, shape: tuple[int, int]) -> np.ndarray:
        """Return the same of (..., 3, height, width), 0 to 1, or (..., 3) of bytes."""
        values = np.asarray(picture)
        if values.shape[-1] == 3:
            values = np.moveaxis(values, -1, -3)
        scale = 255.0 if np.issubdtype(values.dtype, np.integer) else 1.0
        red, green, blue = (_cells(values[..., k, :, :] / scale, shape) for k in range(3))
        other = (green + blue) / 2.0
        marked = (red - other > MARKED).all((-2, -1), keepdims=True)
        pressure = KNEE * self.step * np.expm1((red + green + blue) / 3.0 * FULL)
        return np.where(marked, np.nan, pressure)
