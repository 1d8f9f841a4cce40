"""What is likely of a cell, given its neighbours and how well each is known: a small network.

It works on x = log conductance, whatever the skin's size, circuit or curve: convolutions only, and
all that it is told is relative to rest or to the cell's own standard deviation. `map` takes its
answer as a prior (solvers/prior.py). PyTorch trains it (denoiser_training.py); here the pass is four
products of matrices.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


SHIPPED = Path(__file__).parent / "weights" / "touches.npz"
INPUTS, OUTPUTS = 5, 2
# Ends between which a standard deviation of x, and that of a cell's own reading, are told apart.
STD, OWN = (0.003, 3.0), (1e-3, 1e3)
MOST_NARROWED, MOST_WIDENED = -3.0, 4.0  # logarithms of the answer's std over the cell's own


def inputs(x, std, own, unknown, cells) -> np.ndarray:
    """(5, rows, cols) float32 of one fit.

    Args:
        x: (rows, cols) log conductance over that at rest.
        std: (rows, cols) standard deviation of x that the fit found, of the unknowns.
        own: (rows, cols) d reading / d x, in standard deviations of a reading, of each cell's own.
        unknown: (rows, cols) bool, cells that the fit was free to move.
        cells: (rows, cols) bool, cells that exist.
    """
    out = np.empty((INPUTS, *x.shape), np.float32)
    out[0] = x / 4.0
    out[1] = unknown
    out[2] = np.where(unknown, np.log(np.clip(std, *STD)) / 2.0 + 1.0, 0.0)
    out[3] = np.log(np.clip(own, *OWN)) / 3.0
    out[4] = cells
    out *= cells
    return out


class Denoiser:
    """A trained network: 3x3 convolutions, the inner ones adding to what they see.

    Args:
        state: "in.weight" (n, 5, 3, 3), "inner.K.weight" (n, n, 3, 3), "out.weight" (2, n, 3, 3),
            and a ".bias" of each.
    """

    def __init__(self, state: dict[str, np.ndarray]):
        names = [name[: -len(".weight")] for name in state if name.endswith(".weight")]
        self._layers = [_flat(state[f"{n}.weight"], state[f"{n}.bias"]) for n in names]

    def __call__(self, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From `inputs` to the likely x and its standard deviation (rows, cols).

        Returns:
            the distance of the likely x from the fit's, and its standard deviation, both in units
            of the fit's standard deviation.
        """
        h = np.maximum(_convolve(self._layers[0], picture), 0.0)
        for layer in self._layers[1:-1]:
            h += np.maximum(_convolve(layer, h), 0.0)
        shift, log_std = _convolve(self._layers[-1], h)
        return shift, np.exp(np.clip(log_std, MOST_NARROWED, MOST_WIDENED))


def _flat(weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """(out, 9 * in + 1), the bias last."""
    return np.hstack([weight.reshape(len(weight), -1), bias[:, None]]).astype(np.float32)


def _convolve(layer: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """(out, rows, cols) of a zero-padded picture (in, rows, cols)."""
    channels, rows, cols = picture.shape
    padded = np.zeros((channels, rows + 2, cols + 2), np.float32)
    padded[:, 1:-1, 1:-1] = picture
    columns = np.ones((9 * channels + 1, rows * cols), np.float32)
    windows = sliding_window_view(padded, (rows, cols), (1, 2))  # (in, 3, 3, rows, cols)
    columns[:-1].reshape(channels, 3, 3, rows, cols)[...] = windows
    return (layer @ columns).reshape(-1, rows, cols)


@cache
def shipped() -> Denoiser:
    """The network that comes with the package."""
    with np.load(SHIPPED) as arrays:
        return Denoiser(dict(arrays))
