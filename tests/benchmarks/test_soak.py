# SPDX-License-Identifier: Apache-2.0
"""A short soak; long ones: `python -m benchmarks.running.soak --minutes 30`, `--unplug 200`."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

SCRIPT, ROOT = "benchmarks.running.soak", Path(__file__).parents[2]


def soak(*words) -> None:
    done = subprocess.run(
        [sys.executable, "-m", SCRIPT, *words], cwd=ROOT, capture_output=True, text=True
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.ci
def test_an_unplugged_board_stops_the_robot_and_leaves_nothing_behind():
    soak("--unplug", "3", "--rate", "100")


@pytest.mark.slow
def test_a_minute_at_100_frames_a_second_misses_none():
    soak("--minutes", "1", "--rate", "100")


@pytest.mark.slow
def test_fifty_unplugged_boards_leave_nothing_behind():
    soak("--unplug", "50", "--rate", "100")
