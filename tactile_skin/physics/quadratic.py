"""The quadratic programme of a step: a minimum within bounds, and its spread."""

from __future__ import annotations

import numpy as np
from scipy.linalg import blas, lapack

from . import kernel

_BOX_ROUNDS = 8
_RIDGES = 1e-3, 1e-2, 1e-1, 1.0


def solve_in_box(precision: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray):
    """Minimise 1/2 dx precision dx - b dx within [low, high], by a primal-dual active set method.

    What leaves its bounds is put on that end and the others are solved again, and what would leave
    its end inwards is freed. Clipping alone would leave the others where they would be right
    without the bounds, and the step would often go up. (Hintermueller, Ito and Kunisch, SIAM J.
    Optim. 13, 2002; of hundreds of unknowns 5 to 8 rounds.)

    Args:
        precision: (n, n), upper triangle, float32.

    Returns:
        dx, the Cholesky factor over the unknowns inside (None: there is none), which those are.
    """
    found = kernel.solve_in_box(precision, b, low, high)
    return found or _with_lapack(precision, b, low, high)


def _with_lapack(precision: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray):
    """As `solve_in_box`, of any size and also where the precision has no factor as it is."""
    inside = np.ones(b.size, bool)
    dx = np.zeros(b.size)
    matrix, pull = precision, b
    for rounds in range(_BOX_ROUNDS):
        # Transposed, LAPACK reads it as it lies in memory.
        factor, info = lapack.spotrf(matrix.T, lower=1, clean=0)
        for ridge in _RIDGES if info else ():  # not positive definite to single precision
            matrix = matrix.copy()
            matrix.reshape(-1)[:: matrix.shape[0] + 1] *= 1.0 + ridge
            factor, info = lapack.spotrf(matrix.T, lower=1, clean=0)
            if not info:
                break
        if info:  # not even so: numbers beyond single precision
            return np.zeros(b.size), None, inside
        dx[inside] = lapack.spotrs(factor, pull, lower=1)[0]
        left = _inside_next(precision, b, low, high, dx, inside)
        dx = np.minimum(np.maximum(dx, low), high)
        if not left.any():  # all would be on their ends
            left = _inside_next(precision, b, low, high, dx, left)
        if rounds + 1 == _BOX_ROUNDS or (left == inside).all() or not left.any():
            break
        inside = left
        pull = (b - blas.ssymv(1.0, precision.T, np.where(inside, 0.0, dx), lower=1))[inside]
        kept = np.flatnonzero(inside)
        matrix = precision.take(kept, 0).take(kept, 1)  # upper triangle, as precision's
    return dx, factor.T, inside


def _inside_next(precision, b, low, high, dx, inside) -> np.ndarray:
    """(n,) bool, which are inside then: not those that leave, and those that would leave an end."""
    left = inside & (dx >= low) & (dx <= high)
    if not inside.all():
        pull = b - blas.ssymv(1.0, precision.T, dx, lower=1)
        left |= ~inside & (low < high) & np.where(dx == low, pull > 0.0, pull < 0.0)
    return left


def inverse_diagonal(factor: np.ndarray) -> np.ndarray:
    """Of (U^T U)^-1, U (n, n)."""
    return lapack.spotri(factor.T, lower=1)[0].diagonal()
