# SPDX-License-Identifier: Apache-2.0
"""A touch in the terms of the social-touch field."""

import numpy as np
import pytest

from tactile_skin.touch import features
from tactile_skin.touch.geometry import make_geometry
from tactile_skin.touch.gestures import Gestures
from tactile_skin.touch.tracking import RELEASED, Tracker

PLANE = make_geometry("plane", 8, 8)
AREA = 1.44e-4  # m^2
DT = 0.01  # s


def play(frames):
    """(touch, gesture) of the last frame that told any, for (rows, cols) forces [N]."""
    tracker, gestures, told = Tracker(PLANE.pitch), Gestures(PLANE), []
    for k, force in enumerate([*frames, *[np.zeros((8, 8))] * 8]):
        frame = features.analyse_frame(force, PLANE, 0.2)
        touches = tracker.update(k * DT, frame)
        told += zip(touches, gestures.update(k * DT, frame, touches), strict=True)
    return told


def patch(newtons, row=2, col=2):
    """2 x 2 cells with so much on each."""
    force = np.zeros((8, 8))
    force[row : row + 2, col : col + 2] = newtons
    return force


def test_a_press_by_hand():
    """Three frames of 1, 3 and 2 N on each of four cells."""
    touch, gesture = play([patch(1.0), patch(3.0), patch(2.0)])[-1]
    assert touch.state == RELEASED
    assert gesture.duration == pytest.approx(2 * DT)
    assert gesture.mean_pressure == pytest.approx(2.0 / AREA)
    assert gesture.max_pressure == pytest.approx(3.0 / AREA)
    # 4 cells: up by 1 from nothing, by 2, down by 1, in 0.02 s
    assert gesture.pressure_variability == pytest.approx(4 * (1 + 2 + 1) / 0.02)
    assert gesture.contact_area == pytest.approx(4 * AREA)
    assert gesture.max_pressure_contact_area == pytest.approx(4 * AREA)
    assert gesture.peak_count == 1
    assert gesture.displacement == gesture.net_displacement == 0.0


def test_the_area_at_the_largest_force_is_that_frames():
    wide = patch(1.0)
    wide[2:4, 4:7] = 1.0
    _, gesture = play([patch(1.0), wide, patch(1.5)])[-1]
    assert gesture.max_pressure_contact_area == pytest.approx(10 * AREA)
    assert gesture.contact_area == pytest.approx((4 + 10 + 4) / 3 * AREA)


@pytest.mark.parametrize(
    ("forces", "peaks"),
    [
        ([1, 2, 3, 2, 1], 1),
        ([3, 1, 3, 1, 3], 3),
        ([3, 1, 0.5, 1, 0.5], 1),  # the later ones stay below half of the largest
        ([1, 0.3, 3, 1.0, 3], 3),
        ([2, 1.01, 0.95, 1.05, 0.9], 1),  # about half of it is no peak each time
    ],
)
def test_peaks_rise_above_half_of_the_largest_force(forces, peaks):
    _, gesture = play([patch(f) for f in forces])[-1]
    assert gesture.peak_count == peaks


def there_and_back(rng=None):
    """A finger drawn 40 mm and back in 0.8 s, or held still with noise."""
    y, x = np.mgrid[:8, :8]
    for k in range(81):
        far = 0.0 if rng else (1 - abs(k / 40 - 1)) * 0.04 / PLANE.pitch
        place = 2.0 + far + (0.01 * rng.standard_normal() if rng else 0.0)
        force = 4.0 * np.exp(-((y - 3.5) ** 2) - (x - place) ** 2)
        yield np.where(force > 0.05, force, 0.0)


def test_displacement_is_the_way_and_net_displacement_its_end():
    _, gesture = play(there_and_back())[-1]
    assert gesture.displacement == pytest.approx(0.08, rel=0.05)
    assert gesture.net_displacement < 1e-3


def test_the_centres_noise_is_no_way():
    _, gesture = play(there_and_back(np.random.default_rng(2)))[-1]
    assert gesture.displacement < 0.005


def test_a_centre_that_jumps_since_touches_join_did_not_go_there():
    arm = np.zeros((8, 8))
    arm[2:4, 2:8] = 1.0
    _, gesture = play([patch(1.0)] * 10 + [arm] * 10)[-1]
    assert gesture.net_displacement == pytest.approx(2 * PLANE.pitch)
    assert gesture.displacement == 0.0


def test_two_touches_have_a_gesture_each():
    frames = [patch(1.0) + patch(3.0 + k % 2, 5, 5) for k in range(11)]
    told = play(frames)[-2:]
    gestures = {round(touch.contact.force): gesture for touch, gesture in told}
    assert gestures[4].max_pressure == pytest.approx(1.0 / AREA)
    assert gestures[12].max_pressure == pytest.approx(4.0 / AREA)
    assert gestures[4].pressure_variability == pytest.approx(4 * 1.0 / 0.1)
    assert gestures[12].pressure_variability == pytest.approx(4 * (3.0 + 10) / 0.1)


def test_what_leaves_a_cell_changed_it():
    """A touch that moves on by a cell changes the cells that it leaves as well."""
    told = play([patch(2.0), patch(2.0, col=3)])[-1]
    assert told[1].pressure_variability == pytest.approx((4 + 2 + 2) * 2.0 / 0.01)
