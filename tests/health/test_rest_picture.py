# SPDX-License-Identifier: Apache-2.0
"""A matrix that is not read shows in the picture of an untouched skin."""

import numpy as np
import pytest
from health.seen import Samples

from tactile_skin import Circuit
from tactile_skin.health.rest_picture import RestPicture
from tactile_skin.physics.adc import Adc

BITS, FRACTION = 10, 64
REST = 41.0  # ADC steps
ADC = Adc(Circuit(4, 4, adc_bits=BITS))


def played(frames, rest):
    """What is said at the end of each window of frames [ADC steps]; rest [ADC steps]."""
    watch = Samples(RestPicture(ADC), BITS)
    said = [
        watch.frame(
            np.rint(np.maximum(steps, 0.0) * FRACTION).astype(np.uint16), rest / ADC.full_scale
        )
        for steps in frames
    ]
    return said[9::10]


def windows_of(picture, noise, n=200):
    """What is said in each window of n frames of a picture [ADC steps]."""
    rng = np.random.default_rng(4)
    rest = REST + np.random.default_rng(3).uniform(-3.0, 3.0, (4, 4))
    steps = (np.broadcast_to(picture(rest, k), rest.shape) for k in range(n))
    return played((s + noise * rng.standard_normal((4, 4)) for s in steps), rest)


@pytest.mark.parametrize("level", [REST, REST + 7.0, 300.0])
def test_one_voltage_is_told_at_whatever_height(level):
    said = windows_of(lambda rest, k: rest if k < 100 else level, 1.0)
    assert not any(said[:10]) and all("one voltage" in text for text in said[10:])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("read", [0, 3])
def test_readings_below_the_range_say_nothing(read):
    """They are 0; few that are left are no picture."""
    few = np.arange(16).reshape(4, 4) < read
    said = windows_of(lambda rest, k: 300.0 if k < 100 else np.where(few, rest, -9.0), 0.0)
    assert all(said[:10]) and not any(said[10:])


@pytest.mark.parametrize("share", [1.1, 1.25])
def test_a_fabric_that_warms_up_lifts_it_by_less(share):
    assert not any(windows_of(lambda rest, k: rest * share, 0.5))


@pytest.mark.parametrize("noise", [0.3, 1.0, 2.0])
def test_a_skin_is_no_one_voltage_at_rest_or_under_an_even_load(noise):
    uneven = np.random.default_rng(5).normal(1.0, 0.05, (4, 4))
    assert not any(windows_of(lambda rest, k: rest + 0.3 * k * uneven, noise, 2000))


@pytest.mark.parametrize(("scatter", "steep", "begins"), [(0.05, 1.0, 0), (0.02, 2.0, 5)])
def test_a_palm_that_covers_a_small_skin_is_no_noise(scatter, steep, begins):
    """It moves all readings at once, and by much more than they differ."""
    uneven = np.random.default_rng(5).normal(1.0, scatter, (4, 4))

    def picture(rest, k):  # presses for 0.6 s of each 0.8 s
        phase = (k + begins) % 80 / 60.0
        return rest + 450.0 * uneven * np.clip(steep * np.sin(np.pi * phase), 0.0, 1.0)

    assert not any(windows_of(picture, 1.0, 2000))


def test_a_skin_that_rests_all_alike_cannot_be_told_from_one_voltage():
    assert played([np.full((4, 4), 41.0)] * 10, np.full((4, 4), 41.0)) == [""]


def quiet_windows(scatter, seed, dead, noise=2.0, n=400):
    """The same of 4 x 4 cells that rest about as far apart [ADC steps] as one reading's noise."""
    rng = np.random.default_rng(seed)
    rest = 92.0 + scatter * rng.standard_normal((4, 4))
    measured = rest + noise / 40**0.5 * rng.standard_normal((4, 4))
    frames = []
    for k in range(n):
        touch = 200.0 * (np.arange(16).reshape(4, 4) == k // 60 % 16) * (k % 60 > 30)
        steps = 85.0 if dead and k >= n // 2 else rest + touch
        steps = steps + noise * rng.standard_normal((4, 4))
        frames.append(np.rint(steps))
    return played(frames, measured)


@pytest.mark.parametrize("seed", range(20))
def test_on_a_small_skin_one_voltage_is_told_past_the_noise(seed):
    """Within a second; of a noisy board a single window does not tell it for good."""
    said = quiet_windows(1.8, seed, dead=True)
    assert not any(said[:20])
    assert all("one voltage" in text for text in said[30:])


@pytest.mark.parametrize("seed", range(20))
def test_a_sound_small_skin_is_believed_whatever_its_noise(seed):
    for scatter in (0.9, 1.8, 4.0):
        assert not any(quiet_windows(scatter, seed, dead=False))
