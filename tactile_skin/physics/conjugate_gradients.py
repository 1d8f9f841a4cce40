# SPDX-License-Identifier: Apache-2.0
"""Preconditioned conjugate gradients over a product function."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .arrays import Floats

INEXACT = 1e-2  # of its right side that a step of an iteration leaves: the next one has it
_STEPS = 300  # at most; 20 to 60 are usual


def conjugate_gradients(
    product: Callable[[Floats], Floats],
    near: Callable[[Floats], Floats],
    b: Floats,
    target: float = INEXACT,
) -> Floats:
    """Solve A x = b, A symmetric and positive definite, until the residual falls by `target`.

    `product` is A times a vector (n,); `near`, the preconditioner, about A^-1 times it.
    """
    x = np.zeros(b.size)
    residual = b.copy()
    z = near(residual)
    p = z.copy()
    size = residual @ z
    goal = size * target**2
    for _ in range(_STEPS):
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
