# SPDX-License-Identifier: Apache-2.0
"""The inner loops of small skins, compiled (the C files here) where setup.py found a compiler.

The modules that have the same in NumPy ask here first: laplacian.py, quadratic.py, kernel.py,
readouts/floating.py, solvers/prior.py and newton.py. Each function returns None where NumPy has to
do it: nothing is compiled, the skin is large, or the numbers are singular to rounding.
Together they make frames at least 1.15 times faster (`python -m benchmarks.kernel`).
"""

from __future__ import annotations

import ctypes
import warnings
import zlib
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..arrays import Bools, Floats, Floats32, Ints

LINES = 64  # rows + cols up to which the loops are faster than NumPy's BLAS, and short
_SHORT = 10  # steps of the fixed point, which take 1 ms on the largest skin
SOURCES = sorted(Path(__file__).parent.glob("*.c"))
_View = ctypes.c_char * 0  # of an array's memory, which it keeps


class _Array:
    """An argument: an array of one type; it is copied if it is not contiguous or is read-only."""

    def __init__(self, kind: type[np.generic], optional: bool = False):
        dtype, view = np.dtype(kind), _View.from_buffer

        def from_param(array: Any) -> Any:  # as ctypes calls it
            if optional and array is None:
                return None
            if array.dtype != dtype:
                raise TypeError(f"array of {array.dtype}: must be of {dtype}")
            try:
                return view(array)  # five times faster than `array.ctypes`
            except (TypeError, ValueError):
                return np.ascontiguousarray(array).ctypes

        self.from_param = from_param


class _Out:
    """An argument: a fresh array, which is what the function fills."""

    from_param = _View.from_buffer


_reals, _singles, _ints = _Array(np.float64), _Array(np.float32), _Array(np.int32)
_reals_or_none = _Array(np.float64, True)
_int, _real = ctypes.c_int, ctypes.c_double
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "solve": (_int, _int, _reals, *3 * [_Out]),
    "hessian_product": (_int, _int, _reals, _reals, _Out),
    "point": (_int, _int, *4 * [_reals], _real, *4 * [_Out]),
    "add_terms": (_int, _int, _int, _ints, _reals, _reals_or_none, _Out),
    "information": (_int, _int, *4 * [_reals], _int, _ints, _Out),
    "inverse": (_int, _singles, _int, _ints, _Out),
    "solve_in_box": (_int, _singles, *3 * [_reals], *2 * [_Out]),
    "newton_step": (_int, _int, *5 * [_reals], *4 * [_Out]),
    "fixed_point": (_int, _int, _Out, _int, _ints, *3 * [_reals], *3 * [_real], _int),
}


class Library:
    """The compiled functions by their C names."""

    def __init__(self, path: str):
        # A short call keeps Python's lock: who gives it away waits for each other thread, while
        # that one computes or for the interpreter's switch interval.
        for name, arguments in _ARGUMENTS.items():
            for prefix, load in (("", ctypes.PyDLL), ("long_", ctypes.CDLL)):
                function = load(path)[name]
                function.argtypes = arguments
                setattr(self, prefix + name, function)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


def _is_of(path: str, sources: list[Path]) -> bool:
    """Whether a library was compiled from these files."""
    checksum = zlib.crc32(b"".join(source.read_bytes() for source in sources))
    return ctypes.c_uint.in_dll(ctypes.CDLL(path), "source").value == checksum


def _has_avx2() -> bool:
    """Whether the processor has AVX2 and FMA, for which the loops are compiled once more."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            flags = next((line.split() for line in file if line.startswith("flags")), [])
    except OSError:
        return False
    return {"avx2", "fma"} <= set(flags)


def _load(sources: list[Path]) -> Library | None:
    """Return what was compiled; None: nothing, not from `sources`, or damaged."""
    for name in ("_loops_avx2", "_loops") if _has_avx2() else ("_loops",):
        spec = find_spec(f"{__package__}.{name}")
        if spec is None or spec.origin is None:
            continue
        try:
            if _is_of(spec.origin, sources):
                return Library(spec.origin)
            wrong = "the inner loops were compiled from other sources"
        except (OSError, ValueError, AttributeError) as error:  # no library, or none of ours
            wrong = f"the inner loops cannot be loaded ({error})"
        warnings.warn(
            f"tactile_skin: {wrong} and are not used, which takes up to twice the time: "
            "run `pip install -e .` again",
            stacklevel=3,
        )
        break
    return None


library = _load(SOURCES)


def implementation() -> str:
    """Return what runs for small skins: "compiled" or "in NumPy"."""
    return "compiled" if library else "in NumPy"


def solve(g: Floats) -> tuple[float, Floats, Floats] | None:
    """log_det, k and rho of laplacian.Network."""
    lines = sum(g.shape)
    if library is None or lines > LINES:
        return None
    log_det, k, rho = np.empty(1), np.zeros((lines, lines)), np.empty(g.shape)
    return None if library.solve(*g.shape, g, log_det, k, rho) else (float(log_det[0]), k, rho)


def hessian_product(k: Floats, p: Floats) -> Floats | None:
    """As laplacian.hessian_product."""
    if library is None or not len(k) == sum(p.shape) <= LINES:
        return None
    out = np.empty(p.shape)
    return None if library.hessian_product(*p.shape, k, p, out) else out


def point(
    g: Floats, reading: Floats, numbers: Floats, weight: Floats, spread: float
) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Return sums, k, pictures and entries off the diagonal, of which prior.Point is made."""
    lines = sum(g.shape)
    if library is None or lines > 2 * LINES or weight.size != 2 * g.size - lines:
        return None
    found = np.zeros(3), np.zeros((lines, lines)), np.zeros((11, *g.shape)), np.empty(weight.size)
    return None if library.point(*g.shape, g, reading, numbers, weight, spread, *found) else found


def add_terms(
    total: Floats32, diagonal: Floats, entries: Floats | None, free: npt.NDArray[np.integer]
) -> bool:
    """Add a prior's terms to the upper triangle of `total`, as prior.precision; whether it did."""
    rows, cols = diagonal.shape
    if library is None or total.shape != (free.size, free.size) or not total.flags.c_contiguous:
        return False
    if entries is not None and entries.size != 2 * diagonal.size - rows - cols:
        return False
    cells = free.astype(np.int32)
    return not library.add_terms(rows, cols, free.size, cells, diagonal, entries, total)


def information(
    k: Floats, weight: Floats, slope: Floats, scale: Floats, cells: npt.NDArray[np.integer]
) -> Floats32 | None:
    """As Linearised.information, of a floating readout: slope is - d adc / d rho [1/ohm]."""
    if library is None or len(k) != sum(weight.shape):
        return None
    n = cells.size
    out = np.zeros((n, n), np.float32)
    given = *weight.shape, k, weight, slope, scale, n, cells.astype(np.int32), out
    fill = library.information if n <= 4 * LINES else library.long_information
    return None if fill(*given) else out


def inverse(precision: Floats32, kept: Ints) -> Floats32 | None:
    """As quadratic.inverse, over `kept` unknowns."""
    out = np.zeros((kept.size, kept.size), np.float32)
    given = len(precision), precision, kept.size, kept, out
    return None if library is None or library.inverse(*given) else out


def solve_in_box(
    precision: Floats32, b: Floats, low: Floats, high: Floats
) -> tuple[Floats, bool, Bools] | None:
    """As quadratic.solve_in_box."""
    n = b.size
    if library is None or not len(precision) == n == low.size == high.size:
        return None
    dx, inside = np.zeros(n), np.ones(n, np.int32)
    solve = library.solve_in_box if n <= 4 * LINES else library.long_solve_in_box
    failed = solve(n, precision, b, low, high, dx, inside) < 0
    return None if failed else (dx, True, inside.astype(bool))


def newton_step(
    given: Floats, numbers: Floats, g: Floats, k: Floats, rho: Floats, moved: float
) -> tuple[int, float, float, Floats, Floats] | None:
    """Return newton._next: how many unknowns, how far it moved, log_det, K, g and rho there."""
    lines, found = sum(g.shape), np.array([[moved], [0.0]])
    if library is None or not len(k) == lines <= LINES:
        return None
    there, k_there = np.empty((2, *g.shape)), np.zeros((lines, lines))
    step = library.newton_step if g.size <= 4 * LINES else library.long_newton_step
    n = step(*g.shape, given, numbers, g, rho, k, *found, there, k_there)
    return None if n < 0 else (n, *found.ravel().tolist(), k_there, there)


def fixed_point(
    g: Floats,
    cells: Ints,
    measured: Floats,
    low: Floats,
    high: Floats,
    divider: tuple[float, float],
    goal: float,
    steps: int,
) -> tuple[Floats, int] | None:
    """As kernel.fixed_point, of a divider's r_ref and r_par [ohm]; 60 steps of LINES take 6 ms."""
    if library is None or sum(g.shape) > LINES:
        return None
    there, n = np.array(g, float, order="C"), cells.size
    if not n == measured.size == low.size == high.size:
        raise ValueError("the fixed point needs a resistance and two bounds for each cell")
    given = *g.shape, there, n, cells, measured, low, high
    loop = library.fixed_point if steps <= _SHORT else library.long_fixed_point
    taken = loop(*given, *divider, goal, steps)
    return None if taken < 0 else (there, taken)
