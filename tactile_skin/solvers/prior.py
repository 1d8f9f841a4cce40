"""What is likely of a touch before it is read (docs/derivation.md): the prior of `map`.

Works in x = log conductance, in which a relative error of a cell's resistance is a difference.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Spread and weight of the two kinds of differences, chosen on 40 scenes of blobs and rects each.
_STEP = 0.5, 0.1  # weight, spread of x_i - x_j between direct neighbours
_TWIST = 1.5, 0.15  # of x_ij - x_i+1,j - x_i,j+1 + x_i+1,j+1, the mixed second difference
_REST = 1.0, 0.3  # of x - x_rest, one-sided: at rest unless the reading says otherwise


class Quadratic(NamedTuple):
    """A prior's quadratic majorant at some x: value, gradient (rows, cols) and sparse precision.

    `precision` maps an offset (down, right) to the (rows, cols) entry between a cell and the one
    at that offset, 0 where there is none; (0, 0) is the diagonal. The rest follows by symmetry.
    """

    value: float
    gradient: np.ndarray
    precision: dict[tuple[int, int], np.ndarray]


def touches(x: np.ndarray, x_rest: float, cells: np.ndarray) -> Quadratic:
    """Most cells are at rest; touched patches are flat or separable, with sharp edges.

    Each difference d has the cost w/2 log(s^2 + d^2): small ones are drawn together, a large one,
    an edge, costs next to nothing more. Direct differences favour constant patches. The mixed
    second difference vanishes for every footprint that is a product of a function of the row and
    one of the column. Distance from rest costs w log(1 + d/s): its slope at rest holds a cell
    there that noise alone would lift.
    """
    shape = x.shape
    gradient = np.zeros(shape)
    diagonal = np.zeros(shape)
    right, down, across, back = (np.zeros(shape) for _ in range(4))

    both = cells[:, :-1] & cells[:, 1:]
    value, w, slope = _cost(x[:, 1:] - x[:, :-1], *_STEP, both)
    gradient[:, 1:] += slope
    gradient[:, :-1] -= slope
    diagonal[:, 1:] += w
    diagonal[:, :-1] += w
    right[:, :-1] -= w

    both = cells[:-1] & cells[1:]
    more, w, slope = _cost(x[1:] - x[:-1], *_STEP, both)
    value += more
    gradient[1:] += slope
    gradient[:-1] -= slope
    diagonal[1:] += w
    diagonal[:-1] += w
    down[:-1] -= w

    four = both[:, :-1] & both[:, 1:]
    more, w, slope = _cost(x[1:, 1:] - x[:-1, 1:] - x[1:, :-1] + x[:-1, :-1], *_TWIST, four)
    value += more
    for rows, cols, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
        corner = _shifted(rows, cols, shape)
        gradient[corner] += sign * slope
        diagonal[corner] += w
    for rows in (0, 1):
        right[_shifted(rows, 0, shape)] -= w
    for cols in (0, 1):
        down[_shifted(0, cols, shape)] -= w
    across[:-1, :-1] += w
    back[:-1, 1:] += w

    weight, spread = _REST
    above = np.where(cells, x - x_rest + spread, spread)
    value += weight * np.log(above / spread).sum()
    gradient += np.where(cells, weight / above, 0.0)
    return Quadratic(
        value,
        gradient,
        {(0, 0): diagonal, (0, 1): right, (1, 0): down, (1, 1): across, (1, -1): back},
    )


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
    return Quadratic(0.5 * np.square(off).sum(), off * rate, {(0, 0): np.square(rate)})


def add(one: Quadratic, other: Quadratic) -> Quadratic:
    precision = dict(one.precision)
    for offset, entry in other.precision.items():
        precision[offset] = precision.get(offset, 0.0) + entry
    return Quadratic(one.value + other.value, one.gradient + other.gradient, precision)


def product(terms: Quadratic, x: np.ndarray) -> np.ndarray:
    """The precision times x, (rows, cols)."""
    flat = x.ravel()
    total = np.zeros(flat.size)
    for (down, right), entry in terms.precision.items():
        apart = down * x.shape[1] + right
        n = flat.size - apart
        values = entry.ravel()[:n]
        total[:n] += values * flat[apart:]
        if apart:
            total[apart:] += values * flat[:n]
    return total.reshape(x.shape)


def _cost(d, weight, spread, present):
    """Summed cost, its curvature as a majorant, and its slope, of differences d."""
    square = d * d + spread**2
    w = np.where(present, weight / square, 0.0)
    return 0.5 * weight * np.log(square, where=present, out=np.zeros_like(d)).sum(), w, w * d


def _shifted(rows, cols, shape):
    return slice(rows, shape[0] - 1 + rows), slice(cols, shape[1] - 1 + cols)
