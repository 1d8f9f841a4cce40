# SPDX-License-Identifier: Apache-2.0
"""What its neighbours say of a cell, given how well each is known: a small network.

It works on x = log conductance, whatever the skin's size, circuit or curve: all that it sees is
relative to rest or to a standard deviation. `map` takes its answer as a prior (solvers/prior.py).
PyTorch trains it (benchmarks/training/train_prior.py).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from .convolution import convolve, layer_of

SHIPPED = Path(__file__).parent / "weights" / "touches.npz"
INPUTS = 5  # pictures that it is given
OUTPUTS = 2  # shift of x over its standard deviation; log of the share of this that is left
STD = 0.003, 3.0  # ends between which a standard deviation of x makes a difference
OWN = 1e-3, 1e3  # the same of d reading / d x
SHARE = -3.0, 4.0  # ends of log(the answer's standard deviation over the fit's)


def _within(values: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """As np.clip, whose call takes longer than its work here."""
    return np.minimum(np.maximum(values, ends[0]), ends[1])


def inputs(x, std, own, unknown, cells) -> np.ndarray:
    """(5, rows, cols) float32 of one fit, as `Denoiser` takes it."""
    out = np.empty((INPUTS, *x.shape), np.float32)
    out[0] = x / 4.0
    out[1] = unknown
    out[2] = np.where(unknown, np.log(_within(std, STD)) / 2.0 + 1.0, 0.0)
    out[3] = np.log(_within(own, OWN)) / 3.0
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
        self._layers = [layer_of(state[f"{name}.weight"], state[f"{name}.bias"]) for name in names]

    def __call__(self, x, std, own, unknown, cells) -> tuple[np.ndarray, np.ndarray]:
        """Return the likely x of each cell, and its standard deviation, (rows, cols) each.

        Args:
            x: (rows, cols) log conductance over that at rest, as a fit found it.
            std: (rows, cols) standard deviation of x, of the unknowns.
            own: (rows, cols) d reading / d x, in standard deviations of a reading, of each cell's
                own.
            unknown: (rows, cols) bool, cells that the fit was free to move.
            cells: (rows, cols) bool, cells that exist.
        """
        h = convolve(inputs(x, std, own, unknown, cells), self._layers[0])
        np.maximum(h, 0.0, out=h)
        for layer in self._layers[1:-1]:
            more = convolve(h, layer)
            h += np.maximum(more, 0.0, out=more)
        shift, log_share = convolve(h, self._layers[-1])
        std = _within(std, STD)
        return x + shift * std, std * np.exp(_within(log_share, SHARE))


@cache
def shipped() -> Denoiser:
    """Return the network that comes with the package."""
    with np.load(SHIPPED) as arrays:
        return Denoiser(dict(arrays))
