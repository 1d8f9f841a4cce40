"""A short soak: the long ones are `python tests/soak.py --minutes 30` and `--unplug 200`."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("soak.py")


def soak(*words) -> None:
    done = subprocess.run([sys.executable, SCRIPT, *words], capture_output=True, text=True)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


def test_an_unplugged_board_stops_the_robot_and_leaves_nothing_behind():
    soak("--unplug", "3", "--rate", "100")


@pytest.mark.slow
def test_a_minute_at_100_frames_a_second_misses_none():
    soak("--minutes", "1", "--rate", "100")


@pytest.mark.slow
def test_fifty_unplugged_boards_leave_nothing_behind():
    soak("--unplug", "50", "--rate", "100")
