# SPDX-License-Identifier: Apache-2.0
"""The linear algebra of a running skin has one thread, with threadpoolctl and without."""

import pytest

from tactile_skin.middleware import threads

threadpoolctl = pytest.importorskip("threadpoolctl")


def blas() -> list[int]:
    import scipy.linalg  # noqa: F401  has a BLAS of its own

    return [p["num_threads"] for p in threadpoolctl.threadpool_info() if p["user_api"] == "blas"]


@pytest.mark.parametrize("there", [True, False])
def test_one_thread_within_the_context_and_as_before_after_it(there, monkeypatch):
    if not there:
        monkeypatch.setattr(threads, "threadpool_limits", None)
        if not list(threads._openblas()):
            pytest.skip("NumPy and SciPy use no OpenBLAS")
    with threadpoolctl.threadpool_limits(2):
        assert set(blas()) == {2}
        with threads.one_thread():
            assert set(blas()) == {1}
        assert set(blas()) == {2}


def test_elsewhere_than_on_linux_nothing_is_changed(monkeypatch, tmp_path):
    monkeypatch.setattr(threads, "threadpool_limits", None)
    monkeypatch.setattr(threads, "_MAPS", tmp_path / "maps")
    with threads.one_thread():
        assert list(threads._openblas()) == []
