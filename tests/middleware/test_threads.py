# SPDX-License-Identifier: Apache-2.0
"""The linear algebra of a running skin has one thread."""

import os
import subprocess
import sys

import scipy.linalg  # noqa: F401  has a BLAS of its own
from threadpoolctl import threadpool_info, threadpool_limits

from tactile_skin.middleware import threads


def blas() -> set[int]:
    return {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}


def test_one_thread_within_the_context_and_as_before_after_it():
    with threadpool_limits(2):
        assert blas() == {2}
        with threads.one_thread():
            assert blas() == {1}
        assert blas() == {2}


def test_a_program_has_one_thread_without_threadpoolctl():
    """As where rosdep has installed what it needs."""
    code = """
import sys
from tactile_skin import __main__
__main__._loaded("cli")
import scipy.linalg
from threadpoolctl import threadpool_info
print({p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"})
"""
    kept = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], env=kept, capture_output=True, text=True)
    assert done.stdout == "{1}\n", done.stderr
