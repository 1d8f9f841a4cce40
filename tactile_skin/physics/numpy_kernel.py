"""The inner loops in NumPy, for skins of any size: see kernel.py, which chooses.

The one generalised inverse of a frame's Laplacian from which all else follows, with D_c the column
sums of the conductances g and S = D_r - g D_c^-1 g^T the network seen from the rows alone:

    A = S^-1 (made regular by a multiple of ones),  C = A g D_c^-1,  D = D_c^-1 + D_c^-1 g^T C
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import lapack

_HISTORY = 6  # earlier steps that the acceleration of the fixed point combines


class Network(NamedTuple):
    """All that follows from the conductances of one frame.

    Attributes:
        root: (lines, lines) W with K = W W^T [sqrt(ohm)]; det W is the product of its diagonal.
        k: (lines, lines) K = [[A, C], [C^T, D]] [ohm].
        rho: (rows, cols) two-terminal resistances [ohm].
    """

    root: np.ndarray
    k: np.ndarray
    rho: np.ndarray


def reduced_root(g: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The root of the reduced inverse A, and what leads from it to C and D.

    Args:
        g: (rows, cols) conductances [S] of a connected network.

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
    half = vectors / np.sqrt(np.maximum(values, 1e-15 * values[-1]))
    _, upper = np.linalg.qr(half.T)
    return upper.T, scaled, col_sum


def two_point(rows: np.ndarray, between: np.ndarray, cols: np.ndarray) -> np.ndarray:
    """A_ii + D_jj - 2 C_ij, (rows, cols), of the diagonals of A and D, and of C."""
    out = between * -2.0
    out += rows[:, None]
    out += cols
    return out


def connected_rho(g: np.ndarray) -> np.ndarray:
    """As kernel.connected_rho."""
    if g.shape[0] > g.shape[1]:  # eliminate the longer side: the inverse stays small
        return connected_rho(g.T).T
    root, scaled, col_sum = reduced_root(g)
    a = root @ root.T
    c = a @ scaled
    d = np.einsum("ij,ij->j", scaled, c)
    d += 1.0 / col_sum
    return two_point(a.diagonal(), c, d)


def solve(g: np.ndarray) -> Network:
    """As kernel.solve (docs/derivation.md: K = W W^T in blocks)."""
    rows, cols = g.shape
    lines = rows + cols
    reduced, scaled, col_sum = reduced_root(g)
    root = np.zeros((lines, lines))
    root[:rows, :rows] = reduced
    np.matmul(scaled.T, reduced, out=root[rows:, :rows])
    root.reshape(-1)[rows * (lines + 1) :: lines + 1] = col_sum**-0.5
    k = root @ root.T
    diagonal = k.diagonal()
    return Network(root, k, two_point(diagonal[:rows], k[:rows, rows:], diagonal[rows:]))


def sensitivity(k: np.ndarray, weight: np.ndarray, told, one, other) -> np.ndarray:
    """As kernel.sensitivity."""
    rows, cols = weight.shape
    apart = k[:, one] - k[:, other]
    across = apart[told // cols] - apart[rows + told % cols]
    across *= across
    across *= weight.ravel()[told, None]
    return across.astype(np.float32)


def hessian_product(k: np.ndarray, p: np.ndarray) -> np.ndarray:
    """As kernel.hessian_product."""
    rows, cols = p.shape
    weighted = np.empty_like(k)
    np.matmul(p, k[rows:], out=weighted[:rows])
    np.matmul(p.T, k[:rows], out=weighted[rows:])
    ones = np.ones(max(p.shape))
    sums = np.concatenate([p @ ones[:cols], ones[:rows] @ p])
    weighted -= k * sums[:, None]  # - L(p) K
    own = np.einsum("ij,ji->i", k, weighted)  # the diagonal of - K L(p) K
    return -two_point(own[:rows], k[:rows] @ weighted[:, rows:], own[rows:])


def roughness(
    x: np.ndarray, weight: np.ndarray, square: float
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """As kernel.roughness."""
    d = np.concatenate([np.diff(x, axis=1).ravel(), np.diff(x, axis=0).ravel()])
    squares = square + d * d
    w = weight / squares
    cost = 0.5 * float(weight @ np.log(squares))
    across = x.shape[0] * (x.shape[1] - 1)
    gradient, diagonal = np.zeros(x.shape), np.zeros(x.shape)
    for part, here, there in (
        (slice(across), np.s_[:, :-1], np.s_[:, 1:]),
        (slice(across, None), np.s_[:-1], np.s_[1:]),
    ):
        curvature = w[part].reshape(x[here].shape)
        pull = curvature * d[part].reshape(x[here].shape)
        gradient[here] -= pull
        gradient[there] += pull
        diagonal[here] += curvature
        diagonal[there] += curvature
    return cost, gradient, diagonal, -w


def convolve(picture: np.ndarray, layer: np.ndarray, dilation: int) -> np.ndarray:
    """As kernel.convolve."""
    channels, rows, cols = picture.shape
    padded = np.pad(picture, ((0, 0), (dilation, dilation), (dilation, dilation)))
    reach = 2 * dilation + 1
    windows = sliding_window_view(padded, (reach, reach), (1, 2))[..., ::dilation, ::dilation]
    columns = np.ones((9 * channels + 1, rows * cols), np.float32)
    columns[:-1] = windows.transpose(0, 3, 4, 1, 2).reshape(9 * channels, rows * cols)
    return (layer @ columns).reshape(-1, rows, cols)


def fixed_point(
    g, cells, measured, low, high, *, r_ref, r_par, goal: float, steps: int, deadline, read=None
) -> tuple[np.ndarray, int]:
    """As kernel.fixed_point.

    Args:
        r_ref, r_par: a number, or (n,) of them.
        read: g (rows, cols) -> rho (rows, cols); None: `connected_rho`.
    """
    g = g.copy()
    flat = g.reshape(-1)
    x = np.log(flat[cells])  # (cells,)
    adc = r_ref / (r_ref + r_par + measured)
    d_misfit = np.empty((_HISTORY, x.size))
    d_image = np.empty((_HISTORY, x.size))
    last_misfit = last_image = np.zeros(x.size)  # of no step yet
    for step in range(steps):
        rho = (read or connected_rho)(g).ravel()[cells]
        error = r_ref / (r_ref + r_par + rho) - adc
        if error @ error <= goal or time.monotonic() > deadline:
            return g, step
        misfit = np.log(rho / measured)
        image = x + misfit  # the step that is not accelerated
        new = image
        if step:
            slot = (step - 1) % _HISTORY
            np.subtract(misfit, last_misfit, out=d_misfit[slot])
            np.subtract(image, last_image, out=d_image[slot])
            used = min(step, _HISTORY)
            gram = d_misfit[:used] @ d_misfit[:used].T
            gram.flat[:: used + 1] += 1e-10 * gram.trace() + 1e-30
            share = lapack.dposv(gram, d_misfit[:used] @ misfit)[1]
            new = image - share @ d_image[:used]
        last_misfit, last_image = misfit, image
        x = np.minimum(np.maximum(new, low), high)
        flat[cells] = np.exp(x)
    return g, steps
