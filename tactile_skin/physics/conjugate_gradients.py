# SPDX-License-Identifier: Apache-2.0
"""Preconditioned conjugate gradients over a product function."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .arrays import Floats


def conjugate_gradients(
    product: Callable[[Floats], Floats],
    near: Callable[[Floats], Floats],
    b: Floats,
    *,
    steps: int,
    target: float,
) -> Floats:
    """Solve A x = b, A symmetric and positive definite, until the residual falls by `target`.

    Args:
        product: (n,) -> (n,), A times it.
        near: (n,) -> (n,), about A^-1 times it, the preconditioner; the residual is measured in its
            norm.
        steps: at most so many products.
    """
    x = np.zeros(b.size)
    residual = b.copy()
    z = near(residual)
    p = z.copy()
    size = residual @ z
    goal = size * target**2
    for _ in range(steps):
        if size <= goal:
            break
        a_p = product(p)
        alpha = size / (p @ a_p)
        x += alpha * p
        residual -= alpha * a_p
        z = near(residual)
        size, last = residual @ z, size
        p = z + (size / last) * p
    return x
