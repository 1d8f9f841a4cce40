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


def touches(x: np.ndarray, x_rest: float, cells: np.ndarray | None) -> Quadratic:
    """Most cells are at rest; touched patches are flat or separable, with sharp edges.

    Each difference d has the cost w/2 log(s^2 + d^2): small ones are drawn together, a large one,
    an edge, costs next to nothing more. Direct differences favour constant patches. The mixed
    second difference vanishes for every footprint that is a product of a function of the row and
    one of the column. Distance from rest costs w log(1 + d/s): its slope at rest holds a cell
    there that noise alone would lift.

    Args:
        cells: (rows, cols) bool, which exist; None: all of them.
    """
    beside, below, all_four = None, None, None
    if cells is not None:
        x = np.where(cells, x, x_rest)
        beside, below = cells[:, :-1] & cells[:, 1:], cells[:-1] & cells[1:]
        all_four = below[:, :-1] & below[:, 1:]
    across = x[:, 1:] - x[:, :-1]
    down = x[1:] - x[:-1]
    value_a, w_a, slope_a = _cost(across, *_STEP, beside)
    value_d, w_d, slope_d = _cost(down, *_STEP, below)
    value_t, w_t, slope_t = _cost(down[:, 1:] - down[:, :-1], *_TWIST, all_four)

    weight, spread = _REST
    above = x - (x_rest - spread)
    value = value_a + value_d + value_t + weight * np.log(above / spread).sum()
    gradient = weight / above
    slope_d[:, 1:] += slope_t  # the twist is the difference of two vertical differences
    slope_d[:, :-1] -= slope_t
    gradient[:, 1:] += slope_a
    gradient[:, :-1] -= slope_a
    gradient[1:] += slope_d
    gradient[:-1] -= slope_d

    diagonal, right, lower, lower_right, lower_left = np.zeros((5, *x.shape))
    diagonal[:, 1:] = w_a
    diagonal[:, :-1] += w_a
    diagonal[1:] += w_d
    diagonal[:-1] += w_d
    right[:, :-1] = -w_a
    right[:-1, :-1] -= w_t
    right[1:, :-1] -= w_t
    lower[:-1] = -w_d
    lower[:-1, :-1] -= w_t
    lower[:-1, 1:] -= w_t
    lower_right[:-1, :-1] = w_t
    lower_left[:-1, 1:] = w_t
    for corner in (diagonal[:-1, :-1], diagonal[:-1, 1:], diagonal[1:, :-1], diagonal[1:, 1:]):
        corner += w_t
    if cells is not None:
        gradient *= cells
    return Quadratic(
        float(value),
        gradient,
        {
            (0, 0): diagonal,
            (0, 1): right,
            (1, 0): lower,
            (1, 1): lower_right,
            (1, -1): lower_left,
        },
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
    square = d * d
    square += spread**2
    if present is not None:
        square = np.where(present, square, 1.0)
    w = weight / square
    if present is not None:
        w *= present
    return 0.5 * weight * np.log(square).sum(), w, w * d
