"""The inner loops of the solvers: the only interface to their two implementations.

The choice is made once, at import: the compiled one (`_kernel`, the C files in kernel/) where
setup.py found a compiler, else NumPy's (numpy_kernel.py), which also serves skins of more lines
than the compiled arrays hold and networks that are singular to rounding. Only what makes a whole
frame of 16 x 16 cells at least 1.15 times faster is in C.

Arrays of floats may have any strides: what C needs in another order is copied.
"""

from __future__ import annotations

import time
import warnings
import zlib
from pathlib import Path

import numpy as np

from . import numpy_kernel
from .numpy_kernel import Network

try:
    from . import _kernel  # type: ignore[attr-defined]  # compiled where there is a compiler
except ImportError:
    _kernel = None


def _is_of(kernel, sources: Path) -> bool:
    """Whether the compiled module is of the C files beside it; an installed package has none."""
    files = sorted(sources.glob("*.[ch]"))
    checksum = zlib.crc32(b"".join(file.read_bytes() for file in files)) & 0x7FFFFFFF
    return not files or getattr(kernel, "SOURCES", None) == checksum


if _kernel and not _is_of(_kernel, Path(__file__).with_name("kernel")):
    warnings.warn(
        "tactile_skin: the inner loops were compiled from other sources and are not used, which "
        "takes twice the time: run `pip install -e .` again",
        stacklevel=1,
    )
    _kernel = None

__all__ = [
    "Network",
    "Table",
    "connected_rho",
    "convolve",
    "fixed_point",
    "hessian_product",
    "implementation",
    "roughness",
    "sensitivity",
    "solve",
    "solve_in_box",
]


_BOX = 100  # unknowns up to which LAPACK's calls cost more than its arithmetic saves


def implementation() -> str:
    """What runs for small skins: "compiled" or "in NumPy"."""
    return "compiled" if _kernel else "in NumPy"


def _compiled(shape: tuple[int, int]) -> bool:
    return _kernel is not None and sum(shape) <= _kernel.LINES


def connected_rho(g: np.ndarray) -> np.ndarray:
    """Two-terminal resistance of each crossing of a connected network, which it does not check.

    Args:
        g: (rows, cols) conductances [S].

    Returns:
        (rows, cols) [ohm].
    """
    if _compiled(g.shape):
        rho = np.empty(g.shape)
        if _kernel.two_terminal(*g.shape, np.ascontiguousarray(g), rho):
            return rho
    return numpy_kernel.connected_rho(g)


def solve(g: np.ndarray) -> Network:
    """The network of conductances g (rows, cols) [S], which must be connected."""
    if _compiled(g.shape):
        lines = sum(g.shape)
        root, k, rho = np.empty((lines, lines)), np.empty((lines, lines)), np.empty(g.shape)
        if _kernel.network(*g.shape, np.ascontiguousarray(g), root, k, rho):
            return Network(root, k, rho)
    return numpy_kernel.solve(g)


class Table:
    """A function that is linear between points, as `np.interp`, which takes four times as long.

    Args:
        points: (n,) where it is known, rising, not all alike.
        values: (n,) there; before the first point and after the last the function stays.
    """

    def __init__(self, points: np.ndarray, values: np.ndarray):
        self.points, self.values = (np.ascontiguousarray(a, float) for a in (points, values))
        begins = np.linspace(self.points[0], self.points[-1], self.points.size)[:-1]
        self._start = (np.searchsorted(self.points, begins, "right") - 1).astype(np.int32)

    def __call__(self, x) -> np.ndarray:
        """At x, an array of any shape or a number."""
        if _kernel is None:
            return np.interp(x, self.points, self.values)
        x = np.asarray(x, dtype=float, order="C")
        out = np.empty(x.shape)
        _kernel.interpolate(x, self.points, self.values, self._start, out)
        return out[()]  # of a number a number


def sensitivity(k: np.ndarray, weight: np.ndarray, told, one, other) -> np.ndarray:
    """weight_a * across_ab^2: how reading a follows a conductance put between two lines b.

    Args:
        k: (lines, lines) K [ohm].
        weight: (rows, cols) of each reading.
        told: (m,) int32, flat, which readings; one, other: (n,) int32, the lines.

    Returns:
        (m, n) float32.
    """
    if _compiled(weight.shape):
        out = np.empty((told.size, one.size), np.float32)
        k, weight = np.ascontiguousarray(k), np.ascontiguousarray(weight)
        _kernel.sensitivity(*weight.shape, k, weight, told, one, other, out)
        return out
    return numpy_kernel.sensitivity(k, weight, told, one, other)


def hessian_product(k: np.ndarray, p: np.ndarray) -> np.ndarray:
    """sum_b t_ab^2 p_b (rows, cols), in O(lines^3): it is K L(p) K between a's two lines.

    L(p) is the Laplacian of a network with conductances p, (rows, cols), of either sign.
    """
    if _compiled(p.shape):
        out = np.empty(p.shape)
        _kernel.hessian_product(*p.shape, np.ascontiguousarray(k), np.ascontiguousarray(p), out)
        return out
    return numpy_kernel.hessian_product(k, p)


def roughness(
    x: np.ndarray, weight: np.ndarray, square: float
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """How much a picture differs from cell to cell: sum of weight/2 log(square + d^2).

    Args:
        x: (rows, cols).
        weight: (differences,) of each d between neighbours in a row, then in a column.

    Returns:
        the cost, and its quadratic majorant: gradient and diagonal of the precision (rows, cols),
        entries off it, of each difference.
    """
    if _compiled(x.shape):
        gradient, diagonal = np.empty(x.shape), np.empty(x.shape)
        entries = np.empty(weight.size)
        x = np.ascontiguousarray(x)
        cost = _kernel.roughness(*x.shape, x, weight, square, gradient, diagonal, entries)
        return cost, gradient, diagonal, entries
    return numpy_kernel.roughness(x, weight, square)


def convolve(picture: np.ndarray, layer: np.ndarray, dilation: int = 1) -> np.ndarray:
    """A 3x3 convolution of a picture that ends in zeros.

    Args:
        picture: (channels, rows, cols) float32.
        layer: (outputs, 9 * channels + 1) float32, see `convolution`.
        dilation: cells from one tap to the next.

    Returns:
        (outputs, rows, cols) float32.
    """
    if _kernel is not None:
        channels, rows, cols = picture.shape
        out = np.empty((len(layer), rows, cols), np.float32)
        picture = np.ascontiguousarray(picture)
        _kernel.convolve(rows, cols, channels, dilation, picture, layer, out)
        return out
    return numpy_kernel.convolve(picture, layer, dilation)


def convolution(weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """A layer for `convolve`, (outputs, 9 * channels + 1) float32, of PyTorch's arrays.

    Args:
        weight: (outputs, channels, 3, 3).
        bias: (outputs,), which comes last.
    """
    return np.hstack([weight.reshape(len(weight), -1), bias[:, None]]).astype(np.float32)


def solve_in_box(precision, b, low, high) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """As quadratic.solve_in_box of few unknowns; None: LAPACK is faster, or there is no factor."""
    n = b.size
    if _kernel is None or n > _BOX:
        return None
    dx, factor, inside = np.empty(n), np.empty(n * n, np.float32), np.empty(n, np.int32)
    given = (np.ascontiguousarray(array) for array in (precision, b, low, high))
    m = _kernel.solve_in_box(*given, dx, factor, inside)
    return None if m < 0 else (dx, factor[: m * m].reshape(m, m), inside.astype(bool))


def fixed_point(
    g: np.ndarray,
    cells: np.ndarray,
    measured: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    r_ref: float,
    r_par: float,
    goal: float,
    steps: int,
    deadline: float = np.inf,
) -> tuple[np.ndarray, int]:
    """Anderson-accelerated fixed point g <- g * rho(g) / measured in log g (Walker & Ni 2011).

    Args:
        g: (rows, cols) where to begin [S]; not changed.
        cells: (n,) int32, flat, the cells that move; the others stay.
        measured: (n,) measured two-terminal resistance of each [ohm].
        low, high: (n,) bounds of log g.
        r_ref, r_par: of the voltage divider [ohm], by which the misfit is weighed.
        goal: sum of the squared misfits of the ADC ratios at which to stop.
        steps: at most so many.
        deadline: `time.monotonic` at which to stop.

    Returns:
        g (rows, cols) and the steps taken.
    """
    if _compiled(g.shape):
        there = np.array(g, order="C")
        seconds = deadline - time.monotonic()
        taken = _kernel.iterate(
            *g.shape, there, cells, measured, low, high, r_ref, r_par, goal, steps, seconds
        )
        if taken >= 0:
            return there, taken
    return numpy_kernel.fixed_point(
        g,
        cells,
        measured,
        low,
        high,
        r_ref=r_ref,
        r_par=r_par,
        goal=goal,
        steps=steps,
        deadline=deadline,
    )
