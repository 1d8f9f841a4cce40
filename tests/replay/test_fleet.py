# SPDX-License-Identifier: Apache-2.0
"""Many recordings, takes and parts: in a loop, or by joblib on whatever the caller has."""

import os
import sys

import joblib
import numpy as np
import pytest
from test_replay import write

from tactile_skin import cli
from tactile_skin.extras import each
from tactile_skin.learning.gestures import table_of
from tactile_skin.replay.results import Job, collect
from tactile_skin.touch.take import Take

pytestmark = pytest.mark.usefixtures("joblib_keeps_no_process")


def process(_) -> int:
    return os.getpid()


def replayed(path: str) -> np.ndarray:
    return collect(Job(path)).total


def takes(n: int) -> list[Take]:
    """Presses of a few cells, each harder than the last."""
    pictures = np.zeros((n, 40, 8, 8))
    pictures[:, 10:30, 3:5, 3:5] = 1.0 + np.arange(n)[:, None, None, None]
    return [Take("press", "me", one, 0.02, 0.018) for one in pictures]


def test_a_loop_is_the_default_and_needs_no_joblib(monkeypatch):
    monkeypatch.delitem(sys.modules, "joblib")
    assert [*each(abs, [-1, 2])] == [1, 2]
    assert "joblib" not in sys.modules
    monkeypatch.setitem(sys.modules, "joblib", None)
    with pytest.raises(ModuleNotFoundError, match=r"2 processes need joblib: pip install 'tact"):
        each(abs, [-1], 2)
    with pytest.raises(ValueError, match="jobs = 0: must be 1 or more"):
        each(abs, [-1], 0)


def test_the_callers_backend_does_the_work():
    with joblib.parallel_config("threading", n_jobs=2):
        assert [*each(process, range(3))] == [os.getpid()] * 3
    assert os.getpid() not in each(process, range(3), 2)


@pytest.mark.ci
def test_processes_share_a_recording(tmp_path):
    """With their lead of 10 s each begins with it all here, and so all are the same."""
    path = str(write(tmp_path / "a.mcap"))
    one, two = (collect(Job(path), jobs) for jobs in (1, 2))
    np.testing.assert_array_equal(one.stamps, two.stamps)
    np.testing.assert_allclose(one.total, two.total)
    np.testing.assert_array_equal(one.stops, two.stops)
    assert len(one.stop_begins) == 2


def test_several_recordings_are_replayed_and_a_damaged_one_is_named(tmp_path, capsys):
    paths = [str(write(tmp_path / f"{name}.mcap", 0.3)) for name in "ab"]
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(b"no recording")
    assert cli.main(["replay", paths[0], str(bad), paths[1], "method:=naive"]) == 1
    out, err = capsys.readouterr()
    assert out.count("readings  30 of 0.3 s") == 2 and all(f"{path}:\n" in out for path in paths)
    assert err.startswith(f"{bad}: ")
    assert cli.main(["replay", *paths, "--compare", "naive", "fixed_point"]) == 0
    assert capsys.readouterr().out.count("fixed_point") == 2


@pytest.mark.ci
def test_a_dask_cluster_does_the_same_work(tmp_path):
    """Recordings, and the features of takes; nothing of ours knows of it."""
    distributed = pytest.importorskip("distributed")
    paths = [str(write(tmp_path / f"{name}.mcap", 0.3)) for name in "abc"]
    here, table = [replayed(path) for path in paths], table_of(takes(4))
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config("dask"),
    ):
        workers = set(each(process, range(8)))
        there, again = [*each(replayed, paths)], table_of(takes(4))
    assert workers and os.getpid() not in workers
    np.testing.assert_array_equal(there, here)
    np.testing.assert_array_equal(again.features, table.features)
