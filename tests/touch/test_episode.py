# SPDX-License-Identifier: Apache-2.0
"""The features of a gesture are what they say, and mean the same on another mat."""

import numpy as np
import pytest

from tactile_skin.touch.episode import FEATURES, SILENCE, Episode

PERIOD, PITCH, SHAPE = 0.04, 0.018, (16, 16)


def described(pictures, period=PERIOD, pitch=PITCH) -> dict[str, float]:
    episode = Episode(pictures.shape[1:], pitch, period)
    for picture in pictures:
        episode.add(picture)
    return dict(zip(FEATURES, episode.features(), strict=True))


def spot(row, col, force=1.0, shape=SHAPE, radius=1.5) -> np.ndarray:
    rows, cols = np.indices(shape)
    cap = np.maximum(1.0 - ((rows - row) ** 2 + (cols - col) ** 2) / radius**2, 0.0)
    return force * cap / cap.sum()


def test_a_stroke_has_the_length_and_the_speed_of_its_way():
    way = np.linspace(2.0, 12.0, 26)  # 10 pitches in 25 steps
    seen = described(np.array([spot(7.0, col) for col in way]))
    length = 10 * PITCH
    assert np.exp(seen["path"]) == pytest.approx(length, rel=0.1)
    assert np.exp(seen["net_path"]) == pytest.approx(length, rel=0.1)
    assert np.exp(seen["speed"]) == pytest.approx(length / (26 * PERIOD), rel=0.1)
    assert seen["straightness"] == pytest.approx(1.0, abs=0.05)
    assert seen["reversals"] == 0.0 and seen["turning"] > 0.9


def test_a_rub_turns_back_and_has_its_frequency():
    t = np.arange(0.0, 2.0, PERIOD)
    seen = described(np.array([spot(7.0, 7.0 + 3.0 * np.sin(2 * np.pi * 2.0 * s)) for s in t]))
    assert seen["place_main_frequency"] == pytest.approx(2.0, abs=0.3)
    assert seen["reversal_rate"] == pytest.approx(4.0, abs=1.0)
    assert seen["straightness"] < 0.3


def test_pats_are_counted():
    force = np.tile([0.0, 4.0, 8.0, 4.0, 0.0, 0.0, 0.0], 3)[1:]
    seen = described(np.array([spot(7.0, 7.0, f) if f else np.zeros(SHAPE) for f in force]))
    assert np.exp(seen["bouts"]) == pytest.approx(3.0)
    assert seen["bout_rate"] * np.exp(seen["duration"]) == pytest.approx(3.0)
    assert np.exp(seen["peaks"]) == pytest.approx(3.0)
    assert np.exp(seen["force_max"]) == pytest.approx(8.0, rel=1e-3)


def test_two_fingers_are_two_hills():
    seen = described(np.array([spot(4.0, 4.0) + spot(4.0, 11.0)] * 10))
    assert seen["hills_mean"] == 2.0
    assert seen["lifted"] == pytest.approx(0.0) and seen["plateau"] == 1.0


def test_where_it_is_on_the_skin_says_nothing():
    here = np.array([spot(5.0, col) for col in np.linspace(3.0, 8.0, 12)])
    there = np.roll(here, (4, 5), (1, 2))
    turned = here.transpose(0, 2, 1)
    expected = described(here)
    assert described(there) == pytest.approx(expected, abs=1e-6)
    assert described(turned) == pytest.approx(expected, abs=1e-6)


def test_more_force_moves_only_what_is_a_force():
    pictures = np.array([spot(5.0, col) for col in np.linspace(3.0, 8.0, 12)])
    one, ten = described(pictures), described(10.0 * pictures)
    moved = {name for name in FEATURES if abs(ten[name] - one[name]) > 1e-3}
    assert moved == {
        *("force_mean", "force_max", "peak_mean", "peak_max"),
        *("pressure", "rise", "change"),
    }
    assert ten["force_mean"] - one["force_mean"] == pytest.approx(np.log(10.0), abs=1e-4)


def test_silence_counts_but_changes_nothing_else():
    pictures = np.array([spot(5.0, 5.0)] * 5)
    quiet = np.zeros((20, *SHAPE))
    before, after = described(pictures), described(np.concatenate([pictures, quiet]))
    assert after.pop("silence") == pytest.approx(SILENCE)
    assert before.pop("silence") == 0.0
    assert after == pytest.approx(before)


def test_an_episode_without_a_touch_has_no_features():
    assert set(described(np.zeros((5, *SHAPE))).values()) == {0.0}


def test_features_are_finite_for_any_touch():
    rng = np.random.default_rng(3)
    for _ in range(60):
        steps, shape = rng.integers(1, 30), tuple(rng.integers(1, 9, 2))
        pictures = rng.exponential(1.0, (steps, *shape)) * (rng.random((steps, *shape)) < 0.3)
        assert np.isfinite(list(described(pictures).values())).all()
