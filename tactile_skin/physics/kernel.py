"""The fixed point, compiled (fixed_point.c) where setup.py found a compiler, else in NumPy.

It is the one inner loop whose compiled form makes a frame at least 1.15 times faster
(`python -m benchmarks.kernel`). Both forms do the same.
"""

from __future__ import annotations

import ctypes
import time
import warnings
import zlib
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.ctypeslib import ndpointer
from scipy.linalg import lapack

from .arrays import Floats, Ints
from .laplacian import connected_rho

_HISTORY = 6  # earlier steps that are combined: Walker and Ni 2011; fixed_point.c's HISTORY
_LINES = 64  # rows + cols; BLAS is as fast beyond
_RIDGE = 1e-10  # share of the trace, by which the steps' Gram matrix is made regular
_LEAST_RIDGE = 1e-30  # the same where all steps are nothing
_SOURCE = Path(__file__).with_name("fixed_point.c")


def _load(source: Path) -> Callable[..., int] | None:
    """Return the compiled function; None: there is none, or it is not of `source`."""
    spec = find_spec(f"{__package__}._fixed_point")
    if spec is None or spec.origin is None:
        return None
    library = ctypes.CDLL(spec.origin)
    if ctypes.c_uint32.in_dll(library, "source").value != zlib.crc32(source.read_bytes()):
        warnings.warn(
            "tactile_skin: the inner loops were compiled from other sources and are not used, "
            "which takes up to 1.3 times the time: run `pip install -e .` again",
            stacklevel=3,
        )
        return None
    function = library.fixed_point
    number, real = ctypes.c_int, ctypes.c_double
    reals, numbers = ndpointer(np.float64, flags="C"), ndpointer(np.int32, flags="C")
    function.argtypes = number, number, reals, number, numbers, *3 * [reals], *3 * [real], number
    return function


_compiled = _load(_SOURCE)


def implementation() -> str:
    """Return what runs for small skins: "compiled" or "in NumPy"."""
    return "compiled" if _compiled else "in NumPy"


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
        deadline: `time.monotonic` at which to stop; compiled, at which not to begin: 60 steps of
            `_LINES` lines take 6 ms.
        read: g (rows, cols) -> rho (rows, cols); None: `connected_rho`.

    Returns:
        g (rows, cols) and the steps taken.
    """
    if _compiled and read is None and sum(g.shape) <= _LINES and time.monotonic() <= deadline:
        there, n = np.array(g, float, order="C"), cells.size
        if not n == measured.size == low.size == high.size:
            raise ValueError("the fixed point needs a resistance and two bounds for each cell")
        taken = _compiled(*g.shape, there, n, cells, measured, low, high, r_ref, r_par, goal, steps)
        if taken >= 0:
            return there, taken
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
