"""The network of one frame as one matrix, and what the solvers need of it (docs/derivation.md).

K, (lines, lines) with lines = rows + cols, is a positive definite generalised inverse of the
Laplacian: rho_ij = (e_i - e_j)^T K (e_i - e_j), for row line i and column line rows + j.
"""

from __future__ import annotations

import numpy as np

from .kernel import Network, sensitivity, solve
from .numpy_kernel import two_point

__all__ = [
    "Network",
    "crossing_factor",
    "hessian_product",
    "sensitivity",
    "solve",
    "transfer_resistance",
]


def transfer_resistance(network: Network) -> np.ndarray:
    """t[i, j, k, l] = A_ik + D_jl - C_il - C_kj [ohm] between two crossings, of K's blocks."""
    rows = len(network.rho)
    a, c, d = network.k[:rows, :rows], network.k[:rows, rows:], network.k[rows:, rows:]
    return a[:, None, :, None] + d[None, :, None, :] - c[:, None, None, :] - c.T[None, :, :, None]


def crossing_factor(network: Network) -> np.ndarray:
    """V (rows * cols, lines) with t_ab = v_a . v_b: the transfer resistance of two crossings."""
    rows, _ = network.rho.shape
    root = network.root.astype(np.float32)
    return (root[:rows, None] - root[None, rows:]).reshape(-1, len(root))


def hessian_product(k: np.ndarray, p: np.ndarray) -> np.ndarray:
    """sum_b t_ab^2 p_b (rows, cols), in O(lines^3): it is K L(p) K between a's two lines.

    L(p) is the Laplacian of a network with conductances p, (rows, cols), of either sign.
    """
    rows, cols = p.shape
    weighted = np.empty_like(k)
    np.matmul(p, k[rows:], out=weighted[:rows])
    np.matmul(p.T, k[:rows], out=weighted[rows:])
    ones = np.ones(max(p.shape))
    sums = np.concatenate([p @ ones[:cols], ones[:rows] @ p])
    weighted -= k * sums[:, None]  # - L(p) K
    own = np.einsum("ij,ji->i", k, weighted)  # the diagonal of - K L(p) K
    return -two_point(own[:rows], k[:rows] @ weighted[:, rows:], own[rows:])
