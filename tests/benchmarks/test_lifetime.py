# SPDX-License-Identifier: Apache-2.0
"""Processes that are ended by signals: the last word is stop, and nothing is left."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

SCRIPT, ROOT = "benchmarks.running.lifetime", Path(__file__).parents[2]
DEMO = """
import os
from tactile_skin.launch import launch
out = os.dup(1)  # not for the monitor
os.dup2(2, 1)
with launch(method="auto") as skin:
    skin.on_stop(lambda stop, reason: os.write(out, b"S" if stop else b"F"))
    skin.spin()
"""


def lifetime(*words) -> None:
    done = subprocess.run(
        [sys.executable, "-m", SCRIPT, *words], cwd=ROOT, capture_output=True, text=True
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.ci
def test_the_last_word_is_stop():
    """Each place with each single and doubled signal."""
    lifetime("--runs", "48")


@pytest.mark.slow
def test_the_last_word_is_stop_in_300_runs():
    lifetime("--runs", "300", "--seed", "2")


@pytest.mark.slow
def test_the_last_word_is_stop_in_time_also_with_hooks_that_hang():
    lifetime("--runs", "36", "--hang")


@pytest.mark.slow
def test_the_demo_is_free_within_3_s_and_gone_within_1():
    """With its simulated board, in a process that has loaded nothing yet."""
    for _ in range(5):
        start = time.monotonic()
        with subprocess.Popen(
            [sys.executable, "-c", DEMO], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            said = b""
            while b"F" not in said:
                said += process.stdout.read1(100)
            free = time.monotonic()
            process.terminate()
            said += process.stdout.read()
            assert process.wait() == 0
        over = time.monotonic()
        print(f"free after {free - start:.2f} s, gone after {over - free:.2f} s")
        assert said.endswith(b"S")
        assert free - start < 3.0
        assert over - free < 1.0
