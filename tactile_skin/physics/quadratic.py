# SPDX-License-Identifier: Apache-2.0
"""Quadratic programmes: a minimum within bounds, its spread, and what a sharp cost is near."""

from __future__ import annotations

import numpy as np
from scipy.linalg import blas, lapack

from . import compiled
from .arrays import Bools, Floats, Floats32

_BOX_ROUNDS = 8
_ROUNDED = 1e-6  # of the largest pull, below which single precision leaves none
_RIDGES = 1e-3, 1e-2, 1e-1, 1.0


def solve_in_box(
    precision: Floats32, b: Floats, low: Floats, high: Floats
) -> tuple[Floats, bool, Bools]:
    """Minimise 1/2 dx precision dx - b dx within [low, high], by a primal-dual active set method.

    What leaves its bounds is put on that end and the others are solved again, and what would leave
    its end inwards is freed. Clipping alone would leave the others where they would be right
    without the bounds, and the step would often go up. (Hintermueller, Ito and Kunisch, SIAM J.
    Optim. 13, 2002; of hundreds of unknowns 5 to 8 rounds.)

    Args:
        precision: (n, n), upper triangle.

    Returns:
        dx, whether there is one, which unknowns are inside.
    """
    if (found := compiled.solve_in_box(precision, b, low, high)) is not None:
        return found
    inside = base = np.ones(b.size, bool)  # base: what the factor is over
    factor, dx, kept = None, np.zeros(b.size), np.arange(b.size)
    for rounds in range(_BOX_ROUNDS):
        (held,) = (~inside[kept]).nonzero()
        again = factor is None or (inside & ~base).any() or 4 * held.size > kept.size
        factor = factor_over(precision, inside) if again else factor
        if factor is None:
            return np.zeros(b.size), False, inside
        if again or rounds == 0:
            base, held, (kept,) = inside, held[:0], inside.nonzero()
            pull = b - blas.ssymv(1.0, precision.T, np.where(base, 0.0, dx), lower=1)
            half = blas.strsv(factor.T, pull[kept], lower=1)
        right, ends = half, dx[kept[held]]
        if held.size:  # what holds them moves the others: cheaper than another factor
            unit = np.zeros((held.size, kept.size), np.float32)
            unit[np.arange(held.size), held] = 1.0
            moved = lapack.strtrs(factor.T, unit.T, lower=1, overwrite_b=1)[0]
            right = half + moved @ lapack.sposv(moved.T @ moved, ends - half @ moved)[1]
        dx[kept] = blas.strsv(factor.T, right, lower=1, trans=1)
        dx[kept[held]] = ends
        left = _inside_next(precision, b, low, high, dx, inside)
        dx = np.minimum(np.maximum(dx, low), high)
        if not left.any():  # all would be on their ends
            left = _inside_next(precision, b, low, high, dx, left)
        if rounds + 1 == _BOX_ROUNDS or (left == inside).all() or not left.any():
            break
        inside = left
    return dx, True, inside


def factor_over(precision: Floats32, inside: Bools) -> Floats32 | None:
    """Return U of U^T U = precision (n, n) over some of its unknowns; None: there is none."""
    matrix, (kept,) = precision, inside.nonzero()
    if kept.size < inside.size:
        matrix = precision.take(kept, 0).take(kept, 1)  # upper triangle, as precision's
    # Transposed, LAPACK reads it as it lies in memory.
    factor, info = lapack.spotrf(matrix.T, lower=1, clean=0)
    for ridge in _RIDGES if info else ():  # not positive definite to single precision
        matrix = matrix.copy()
        matrix.reshape(-1)[:: len(matrix) + 1] *= 1.0 + ridge
        factor, info = lapack.spotrf(matrix.T, lower=1, clean=0)
        if not info:
            break
    return None if info else factor.T  # None: numbers beyond single precision


def _inside_next(
    precision: Floats32, b: Floats, low: Floats, high: Floats, dx: Floats, inside: Bools
) -> Bools:
    """(n,) which are inside then: not those that leave, and those that would leave an end."""
    left = inside & (dx >= low) & (dx <= high)
    if not inside.all():
        pull = b - blas.ssymv(1.0, precision.T, dx, lower=1)
        inwards = np.where(dx == low, pull, -pull)
        left |= ~inside & (low < high) & (inwards > _ROUNDED * np.abs(b).max())
    return left


def inverse(precision: Floats32, inside: Bools) -> Floats32:
    """Return the inverse of a precision over some of its unknowns, upper triangle of both."""
    if (found := compiled.inverse(precision, inside.nonzero()[0].astype(np.int32))) is not None:
        return found
    if (factor := factor_over(precision, inside)) is None:
        return np.diag(1.0 / precision.diagonal()[inside])
    lower: Floats32 = lapack.spotri(factor.T, lower=1)[0]
    return lower.T


def roughness(x: Floats, weight: Floats, square: float) -> tuple[float, Floats, Floats, Floats]:
    """Sum weight/2 log(square + d^2) over all differences d between neighbouring cells.

    Args:
        x: (rows, cols).
        weight: (differences,) of each d between neighbours in a row, then in a column.

    Returns:
        the cost, and its quadratic majorant: gradient and diagonal of the precision (rows, cols),
        entries off it, of each difference.
    """
    rows, cols = x.shape
    split, d = rows * (cols - 1), np.empty(weight.size)

    def parts(values: Floats) -> tuple[Floats, Floats]:
        return values[:split].reshape(rows, -1), values[split:].reshape(-1, cols)

    right, down = parts(d)
    np.subtract(x[:, 1:], x[:, :-1], out=right)
    np.subtract(x[1:], x[:-1], out=down)
    squares = d * d
    squares += square
    cost = 0.5 * float(weight @ np.log(squares))
    curvature = weight / squares
    d *= curvature  # in right and down
    gradient, diagonal = np.zeros(x.shape), np.zeros(x.shape)
    gradient[:, 1:] = right
    gradient[:, :-1] -= right
    gradient[1:] += down
    gradient[:-1] -= down
    right, down = parts(curvature)
    diagonal[:, 1:] = right
    diagonal[:, :-1] += right
    diagonal[1:] += down
    diagonal[:-1] += down
    return cost, gradient, diagonal, -curvature
