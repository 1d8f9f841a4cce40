# SPDX-License-Identifier: Apache-2.0
"""The network of one frame as one matrix, and what the solvers need of it (docs/derivation.md).

K, (lines, lines) with lines = rows + cols, is a positive definite generalised inverse of the
Laplacian: rho_ij = (e_i - e_j)^T K (e_i - e_j), for row line i and column line rows + j. With D_r
and D_c the row and column sums of the conductances g, S = D_r - g D_c^-1 g^T is the network seen
from the rows alone, and K's blocks are

    A = S^-1 (made regular by a multiple of ones),  C = A g D_c^-1,  D = D_c^-1 + D_c^-1 g^T C
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from . import compiled
from .arrays import Bools, Floats, Floats32, Ints

_LEAST_OWN = 0.1  # share of a cell's rho^2 that its lines leave to it at least
INEXACT = 1e-2  # of its right side that a step of an iteration leaves: the next one has it
_STEPS = 300  # of conjugate gradients at most; 20 to 60 are usual
_LEAST_EIGENVALUE = 1e-15  # of the largest: below it the rounding of doubles is all there is


class Network(NamedTuple):
    """All that follows from the conductances of one frame."""

    log_det: float  # of K
    k: Floats  # (lines, lines) K = [[A, C], [C^T, D]] [ohm]
    rho: Floats  # (rows, cols) two-terminal resistances [ohm]


def solve(g: Floats) -> Network:
    """Return the network of conductances g (rows, cols) [S], which must be connected."""
    if (found := compiled.solve(g)) is not None:
        return Network(*found)
    rows, cols = g.shape
    if rows > cols:  # eliminate the longer side: the inverse stays small
        log_det, k, rho = solve(g.T)
        return Network(log_det, np.roll(k, (rows, rows), (0, 1)), rho.T)
    lines = rows + cols
    reduced, scaled, col_sum = _reduced_root(g)
    root = np.zeros((lines, lines))
    root[:rows, :rows] = reduced
    np.matmul(scaled.T, reduced, out=root[rows:, :rows])
    root.reshape(-1)[rows * (lines + 1) :: lines + 1] = col_sum**-0.5
    k, log_det = root @ root.T, 2.0 * float(np.log(np.abs(root.diagonal())).sum())
    diagonal = k.diagonal()
    return Network(log_det, k, _two_point(diagonal[:rows], k[:rows, rows:], diagonal[rows:]))


def connected_rho(g: Floats) -> Floats:
    """Return the two-terminal resistance of each crossing, without all of `solve`.

    Args:
        g: (rows, cols) conductances [S] of a connected network, which is not checked.

    Returns:
        (rows, cols) [ohm].
    """
    if (found := compiled.solve(g)) is not None:
        return found[-1]
    if g.shape[0] > g.shape[1]:
        return connected_rho(g.T).T
    root, scaled, col_sum = _reduced_root(g)
    a = root @ root.T
    c = a @ scaled
    d = np.einsum("ij,ij->j", scaled, c)
    d += 1.0 / col_sum
    return _two_point(a.diagonal(), c, d)


def two_terminal_resistance(conductance: Floats) -> Floats:
    """Return the resistance between row i and column j with every other line floating.

    Args:
        conductance: (..., rows, cols) of the cells [S], 0 where there is none.

    Returns:
        (..., rows, cols) rho [ohm]; infinite where no path connects the two lines.
    """
    g = np.asarray(conductance, dtype=float)
    frames = g.reshape(-1, *g.shape[-2:])
    rho = np.empty(frames.shape)
    present = frames > 0
    as_one = np.ones(len(frames), bool) if present.all() else connected(present)
    for k, frame in enumerate(frames):
        rho[k] = connected_rho(frame) if as_one[k] else _rho_in_parts(frame)
    return rho.reshape(g.shape)


def _row_reach(present: Bools) -> Bools:
    """(..., rows, rows) bool: which rows a path of cells connects."""
    p = present.astype(np.float32)
    reach = p @ p.swapaxes(-1, -2) > 0
    for _ in range(max(present.shape[-2] - 1, 1).bit_length()):
        step = reach.astype(np.float32)
        reach = step @ step > 0
    return reach


def connected(present: Bools) -> Bools:
    """Return (n,) whether the cells of each (rows, cols) picture connect all its lines."""
    return np.asarray(_row_reach(present).all((-2, -1)) & present.any(-2).all(-1))


def _rho_in_parts(g: Floats) -> Floats:
    """rho of one frame whose network falls into parts: infinite between them."""
    rho = np.full(g.shape, np.inf)
    present = g > 0
    for reach in np.unique(_row_reach(present), axis=0):
        rows = np.flatnonzero(reach)
        cols = np.flatnonzero(present[rows].any(0)) if rows.size else rows
        if cols.size:
            part = np.ix_(rows, cols)
            rho[part] = connected_rho(g[part])
    return rho


def _reduced_root(g: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the root of the reduced inverse A, and what leads from it to C and D.

    Returns:
        R (rows, rows) with A = R R^T, its triangle's ends on the diagonal; g D_c^-1 (rows, cols);
        D_c (cols,).
    """
    rows, cols = g.shape
    ones = np.ones(max(rows, cols))
    col_sum, row_sum = ones[:rows] @ g, g @ ones[:cols]  # faster than sum() at this size
    scaled = g / col_sum
    schur = scaled @ g.T
    # S is singular along the constant vector; a multiple of ones fills it without touching rho.
    np.subtract(float(row_sum @ ones[:rows]) / rows**2, schur, out=schur)
    schur.reshape(-1)[:: rows + 1] += row_sum
    factor, info = lapack.dpotrf(schur.T, lower=0, clean=1)
    if not info:
        return lapack.dtrtri(factor, lower=0, overwrite_c=1)[0], scaled, col_sum
    # Singular to rounding: conductances many decades apart.
    values, vectors = np.linalg.eigh(schur)
    half = vectors / np.sqrt(np.maximum(values, _LEAST_EIGENVALUE * values[-1]))
    _, upper = np.linalg.qr(half.T)
    return upper.T, scaled, col_sum


def _two_point(rows: Floats, between: Floats, cols: Floats) -> Floats:
    """A_ii + D_jj - 2 C_ij, (rows, cols), of the diagonals of A and D, and of C."""
    out = between * -2.0
    out += rows[:, None]
    out += cols
    return out


def hessian_product(k: Floats, p: Floats) -> Floats:
    """Return sum_b t_ab^2 p_b (rows, cols) in O(lines^3).

    It is K L(p) K between a's two lines; L(p) is the Laplacian of a network with conductances p,
    (rows, cols), of either sign.
    """
    if (found := compiled.hessian_product(k, p)) is not None:
        return found
    rows, cols = p.shape
    weighted = np.empty_like(k)
    np.matmul(p, k[rows:], out=weighted[:rows])
    np.matmul(p.T, k[:rows], out=weighted[rows:])
    ones = np.ones(max(p.shape))
    sums = np.concatenate([p @ ones[:cols], ones[:rows] @ p])
    weighted -= k * sums[:, None]  # - L(p) K
    own = np.einsum("ij,ij->j", k, weighted)  # the diagonal of - K L(p) K, of which K is symmetric
    return -_two_point(own[:rows], k[:rows] @ weighted[:, rows:], own[rows:])


def hessian_solver(
    network: Network, g: Floats, cells: Ints, target: float = INEXACT
) -> Callable[[Floats], Floats]:
    """Return b -> x (n,) with t_ab^2 x_b = b_a over (n,) flat cells that conduct g [S].

    Without the matrix: a product costs O(lines^3).

    Args:
        target: of `conjugate_gradients`.
    """
    near, right, moves = near_hessian(network.rho, g, cells), np.zeros(g.shape), np.zeros(g.shape)
    moves.flat[cells] = 1.0

    def solve(b: Floats) -> Floats:
        right.flat[cells] = b
        found = conjugate_gradients(
            lambda p: hessian_product(network.k, p) * moves, near, right, target
        )
        return found.flat[cells]

    return solve


def near_hessian(rho: Floats, g: Floats, cells: Ints) -> Callable[[Floats], Floats]:
    """Return b -> x, (rows, cols), with t_ab^2 x_b about b_a over some cells: a preconditioner.

    Two cells of a line share about its resistance to all other lines, others nothing, so that
    the matrix is a diagonal and a constant for each line (Woodbury).

    Args:
        rho: (rows, cols) of conductances g (rows, cols) [S].
        cells: (n,) flat, which.
    """
    rows = len(g)
    of_row, of_col = g.sum(1) ** -2.0, g.sum(0) ** -2.0
    square = np.square(rho)
    own = np.maximum(square - of_row[:, None] - of_col, _LEAST_OWN * square)
    weight = np.zeros(g.shape)
    weight.flat[cells] = 1.0 / own.flat[cells]
    between = np.diag(np.concatenate([weight.sum(1) + 1.0 / of_row, weight.sum(0) + 1.0 / of_col]))
    between[:rows, rows:], between[rows:, :rows] = weight, weight.T
    factor = lapack.dpotrf(between)[0]
    ones = np.ones(max(g.shape))

    def near(b: Floats) -> Floats:
        x = b * weight
        sums = np.concatenate([x @ ones[: g.shape[1]], ones[:rows] @ x])
        shared = lapack.dpotrs(factor, sums)[0]
        x -= weight * np.add.outer(shared[:rows], shared[rows:])
        return x

    return near


def sensitivity(k: Floats, weight: Floats, readings: Ints, one: Ints, other: Ints) -> Floats32:
    """Return weight_a * across_ab^2: how reading a follows a conductance put between two lines b.

    Args:
        k: (lines, lines) K [ohm].
        weight: (rows, cols) of each reading.
        readings: (m,) flat, which; one, other: (n,) the lines.

    Returns:
        (m, n).
    """
    rows, cols = weight.shape
    row, col = np.divmod(readings, np.int32(cols))
    across = (k.take(one, 1) - k.take(other, 1)).astype(np.float32)
    out = across.take(row, 0)  # which copies three times faster than an index does
    out -= across.take(col + rows, 0)
    out *= out
    out *= weight.take(readings).astype(np.float32)[:, None]
    return out


def conjugate_gradients(
    product: Callable[[Floats], Floats],
    near: Callable[[Floats], Floats],
    b: Floats,
    target: float = INEXACT,
) -> Floats:
    """Solve A x = b, A symmetric and positive definite, until the residual falls by `target`.

    `product` is A times a vector, of any shape; `near`, the preconditioner, about A^-1 times it.
    """
    x = np.zeros(b.shape)
    residual = b.copy()
    z = near(residual)
    p = z.copy()
    size = np.vdot(residual, z)
    goal = size * target**2
    for _ in range(_STEPS):
        if size <= goal:
            break
        a_p = product(p)
        alpha = size / np.vdot(p, a_p)
        x += alpha * p
        residual -= alpha * a_p
        z = near(residual)
        size, last = np.vdot(residual, z), size
        p = z + (size / last) * p
    return x
