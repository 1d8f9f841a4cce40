"""What is likely of a touch before it is read (docs/derivation.md): the prior of `map`.

Works in x = log conductance, in which a relative error of a cell's resistance is a difference.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..circuit import kernel

# Spread and weight of the two kinds of differences, chosen on 40 scenes of blobs and rects each.
_STEP = 0.5, 0.1  # weight, spread of x_i - x_j between direct neighbours
_TWIST = 1.5, 0.15  # of x_ij - x_i+1,j - x_i,j+1 + x_i+1,j+1, the mixed second difference
_REST = 1.0, 0.3  # of x - x_rest, one-sided: at rest unless the reading says otherwise
_SPREADS = np.array([*_STEP, *_TWIST, *_REST])


class Differences:
    """The differences between cells that the prior looks at: d = matrix @ x, x flat.

    Attributes:
        cells: number of crossings.
        matrix: (differences, cells) sparse; back: its transpose.
        weight, square: (differences,) of each one's cost weight/2 log(square + d^2).
        here, there: (entries,) flat cells, here < there, that some difference joins.
        joined: the same differences as the kernel takes them.
    """

    def __init__(self, shape: tuple[int, int], cells: np.ndarray | None = None):
        self.cells = shape[0] * shape[1]
        number = np.arange(self.cells).reshape(shape)
        upper, lower, left, right = number[:-1], number[1:], number[:, :-1], number[:, 1:]
        corners = upper[:, :-1], upper[:, 1:], lower[:, :-1], lower[:, 1:]
        blocks, weight, square, all_ends = [], [], [], []
        for ends, signs, (w, spread) in (
            ((left, right), (-1.0, 1.0), _STEP),
            ((upper, lower), (-1.0, 1.0), _STEP),
            (corners, (1.0, -1.0, -1.0, 1.0), _TWIST),
        ):
            ends = np.stack([end.ravel() for end in ends], 1)  # (n, 2 or 4)
            if cells is not None:
                ends = ends[cells.ravel()[ends].all(1)]
            all_ends.append(ends)
            values = np.broadcast_to(signs, ends.shape).ravel()
            first = np.arange(ends.shape[0] + 1) * ends.shape[1]
            size = (ends.shape[0], self.cells)
            blocks.append(sparse.csr_array((values, ends.ravel(), first), size))
            weight.append(np.full(ends.shape[0], w))
            square.append(np.full(ends.shape[0], spread**2))
        self.matrix = sparse.csr_array(sparse.vstack(blocks))
        self.back = sparse.csr_array(self.matrix.T)
        self.weight, self.square = np.concatenate(weight), np.concatenate(square)
        pattern = sparse.triu(abs(self.back) @ abs(self.matrix), 1, format="coo")
        number = np.sort(pattern.row.astype(np.int64) * self.cells + pattern.col)
        self.here, self.there = (n.astype(np.int32) for n in np.divmod(number, self.cells))
        entries = self.back[self.here].multiply(self.back[self.there])
        self._to_precision = sparse.csr_array(sparse.vstack([self.back.power(2), entries]))
        self.joined = []
        for ends in (np.concatenate(all_ends[:2]), all_ends[2]):
            first, second = np.triu_indices(ends.shape[1], 1)
            pair = ends[:, first] * self.cells + ends[:, second]
            at = np.searchsorted(number, pair)
            self.joined += [np.ascontiguousarray(ends, np.int32), at.astype(np.int32)]

    def precision(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of matrix^T diag(w) matrix the diagonal (cells,) and what lies between here and there."""
        both = self._to_precision @ w
        return both[: self.cells], both[self.cells :]


@lru_cache(maxsize=16)
def differences(circuit) -> Differences:
    """Between a circuit's cells."""
    return Differences(circuit.shape, circuit.mask)


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
    if kernel:
        gradient, diagonal = np.empty(x.shape), np.empty(x.shape)
        entries = np.empty(between.here.size)
        value = kernel.touches(
            np.ascontiguousarray(x), x_rest, *between.joined, _SPREADS, gradient, diagonal, entries
        )
        return Quadratic(value, gradient, diagonal, entries)
    d = between.matrix @ x.ravel()
    square = d * d
    square += between.square
    w = between.weight / square
    weight, spread = _REST
    above = (x - (x_rest - spread)) / spread
    value = 0.5 * (between.weight @ np.log(square)) + weight * np.log(above).sum()
    gradient = (weight / spread) / above
    gradient += (between.back @ (w * d)).reshape(x.shape)
    diagonal, entries = between.precision(w)
    return Quadratic(float(value), gradient, diagonal.reshape(x.shape), entries)


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
