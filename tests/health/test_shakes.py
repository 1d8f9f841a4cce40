# SPDX-License-Identifier: Apache-2.0
"""A cell that swings about its rest is a cover that shakes; one that is lost, or loose, is not."""

import numpy as np
import pytest

from tactile_skin.health.untouched import Shakes

NOISE, SWING = 1.0, 30.0  # ADC steps


def covered(course, since=4.0, seconds=12.0, rate=20.0):
    """Return the share of times, after some [s], at which a low reading is one that shakes."""
    shakes, rng, found = Shakes((1, 1)), np.random.default_rng(3), []
    for k in range(round(seconds * rate)):
        t = k / rate
        off = np.full((1, 1), course(t) + NOISE * rng.standard_normal())
        if t > since and off < -5.0 * NOISE:
            found.append(bool(shakes.covers(t, off)[0, 0]))
        shakes.frame(t, off, NOISE)
    return np.mean(found)


@pytest.mark.parametrize("hertz", [0.3, 1.1, 7.0])
def test_a_swing_that_beats_with_the_frame_rate_is_one(hertz):
    assert covered(lambda t: SWING * np.sin(2.0 * np.pi * hertz * t)) > 0.95


@pytest.mark.parametrize(
    "course",
    [
        lambda t: -SWING,
        lambda t: -SWING * (t > 6.0),
        lambda t: -SWING * (np.sin(7.0 * t) > 0.0),
    ],
    ids=["from the start", "later", "a loose contact"],
)
def test_a_reading_that_is_lost_is_none(course):
    assert covered(course) < 0.05


def test_a_loss_that_is_deeper_than_the_swing_is_none():
    def course(t):
        return SWING * np.sin(3.0 * t) if t < 6.0 else -3.0 * SWING

    assert covered(course, since=6.1) < 0.05


def test_a_clock_may_be_set_back():
    shakes, low = Shakes((1, 1)), np.full((1, 1), -SWING)
    for t in (100.0, 100.1, 100.2):
        shakes.frame(t, low if t < 100.2 else -low, NOISE)
    assert shakes.covers(100.3, low)
    shakes.frame(1.0, -low, NOISE)
    assert shakes.covers(1.1, low) and not shakes.covers(20.0, low)
