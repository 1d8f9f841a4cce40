# SPDX-License-Identifier: Apache-2.0
"""Short runs of `python -m benchmarks.running.lifetime` and `soak`; options make long ones.

And how soon the skin stops: what is counted, and what is drawn.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.doctor import watch
from benchmarks.running import touch_to_stop
from tactile_skin.simulation import scenes

CALLS = [(0.5, True, "stale"), (1.0, False, ""), (2.01, True, "push"), (2.1, True, "push + x")]
DEMO = """
import os
from tactile_skin.launch import launch
out = os.dup(1)  # not for the monitor
os.dup2(2, 1)
with launch(method="auto") as skin:
    skin.on_stop(lambda stop, reason: os.write(out, b"S" if stop else b"F"))
    skin.spin()
"""


@pytest.mark.live
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


@pytest.mark.live
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


@pytest.mark.parametrize(
    ("start", "end", "found"),
    [(2.0, 2.2, 2.01), (1.5, 2.2, 2.01), (2.0, 2.005, None), (2.05, 2.2, None), (0.7, 0.9, None)],
)
def test_a_stop_counts_from_free_and_in_its_time(start, end, found):
    """One that stood already is none of the push's."""
    assert touch_to_stop._stop_after(CALLS, start, end) == found


def test_a_push_is_seen_when_the_samples_hold_it_not_when_it_is_applied():
    """The low-pass is some scans behind a force that comes at once."""
    force = scenes.finger(16, 16, 7.0, 8.0, 60.0, 1.8)
    recorder = touch_to_stop._Recorder([(0.1, 0.0, force)], seed=0)
    for _ in range(60):
        recorder.scan()
    (scans,) = recorder.scans
    first = next(k for k, (_, newtons, _) in enumerate(scans) if newtons >= 30.0)
    seen = [t for t, _, _ in scans].index(touch_to_stop._seen(scans))
    assert first == 0
    assert 2 <= seen <= 6
    assert touch_to_stop._seen(scans[:seen]) is None


def test_a_muted_board_says_nothing_and_goes_on_scanning():
    recorder = touch_to_stop._Recorder([], seed=0)
    recorder.mute = True
    assert b"".join(recorder.scan() for _ in range(20)) == b""
    assert recorder.silent_since is not None


def test_the_page_holds_the_table_of_the_run_that_it_shows():
    root = Path(__file__).parents[2]
    data = json.loads((root / "docs/bench/touch_to_stop.json").read_text())
    assert sum(entry["missed"] for entry in data["rises"]) == 0
    assert touch_to_stop.table(data) in (root / "docs/lab/stop.md").read_text()


@pytest.mark.ci
def test_a_short_that_comes_under_a_touch_is_reported_and_a_sound_skin_is_not():
    for name in ("sound", "one short"):
        seen = watch.watched("strokes", watch.SKINS[name], False, 1, 1)
        assert seen["fault"].any() == (name != "sound")
        assert seen["doubted"].mean() < 0.2 if name == "sound" else seen["fault"].argmax() <= 20
