"""The noise of a skin is measured while nothing touches, and a noisy cell is named."""

import numpy as np
import pytest

from tactile_skin.calibration.noise import Noise

SHAPE = (8, 12)
CELLS = np.ones(SHAPE, bool)


def measured(rng, noise, frames=200, moving=0.0):
    watch = Noise(CELLS)
    for k in range(frames):
        steps = 40.0 + moving * k + noise * rng.standard_normal(SHAPE)
        watch.frame(0.01 * k, steps, False)
    return watch


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.mark.parametrize("rms", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("moving", [0.0, 0.001])
def test_the_noise_is_that_of_the_readings(rng, rms, moving):
    """A slow drift is none."""
    found = measured(rng, rms, moving=moving)
    assert found.rms == pytest.approx(rms, rel=0.1)
    assert not found.noisy.any()


def test_a_low_pass_on_the_board_does_not_hide_it(rng):
    watch, steps = Noise(CELLS), np.full(SHAPE, 40.0)
    for k in range(1000):
        steps = steps + 0.2 * (40.0 + rng.standard_normal(SHAPE) - steps)
        watch.frame(0.01 * k, steps, False)
    assert watch.rms == pytest.approx((0.2 / 1.8) ** 0.5, rel=0.1)


def test_a_few_frames_say_nothing(rng):
    assert measured(rng, 1.0, frames=20).rms is None


def test_a_touch_and_what_follows_it_do_not_count(rng):
    watch = Noise(CELLS)
    for k in range(600):
        phase = k % 200
        touched, recovers = phase < 50, 50 <= phase < 90
        steps = 40.0 + (300.0 * touched + 30.0 * recovers) * rng.random(SHAPE)
        watch.frame(0.01 * k, steps + rng.standard_normal(SHAPE), touched)
    assert watch.rms == pytest.approx(1.0, rel=0.15)
    assert not watch.noisy.any()


def test_a_noisy_cell_is_found(rng):
    noise = np.ones(SHAPE)
    noise[2, 5] = 15.0
    found = measured(rng, noise)
    assert np.argwhere(found.noisy).tolist() == [[2, 5]]
    assert found.rms == pytest.approx(1.0, rel=0.1)
    assert found.each[2, 5] == pytest.approx(15.0, rel=0.2)
    assert np.median(found.each) == found.rms


def test_where_many_are_noisy_it_is_the_skin(rng):
    assert not measured(rng, np.where(rng.random(SHAPE) < 0.3, 15.0, 1.0)).noisy.any()
