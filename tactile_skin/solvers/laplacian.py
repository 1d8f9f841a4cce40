"""The network of one frame as one matrix, and what the solvers need of it (docs/derivation.md).

K, (lines, lines) with lines = rows + cols, is a positive definite generalised inverse of the
Laplacian: rho_ij = (e_i - e_j)^T K (e_i - e_j), for row line i and column line rows + j.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..circuit import compiled, reduced_root


class Network(NamedTuple):
    """All that follows from the conductances of one frame.

    Attributes:
        root: (lines, lines) W with K = W W^T [sqrt(ohm)]; det W is the product of its diagonal.
        k: (lines, lines) K [ohm].
        rho: (rows, cols) two-terminal resistances [ohm].
    """

    root: np.ndarray
    k: np.ndarray
    rho: np.ndarray


def solve(g: np.ndarray) -> Network:
    """The network of conductances g (rows, cols) [S] (docs/derivation.md: K = W W^T in blocks)."""
    rows, cols = g.shape
    lines = rows + cols
    if fast := compiled(g.shape):
        root, k, rho = np.empty((lines, lines)), np.empty((lines, lines)), np.empty(g.shape)
        if fast.network(rows, cols, np.ascontiguousarray(g), root, k, rho):
            return Network(root, k, rho)
    reduced, scaled, col_sum = reduced_root(g)
    root = np.zeros((lines, lines))
    root[:rows, :rows] = reduced
    np.matmul(scaled.T, reduced, out=root[rows:, :rows])
    root.reshape(-1)[rows * (lines + 1) :: lines + 1] = col_sum**-0.5
    k = root @ root.T
    return Network(root, k, two_point(k, rows))


def two_point(k: np.ndarray, rows: int) -> np.ndarray:
    """(e_i - e_j)^T K (e_i - e_j) for each crossing, (rows, cols)."""
    diagonal = k.diagonal()
    between = k[:rows, rows:] * -2.0
    between += diagonal[:rows, None]
    between += diagonal[rows:]
    return between


def crossing_factor(network: Network) -> np.ndarray:
    """V (rows * cols, lines) with t_ab = v_a . v_b: the transfer resistance of two crossings."""
    rows, _ = network.rho.shape
    root = network.root.astype(np.float32)
    return (root[:rows, None] - root[None, rows:]).reshape(-1, len(root))


def sensitivity(k: np.ndarray, weight: np.ndarray, told, one, other) -> np.ndarray:
    """weight_a * across_ab^2: how reading a follows a conductance put between two lines b.

    Args:
        k: (lines, lines) K [ohm].
        weight: (rows, cols) of each reading.
        told: (m,) int32, flat, which readings; one, other: (n,) int32, the lines.

    Returns:
        (m, n) float32.
    """
    rows, cols = weight.shape
    if fast := compiled(weight.shape):
        out = np.empty((told.size, one.size), np.float32)
        fast.sensitivity(rows, cols, k, weight, told, one, other, out)
        return out
    apart = k[:, one] - k[:, other]
    across = apart[told // cols] - apart[rows + told % cols]
    across *= across
    across *= weight.ravel()[told, None]
    return across.astype(np.float32)


def hessian_product(k: np.ndarray, p: np.ndarray) -> np.ndarray:
    """sum_b t_ab^2 p_b (rows, cols), in O(lines^3): it is K L(p) K between a's two lines.

    L(p) is the Laplacian of a network with conductances p, (rows, cols), of either sign.
    """
    rows, cols = p.shape
    if fast := compiled(p.shape):
        product = np.empty(p.shape)
        fast.hessian_product(rows, cols, k, np.ascontiguousarray(p), product)
        return product
    weighted = np.empty_like(k)
    np.matmul(p, k[rows:], out=weighted[:rows])
    np.matmul(p.T, k[:rows], out=weighted[rows:])
    ones = np.ones(max(p.shape))
    sums = np.concatenate([p @ ones[: p.shape[1]], ones[:rows] @ p])
    weighted -= k * sums[:, None]  # - L(p) K
    return -two_point(k @ weighted, rows)
