"""The network of one frame as one matrix, and what the solvers need of it (docs/derivation.md).

K, (lines, lines) with lines = rows + cols, is a positive definite generalised inverse of the
Laplacian: rho_ij = (e_i - e_j)^T K (e_i - e_j), for row line i and column line rows + j.
"""

from __future__ import annotations

import numpy as np

from ..circuit import network_inverse


def inverse(g: np.ndarray) -> np.ndarray:
    """K [ohm], (lines, lines), of conductances g (rows, cols) [S]."""
    a, c, d = network_inverse(g)
    rows = a.shape[0]
    k = np.empty((rows + d.shape[0],) * 2)
    k[:rows, :rows], k[:rows, rows:], k[rows:, :rows], k[rows:, rows:] = a, c, c.T, d
    return k


def two_point(k: np.ndarray, rows: int) -> np.ndarray:
    """(e_i - e_j)^T K (e_i - e_j) for each crossing, (rows, cols); for `inverse` this is rho."""
    diagonal = k.diagonal()
    return diagonal[:rows, None] + diagonal[rows:] - 2.0 * k[:rows, rows:]


def crossing_factor(k: np.ndarray, rows: int) -> np.ndarray:
    """V (rows * cols, lines) with t_ab = v_a . v_b: the transfer resistance of two crossings."""
    factor = np.linalg.cholesky(k).astype(np.float32)
    lines = k.shape[0]
    return (factor[:rows, None] - factor[None, rows:]).reshape(-1, lines)


def hessian_product(k: np.ndarray, p: np.ndarray) -> np.ndarray:
    """sum_b t_ab^2 p_b (rows, cols), in O(lines^3): it is K L(p) K between a's two lines.

    L(p) is the Laplacian of a network with conductances p, (rows, cols), of either sign.
    """
    rows = p.shape[0]
    weighted = np.concatenate(
        [
            p.sum(1)[:, None] * k[:rows] - p @ k[rows:],
            p.sum(0)[:, None] * k[rows:] - p.T @ k[:rows],
        ]
    )  # L(p) K
    return two_point(k @ weighted, rows)
