# SPDX-License-Identifier: Apache-2.0
"""The accelerated fixed point g <- g * rho(g) / measured, compiled or in NumPy."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.linalg import lapack

from . import compiled
from .arrays import Floats, Ints
from .laplacian import connected_rho

_HISTORY = 6  # earlier steps that are combined: Walker and Ni 2011; network.c's HISTORY
_RIDGE = 1e-10  # share of the trace, by which the steps' Gram matrix is made regular
_LEAST_RIDGE = 1e-30  # the same where all steps are nothing


def fixed_point(
    g: Floats,
    cells: Ints,
    measured: Floats,
    low: Floats,
    high: Floats,
    *,
    r_ref: float | Floats,
    r_par: float | Floats,
    goal: float,
    steps: int,
    deadline: float = np.inf,
    read: Callable[[Floats], Floats] | None = None,
) -> tuple[Floats, int]:
    """Iterate g <- g * rho(g) / measured in log g, Anderson-accelerated (Walker & Ni 2011).

    Args:
        g: (rows, cols) where to begin [S]; not changed.
        cells: (n,) flat, the cells that move; the others stay.
        measured: (n,) measured two-terminal resistance of each [ohm].
        low, high: (n,) bounds of log g.
        r_ref, r_par: of the voltage divider [ohm], by which the misfit is weighed; with `read`
            also (n,) of them.
        goal: sum of the squared misfits of the ADC ratios at which to stop.
        steps: at most so many.
        deadline: `time.monotonic` at which to stop; compiled, at which not to begin.
        read: g (rows, cols) -> rho (rows, cols); None: `connected_rho`.

    Returns:
        g (rows, cols) and the steps taken.
    """
    if read is None and time.monotonic() <= deadline:
        divider = float(r_ref), float(r_par)
        found = compiled.fixed_point(g, cells, measured, low, high, divider, goal, steps)
        if found is not None:
            return found
    read = read or connected_rho
    g = g.copy()
    flat = g.reshape(-1)
    x = np.log(flat[cells])  # (cells,)
    adc = r_ref / (r_ref + r_par + measured)
    d_misfit = np.empty((_HISTORY, x.size))
    d_image = np.empty((_HISTORY, x.size))
    last_misfit = last_image = np.zeros(x.size)  # of no step yet
    for step in range(steps):
        rho = read(g).ravel()[cells]
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
            gram.flat[:: used + 1] += _RIDGE * gram.trace() + _LEAST_RIDGE
            share = lapack.dposv(gram, d_misfit[:used] @ misfit)[1]
            new = image - share @ d_image[:used]
        last_misfit, last_image = misfit, image
        x = np.minimum(np.maximum(new, low), high)
        flat[cells] = np.exp(x)
    return g, steps
