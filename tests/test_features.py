"""What a push is, in the robot's frame."""

import numpy as np
import pytest

from tactile_skin import features
from tactile_skin.geometry import make_geometry
from tactile_skin.scenes import finger

PLANE = make_geometry("plane", 16, 16)
CYLINDER = make_geometry("cylinder", 16, 16, radius=0.15)
THRESHOLD = 0.05


def test_nothing_touched_is_no_push():
    push = features.push(np.zeros((16, 16)), PLANE, THRESHOLD)
    assert not push.force.any() and not push.direction.any() and push.confidence == 0.0
    assert features.contacts(np.zeros((16, 16)), PLANE, THRESHOLD) == []


def test_a_push_on_the_front_points_backward_with_its_force():
    push = features.push(finger(16, 16, 7.5, 7.5, 12.0), PLANE, 0.0)
    np.testing.assert_allclose(push.force, [-12.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(push.direction, [-1.0, 0.0, 0.0], atol=1e-12)


def test_torque_is_position_times_force():
    force = np.zeros((16, 16))
    force[2, 12] = 4.0
    push = features.push(force, CYLINDER, THRESHOLD)
    expected = np.cross(CYLINDER.position[2, 12], -4.0 * CYLINDER.normal[2, 12])
    np.testing.assert_allclose(push.torque, expected, atol=1e-12)
    np.testing.assert_allclose(push.centre, CYLINDER.position[2, 12])


@pytest.mark.parametrize("col", [2.0, 7.5, 13.0])
def test_on_a_cylinder_the_push_comes_from_where_it_touches(col):
    push = features.push(finger(16, 16, 7.5, col, 10.0), CYLINDER, 0.0)
    azimuth = (col - 7.5) * 0.018 / 0.15
    expected = [-np.cos(azimuth), -np.sin(azimuth), 0.0]
    assert np.degrees(np.arccos(push.direction @ expected)) < 1.0
    assert push.confidence > 0.9


def test_a_squeeze_has_no_direction_to_trust():
    ring = make_geometry("cylinder", 4, 16, radius=16 * 0.018 / (2 * np.pi) + 1e-9)
    force = np.zeros((4, 16))
    force[1, 3] = force[1, 11] = 9.0
    push = features.push(force, ring, THRESHOLD)
    assert push.confidence < 1e-6
    assert sum(c.force for c in features.contacts(force, ring, THRESHOLD)) == pytest.approx(18.0)


def test_contacts_are_patches_strongest_first():
    force = finger(16, 16, 3.0, 3.0, 4.0) + finger(16, 16, 11.0, 12.0, 9.0)
    found = features.contacts(force, PLANE, THRESHOLD)
    assert len(found) == 2
    assert found[0].force > found[1].force
    np.testing.assert_allclose(found[0].position[1:], [4.5 * 0.018, -3.5 * 0.018], atol=1e-4)
    touched = np.count_nonzero(force[8:] > 0.1 * THRESHOLD)
    assert found[0].area == pytest.approx(touched * PLANE.cell_area)
    assert found[0].peak == force.max()


def test_a_stroke_has_the_velocity_of_the_finger():
    stroke = features.Stroke()
    velocity, confidence = np.zeros(3), 0.0
    for k in range(30):
        t = 0.01 * k
        force = finger(16, 16, 7.5, 3.0 + 20.0 * t, 5.0)  # 20 columns a second
        velocity, confidence = stroke.update(t, features.contacts(force, PLANE, 0.01))
    np.testing.assert_allclose(velocity, [0.0, 20.0 * 0.018, 0.0], atol=0.02)
    assert confidence > 0.9


def test_a_finger_that_stands_still_or_changes_is_no_stroke():
    stroke = features.Stroke()
    rng = np.random.default_rng(1)
    for k in range(30):
        force = finger(16, 16, 7.5 + 0.01 * rng.standard_normal(), 5.0, 5.0)
        _, confidence = stroke.update(0.01 * k, features.contacts(force, PLANE, 0.01))
    assert confidence < 0.1
    jumped = features.contacts(finger(16, 16, 2.0, 13.0, 5.0), PLANE, 0.01)
    assert stroke.update(0.30, jumped) == (pytest.approx(np.zeros(3)), 0.0)
    assert stroke.update(0.31, jumped * 2)[1] == 0.0


def test_a_contact_has_its_rim_and_noise_is_no_contact():
    """A light fingertip keeps its whole force; cells that never reach the threshold are none."""
    force = finger(16, 16, 5.0, 5.0, 4.0)
    force[12, 12] = 0.9 * 0.2
    (contact,) = features.contacts(force, PLANE, 0.2)
    assert contact.force == pytest.approx(4.0, rel=0.03)
    assert features.push(force, PLANE, 0.2).force[0] == pytest.approx(-contact.force)
