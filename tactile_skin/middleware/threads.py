# SPDX-License-Identifier: Apache-2.0
"""Linear algebra in one thread: the matrices are small, and more threads wait for one another."""

from __future__ import annotations

import contextlib


def one_thread() -> contextlib.AbstractContextManager:
    """Return a context within which the process's BLAS libraries run one thread each.

    rosdep knows no threadpoolctl: without it the programs' environment says so (__main__.py).
    """
    try:
        from threadpoolctl import threadpool_limits
    except ModuleNotFoundError:
        return contextlib.nullcontext()
    return threadpool_limits(1)
