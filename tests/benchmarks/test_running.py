# SPDX-License-Identifier: Apache-2.0
"""How soon the skin stops: what is counted, and what is drawn."""

import json
from pathlib import Path

import pytest

from benchmarks.doctor import watch
from benchmarks.running import touch_to_stop
from tactile_skin.simulation import scenes

CALLS = [(0.5, True, "stale"), (1.0, False, ""), (2.01, True, "push"), (2.1, True, "push + x")]


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
