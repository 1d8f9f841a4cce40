# SPDX-License-Identifier: Apache-2.0
"""Linear algebra in one thread: the matrices are small, and more threads wait for one another."""

from __future__ import annotations

import contextlib
import ctypes
from pathlib import Path

try:
    from threadpoolctl import threadpool_limits
except ModuleNotFoundError:
    threadpool_limits = None

_MAPS = Path("/proc/self/maps")  # of Linux: what the process has loaded


def one_thread() -> contextlib.AbstractContextManager:
    """Return a context within which the process's BLAS libraries run one thread each.

    threadpoolctl is used where it is installed. Without it only OpenBLAS is found, and on Linux
    only: NumPy's and SciPy's wheels and Debian bring that one.
    """
    return threadpool_limits(1) if threadpool_limits else _one_openblas_thread()


@contextlib.contextmanager
def _one_openblas_thread():
    before = [(set_threads, get_threads()) for set_threads, get_threads in _openblas()]
    for set_threads, _ in before:
        set_threads(1)
    try:
        yield
    finally:
        for set_threads, n in before:
            set_threads(n)


def _openblas():
    """For each OpenBLAS that is loaded: the functions that set and get its number of threads."""
    maps = _MAPS.read_text().splitlines() if _MAPS.exists() else []
    paths = {words[5] for line in maps if len(words := line.split(maxsplit=5)) == 6}
    for path in sorted(p for p in paths if "openblas" in p):
        try:
            library = ctypes.CDLL(path)
        except OSError:  # replaced on disk since it was loaded
            continue
        for name in ("openblas_%s_num_threads", "scipy_openblas_%s_num_threads"):
            for suffix in ("", "64_"):
                found = [getattr(library, name % verb + suffix, None) for verb in ("set", "get")]
                if all(found):
                    yield found
