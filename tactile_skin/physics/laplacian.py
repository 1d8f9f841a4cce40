"""The network of one frame as one matrix, and what the solvers need of it (docs/derivation.md).

K, (lines, lines) with lines = rows + cols, is a positive definite generalised inverse of the
Laplacian: rho_ij = (e_i - e_j)^T K (e_i - e_j), for row line i and column line rows + j.
"""

from __future__ import annotations

import numpy as np

from .kernel import Network, hessian_product, sensitivity, solve

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
