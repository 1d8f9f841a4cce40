"""What is likely of a touch before it is read (docs/derivation.md): the prior of `map`.

Works in x = log conductance, in which a relative error of a cell's resistance is a difference.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..learning import denoiser
from ..physics import kernel

# Of the differences x_i - x_j between direct neighbours: their weight, and the spread below which
# they are drawn together. Chosen on bodies of many sizes and textures (tests/yardsticks/prior.py).
_STEP, _SPREAD = 1.0, 0.3
_REST = 1.0, 0.3  # of x - x_rest, one-sided: at rest unless the reading says otherwise


class Differences:
    """Which cells the prior compares: those beside and below one another.

    Attributes:
        weight: (differences,) of each one's cost weight/2 log(spread^2 + d^2), 0 where a cell is
            missing; first those to the right, then downwards.
        here, there: (differences,) int32, flat cells, here < there, that a difference joins.
    """

    def __init__(self, shape: tuple[int, int], cells: np.ndarray | None = None):
        cells = np.ones(shape, bool) if cells is None else cells
        n = np.arange(cells.size, dtype=np.int32).reshape(shape)
        pairs = ((n[:, :-1], n[:, 1:]), (n[:-1], n[1:]))
        self.here, self.there = (np.concatenate([p[k].ravel() for p in pairs]) for k in (0, 1))
        both = cells.ravel()[self.here] & cells.ravel()[self.there]
        self.weight = np.where(both, _STEP, 0.0)


def differences(circuit) -> Differences:
    """Between a circuit's cells; kept, whatever else of the circuit changes."""
    mask = circuit.mask
    return _differences(circuit.shape, None if mask is None else mask.tobytes())


@lru_cache(maxsize=16)
def _differences(shape: tuple[int, int], mask: bytes | None) -> Differences:
    return Differences(shape, None if mask is None else np.frombuffer(mask, bool).reshape(shape))


class Quadratic(NamedTuple):
    """A prior's quadratic majorant at some x; pictures are (rows, cols).

    The precision's entries off the diagonal lie where `Differences` says; None: there are none.
    """

    value: float
    gradient: np.ndarray
    diagonal: np.ndarray
    entries: np.ndarray | None


def touches(x: np.ndarray, x_rest: float, between: Differences) -> Quadratic:
    """Most cells are at rest; neighbours are alike, with sharp edges.

    Each difference d has the cost w/2 log(s^2 + d^2): small ones are drawn together, a large one,
    an edge, costs next to nothing more. Distance from rest costs w log(1 + d/s): its slope at rest
    holds a cell there that noise alone would lift.

    Args:
        x: (rows, cols), of cells that do not exist x_rest.
    """
    value, gradient, diagonal, entries = kernel.roughness(x, between.weight, _SPREAD**2)
    weight, spread = _REST
    above = (x - (x_rest - spread)) / spread
    value += weight * float(np.log(above).sum())
    gradient += (weight / spread) / above
    return Quadratic(value, gradient, diagonal, entries)


def neighbours(x, std, own, unknown, cells) -> Quadratic:
    """What the cells around say of each: a network's answer to a fit (learning/denoiser.py).

    Args:
        x: (rows, cols) log conductance over that at rest; the rest as of `denoiser.inputs`.
    """
    shift, wide = denoiser.shipped()(denoiser.inputs(x, std, own, unknown, cells))
    clipped = np.clip(std, *denoiser.STD)
    rate = np.where(unknown, 1.0 / (clipped * wide), 0.0)
    off = np.where(unknown, -shift / wide, 0.0)
    return Quadratic(0.5 * np.square(off).sum(), off * rate, np.square(rate), None)


def level(force: np.ndarray, slope: np.ndarray, cells: np.ndarray) -> Quadratic:
    """A load on the whole skin: each cell's force is uniform from 0 to one unknown level.

    The level is twice the mean force; a uniform spread has mean / sqrt(3).

    Args:
        slope: d force / d x.
    """
    mean = force[cells].mean()
    return known(force, slope, mean, mean / 3**0.5, cells)


def known(force, slope, mean, std, cells) -> Quadratic:
    """Independent knowledge of each force, mean and std [N]: a network's, say."""
    off = np.where(cells, (force - mean) / std, 0.0)
    rate = np.where(cells, slope / std, 0.0)
    return Quadratic(0.5 * np.square(off).sum(), off * rate, np.square(rate), None)


def add(one: Quadratic, other: Quadratic) -> Quadratic:
    """Both at once, of which at most the first joins cells."""
    value, gradient = one.value + other.value, one.gradient + other.gradient
    return Quadratic(value, gradient, one.diagonal + other.diagonal, one.entries)


def product(terms: Quadratic, x: np.ndarray, between: Differences) -> np.ndarray:
    """The precision times x, (rows, cols)."""
    total = terms.diagonal * x
    if terms.entries is not None:
        for one, other in ((between.here, between.there), (between.there, between.here)):
            joined = np.bincount(one, terms.entries * x.ravel()[other], x.size)
            total += joined.reshape(x.shape)
    return total
