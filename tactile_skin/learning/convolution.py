# SPDX-License-Identifier: Apache-2.0
"""The convolutions of the small networks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_SIDE = 3  # cells of a filter


def layer_of(weight: np.ndarray, bias: np.ndarray) -> npt.NDArray[np.float32]:
    """Return a layer for `convolve`, (outputs, 9 * channels + 1), of PyTorch's arrays.

    Args:
        weight: (outputs, channels, 3, 3).
        bias: (outputs,), which comes last.
    """
    return np.hstack([weight.reshape(len(weight), -1), bias[:, None]]).astype(np.float32)


def convolve(
    picture: npt.NDArray[np.float32], layer: npt.NDArray[np.float32], dilation: int = 1
) -> npt.NDArray[np.float32]:
    """Return a 3x3 convolution, (outputs, rows, cols), of a picture that ends in zeros.

    Args:
        picture: (channels, rows, cols).
        layer: (outputs, 9 * channels + 1), see `layer_of`.
        dilation: cells from one tap to the next.
    """
    channels, rows, cols = picture.shape
    wide = cols + 2 * dilation
    # one row more: the last taps reach past the last cell, and what they see there is cut off
    padded = np.zeros((channels, rows + 2 * dilation + 1, wide), np.float32)
    padded[:, dilation : dilation + rows, dilation : dilation + cols] = picture
    channel, row, cell = padded.strides
    # rows are taken with their margins, as one run: a copy for each tap, not for each row
    shape = channels, _SIDE, _SIDE, rows * wide
    strides = channel, dilation * row, dilation * cell, cell
    taps = np.ndarray(shape, np.float32, padded, 0, strides)  # as_strided takes four times as long
    out = layer[:, :-1] @ taps.reshape(-1, rows * wide)
    out += layer[:, -1:]
    return np.ascontiguousarray(out.reshape(-1, rows, wide)[:, :, :cols])
