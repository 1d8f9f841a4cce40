"""The quadratic programme of a step: a minimum within bounds, and its spread."""

from __future__ import annotations

import numpy as np
from scipy.linalg import blas, lapack

from . import kernel

_BOX_ROUNDS = 4
_RIDGES = 1e-3, 1e-2, 1e-1, 1.0


def solve_in_box(precision: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray):
    """Minimise 1/2 dx precision dx - b dx; what would leave [low, high] is put on its end.

    Clipping alone would leave the others where they would be right without the bounds, and the
    step would often go up.

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
        out = inside & ((dx < low) | (dx > high))
        if rounds + 1 == _BOX_ROUNDS or not out.any() or (out == inside).all():
            break
        inside &= ~out
        dx = np.minimum(np.maximum(dx, low), high)
        pull = (b - blas.ssymv(1.0, precision.T, np.where(inside, 0.0, dx), lower=1))[inside]
        kept = np.flatnonzero(inside)
        matrix = precision.take(kept, 0).take(kept, 1)  # upper triangle, as precision's
    return np.minimum(np.maximum(dx, low), high), factor.T, inside


def inverse_diagonal(factor: np.ndarray) -> np.ndarray:
    """Of (U^T U)^-1, U (n, n)."""
    return lapack.spotri(factor.T, lower=1)[0].diagonal()
