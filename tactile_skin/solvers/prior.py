"""What is likely of a touch before it is read (docs/derivation.md): the prior of `map`.

Works in x = log conductance, in which a relative error of a cell's resistance is a difference.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..physics import kernel

# Spread and weight of the two kinds of differences, chosen on 40 scenes of blobs and rects each.
_STEP = 0.5, 0.1  # weight, spread of x_i - x_j between direct neighbours
_TWIST = 1.5, 0.15  # of x_ij - x_i+1,j - x_i,j+1 + x_i+1,j+1, the mixed second difference
_REST = 1.0, 0.3  # of x - x_rest, one-sided: at rest unless the reading says otherwise


class Differences:
    """Which cells the prior compares: those beside and below one another, and squares of four.

    Attributes:
        weight, square: (differences,) of each one's cost weight/2 log(square + d^2), the weight 0
            where a cell is missing; first those to the right, then downwards, then of squares.
        here, there: (entries,) int32, flat cells, here < there, that a difference joins: to the
            right, downwards, and along both diagonals.
    """

    def __init__(self, shape: tuple[int, int], cells: np.ndarray | None = None):
        cells = np.ones(shape, bool) if cells is None else cells
        right, down = cells[:, 1:] & cells[:, :-1], cells[1:] & cells[:-1]
        kinds = (right, _STEP), (down, _STEP), (right[1:] & right[:-1], _TWIST)
        self.weight = np.concatenate([w * there.ravel() for there, (w, _) in kinds])
        self.square = np.concatenate([np.full(there.size, s**2) for there, (_, s) in kinds])
        n = np.arange(cells.size, dtype=np.int32).reshape(shape)
        pairs = (
            (n[:, :-1], n[:, 1:]),
            (n[:-1], n[1:]),
            (n[:-1, :-1], n[1:, 1:]),
            (n[:-1, 1:], n[1:, :-1]),
        )
        self.here, self.there = (np.concatenate([p[k].ravel() for p in pairs]) for k in (0, 1))


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
    """Most cells are at rest; touched patches are flat or separable, with sharp edges.

    Each difference d has the cost w/2 log(s^2 + d^2): small ones are drawn together, a large one,
    an edge, costs next to nothing more. Direct differences favour constant patches. The mixed
    second difference vanishes for every footprint that is a product of a function of the row and
    one of the column. Distance from rest costs w log(1 + d/s): its slope at rest holds a cell
    there that noise alone would lift.

    Args:
        x: (rows, cols), of cells that do not exist x_rest.
    """
    value, gradient, diagonal, entries = kernel.roughness(x, between.weight, between.square)
    weight, spread = _REST
    above = (x - (x_rest - spread)) / spread
    value += weight * float(np.log(above).sum())
    gradient += (weight / spread) / above
    return Quadratic(value, gradient, diagonal, entries)


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
