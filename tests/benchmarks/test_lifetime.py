# SPDX-License-Identifier: Apache-2.0
"""Short runs of `python -m benchmarks.running.lifetime` and `soak`; options make long ones."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

DEMO = """
import os
from tactile_skin.launch import launch
out = os.dup(1)  # not for the monitor
os.dup2(2, 1)
with launch(method="auto") as skin:
    skin.on_stop(lambda stop, reason: os.write(out, b"S" if stop else b"F"))
    skin.spin()
"""


@pytest.mark.ci
@pytest.mark.parametrize(
    "words",
    [
        ("lifetime", "--runs", "48"),  # the last word is stop: each place, each one or two signals
        ("soak", "--unplug", "3", "--rate", "100"),  # a stop, and nothing is left behind
    ],
)
def test_a_short_run_is_sound(words):
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.running.{words[0]}", *words[1:]],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr


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
