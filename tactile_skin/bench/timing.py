"""Times as multiples of y: machines differ and are shared, the ratio stays."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def against_y(work: Callable[[int], object], n: int, warm_up: int = 5) -> dict[str, float]:
    """Time ``work(0) .. work(n - 1)``, in turn with y: one dense solve of 257 equations.

    Taking turns lets a machine that slows down slow both. Run it with one thread
    (OMP_NUM_THREADS=1, set before NumPy is imported).

    Returns:
        y_us, and the work's p50 and p99 in us and in y.
    """
    rng = np.random.default_rng(0)
    matrix, right = rng.random((257, 257)) + 257 * np.eye(257), rng.random(257)
    for k in range(warm_up):
        work(k % n)
        np.linalg.solve(matrix, right)
    works, solves = np.empty(n), np.empty(n)
    for k in range(n):
        start = time.perf_counter()
        work(k)
        middle = time.perf_counter()
        np.linalg.solve(matrix, right)
        works[k], solves[k] = middle - start, time.perf_counter() - middle
    y = float(np.median(solves)) * 1e6
    p50, p99 = np.percentile(works, [50, 99]) * 1e6
    return {"y_us": y, "p50_us": p50, "p99_us": p99, "p50_y": p50 / y, "p99_y": p99 / y}
