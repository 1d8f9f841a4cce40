# SPDX-License-Identifier: Apache-2.0
"""What holds for every test."""

import importlib.util
import logging
import os
import shutil
import signal
import subprocess
import threading
import time

import pytest
from hypothesis import settings
from support import machine

# The matrices are small: BLAS's threads would wait for one another. Before NumPy is imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


# The same examples on every run, so that a change is what fails; look for new ones by
# `pytest --hypothesis-profile=search`.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None, max_examples=1000)
settings.load_profile("same")


def pytest_addoption(parser):
    parser.addoption(
        "--require-ros", action="store_true", help="fail, not skip, what needs ROS and finds none"
    )
    parser.addoption("--live", action="store_true", help="only what `-n` leaves: in real time")


def pytest_configure(config):
    # An exception that ends a thread fails the test that started the thread.
    config.addinivalue_line("filterwarnings", "error::pytest.PytestUnhandledThreadExceptionWarning")
    if config.option.markexpr == "ci":
        config.option.markexpr = "ci and not slow"  # a case of a long test may be slow
    if getattr(config.option, "dist", "no") == "load":
        config.option.dist = "loadscope"  # what a module prepares for its tests is prepared once


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Leave what runs in real time out of parallel runs, for a run of its own.

    What is heard of other processes in time is heard again if the computer stood still.
    """
    live, parallel = config.getoption("live"), "PYTEST_XDIST_WORKER" in os.environ
    if live or parallel:
        kept = [item for item in items if bool(item.get_closest_marker("live")) == live]
        config.hook.pytest_deselected(items=list(set(items).difference(kept)))
        items[:] = kept
    for item in items:
        if item.get_closest_marker("ros"):
            item.add_marker(pytest.mark.flaky(reruns=3, condition=machine.stood_still))


@pytest.fixture(scope="session")
def rclpy(request):
    """ROS 2, which the test needs."""
    if not importlib.util.find_spec("rclpy"):
        if request.config.getoption("--require-ros"):
            pytest.fail("rclpy cannot be imported")
        pytest.skip("rclpy is not installed: see .ci/run")


@pytest.fixture
def graph(rclpy, monkeypatch):
    """ROS on this machine alone, for the test's own process as well."""
    from support.ros_graph import Graph

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with Graph() as graph:
        yield graph


@pytest.fixture
def ros2(request, graph):
    """A function that runs `ros2` to its end and returns what it says."""
    if not (program := shutil.which("ros2")):
        if request.config.getoption("--require-ros"):
            pytest.fail("ros2 is not installed")
        pytest.skip("ros2 is not installed: see .ci/ros")

    def run(*words) -> str:
        words = [program, *map(str, words)]
        done = subprocess.run(words, env=graph.env, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return done.stdout + done.stderr

    return run


@pytest.fixture
def plain(graph):
    """A node of rclpy alone, in the test's own process."""
    from support.plain import Plain

    with Plain(graph.env) as plain:
        yield plain


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup():
    machine.begin()


@pytest.fixture
def joblib_keeps_no_process(no_thread_outlives_its_test):
    """End the processes that joblib keeps for the next call."""
    yield
    pytest.importorskip("joblib").externals.loky.get_reusable_executor().shutdown()


def _ours(thread: threading.Thread) -> bool:
    """Whether the thread would hold the process back, or is one of the skin's own."""
    return not thread.daemon or thread.name.startswith(("node ", "serial "))


@pytest.fixture(autouse=True)
def no_thread_outlives_its_test():
    """A test that leaves a node, a reader or a thread of its own running fails."""
    before = set(threading.enumerate())
    yield
    deadline = time.monotonic() + 5.0
    for thread in set(threading.enumerate()) - before:
        if _ours(thread):
            thread.join(max(0.0, deadline - time.monotonic()))
    left = [t.name for t in set(threading.enumerate()) - before if _ours(t)]
    assert not left, f"still running: {', '.join(left)}"


@pytest.fixture
def call(capfd):
    """A function that runs a command in this process: (status, standard output, errors).

    What `main` does not catch, a user would see as a traceback; here it fails the test. What it
    sets of signals and logging, other tests do not see.
    """
    from tactile_skin.cli import main

    kept = {s: signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level

    def call(*words):
        try:
            status = main(list(map(str, words)))
        except SystemExit as end:  # argparse
            status = end.code
        out, err = capfd.readouterr()
        assert "Traceback" not in out + err
        return status, out, err

    yield call
    root.handlers[:], root.level = handlers, level
    for number, handler in kept.items():
        signal.signal(number, handler)
