# SPDX-License-Identifier: Apache-2.0
"""Touches of two mats as those of one body."""

import numpy as np
import pytest

from tactile_skin.body.touches import BodyTracker, Piece, reaches
from tactile_skin.touch.geometry import make_geometry

PITCH = 0.018  # m
MIDDLE = (
    4.25 * PITCH
)  # m from the seam to the middle of each mat of 8 columns: a gap of half a cell


def mat(middle: float, shape="plane"):
    return make_geometry(shape, 8, 8, PITCH, 0.012**2, translation=(0.0, middle, 0.0))


@pytest.fixture
def body():
    return BodyTracker({"right": mat(-MIDDLE), "left": mat(MIDDLE)})


def piece(number: int, y: float, force=5.0, z=0.0) -> Piece:
    return Piece(number, np.array([0.0, y, z]), force, 0.0004, force / 3)


def test_neighbours_follow_from_where_the_cells_are():
    near = reaches({"right": mat(-MIDDLE), "left": mat(MIDDLE)})
    assert near["right"].keys() == {"left"}
    assert near["left"]["right"] == pytest.approx(1.5 * PITCH + 0.75 * PITCH)
    assert reaches({"right": mat(-0.2), "left": mat(0.2)}) == {}
    assert reaches({"right": mat(-MIDDLE), "left": mat(MIDDLE, "unknown")}) == {}


def test_a_finger_on_the_seam_is_one_touch_of_both_forces(body):
    body.update(0.0, "right", [piece(1, -0.014, 6.0)])
    body.update(0.005, "left", [piece(1, 0.014, 2.0)])
    (touch,) = body.touches()
    assert (touch.id, touch.force, touch.skin) == (1, 8.0, "right")
    assert touch.position[1] == pytest.approx(-0.007)


def test_it_keeps_its_id_over_a_gap_where_no_mat_feels_it(body):
    """It leaves one mat at 0.2 m/s, and comes to the other 0.1 s later."""
    for k in range(10):
        body.update(0.01 * k, "right", [piece(1, -0.032 + 0.002 * k)])
    assert body.touches()[0].velocity[1] == pytest.approx(0.2)
    body.update(0.1, "right", [])
    assert body.touches() == []
    body.update(0.19, "left", [piece(7, 0.014)])
    assert [touch.id for touch in body.touches()] == [1]


@pytest.mark.parametrize(("t", "y"), [(0.3, 0.014), (0.06, 0.06)])
def test_what_comes_too_late_or_too_far_off_is_another(body, t, y):
    body.update(0.0, "right", [piece(1, -0.014)])
    body.update(0.05, "right", [])
    body.update(t, "left", [piece(1, y)])
    assert [touch.id for touch in body.touches()] == [2]


def test_two_fingers_that_cross_side_by_side_keep_their_ids(body):
    fingers = [piece(1, -0.014, z=-0.05), piece(2, -0.014, z=0.05)]
    body.update(0.0, "right", fingers)
    body.update(0.01, "right", [])
    body.update(0.02, "left", [piece(1, 0.014, z=0.05), piece(2, 0.014, z=-0.05)])
    found = {touch.id: touch.position[2] for touch in body.touches()}
    assert found == {1: pytest.approx(-0.05), 2: pytest.approx(0.05)}


@pytest.mark.parametrize(("t", "ids"), [(0.99, [1]), (1.1, [])])
def test_a_mat_that_falls_silent_is_touched_for_as_long_as_stale_after_allows(body, t, ids):
    body.update(0.0, "right", [piece(1, -0.1)])
    body.update(t, "left", [])
    assert [touch.id for touch in body.touches()] == ids


def test_the_same_touch_that_comes_back_on_one_mat_has_its_id(body):
    body.update(0.0, "right", [piece(1, -0.1), piece(2, -0.05)])
    body.update(0.5, "right", [piece(1, -0.08)])  # the other has joined it
    body.update(1.0, "right", [piece(1, -0.1), piece(2, -0.05)])
    assert sorted(touch.id for touch in body.touches()) == [1, 2]
