# SPDX-License-Identifier: Apache-2.0
"""What a push is, in the robot's frame."""

import hypothesis
import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import strategies as st
from scipy import ndimage

from tactile_skin.simulation.scenes import finger
from tactile_skin.touch import features
from tactile_skin.touch.geometry import make_geometry

PLANE = make_geometry("plane", 16, 16)
CYLINDER = make_geometry("cylinder", 16, 16, radius=0.15)
THRESHOLD = 0.05


def push(force, geometry, threshold=THRESHOLD):
    return features.analyse_frame(force, geometry, threshold).push


def contacts(force, geometry=PLANE, threshold=THRESHOLD):
    return features.analyse_frame(force, geometry, threshold).contacts


# --- push ---


def test_nothing_touched_is_no_push():
    frame = features.analyse_frame(np.zeros((16, 16)), PLANE, THRESHOLD)
    assert not frame.push.force.any() and not frame.push.direction.any()
    assert frame.push.confidence == 0.0
    assert frame.contacts == [] and not frame.labels.any()


def test_the_push_is_that_of_all_contacts():
    """Force, torque and centre of two contacts add up over all touched cells."""
    force = finger(16, 16, 3.0, 3.0, 4.0) + finger(16, 16, 11.0, 12.0, 9.0)
    felt = push(force, CYLINDER, 1e-6)
    inward = -force[..., None] * CYLINDER.normal
    np.testing.assert_allclose(felt.force, inward.sum((0, 1)), atol=1e-12)
    np.testing.assert_allclose(
        felt.torque, np.cross(CYLINDER.position, inward).sum((0, 1)), atol=1e-12
    )
    centre = (force[..., None] * CYLINDER.position).sum((0, 1)) / force.sum()
    np.testing.assert_allclose(felt.centre, centre, atol=1e-12)


@pytest.mark.parametrize("col", [2.0, 7.5, 13.0])
def test_on_a_cylinder_the_push_comes_from_where_it_touches(col):
    felt = push(finger(16, 16, 7.5, col, 10.0), CYLINDER, 1e-6)
    azimuth = (col - 7.5) * 0.018 / 0.15
    expected = [-np.cos(azimuth), -np.sin(azimuth), 0.0]
    assert np.degrees(np.arccos(felt.direction @ expected)) < 1.0
    assert felt.confidence > 0.9


def test_a_squeeze_has_no_direction_to_trust():
    ring = make_geometry("cylinder", 4, 16, radius=16 * 0.018 / (2 * np.pi) + 1e-9)
    force = np.zeros((4, 16))
    force[1, 3] = force[1, 11] = 9.0
    assert push(force, ring).confidence < 1e-6
    assert sum(c.force for c in contacts(force, ring)) == pytest.approx(18.0)


def test_a_light_touch_has_less_confidence():
    light, firm = (push(finger(16, 16, 7.0, 7.0, f), PLANE, 0.2).confidence for f in (2.0, 20.0))
    assert 0.3 < light < 0.6 < 0.9 < firm <= 1.0


# --- contacts ---


def test_contacts_are_patches_strongest_first():
    force = finger(16, 16, 3.0, 3.0, 4.0) + finger(16, 16, 11.0, 12.0, 9.0)
    found = contacts(force)
    assert len(found) == 2
    assert found[0].force > found[1].force
    np.testing.assert_allclose(found[0].position[1:], [4.5 * 0.018, -3.5 * 0.018], atol=1e-4)
    touched = np.count_nonzero(force[8:] > 0.1 * THRESHOLD)
    assert found[0].area == pytest.approx(touched * 1.44e-4)
    assert found[0].peak == force.max()


def test_the_centre_is_finer_than_the_cells():
    """A finger a third of a cell aside is found there: to 0.3 mm of the 6."""
    (found,) = contacts(finger(16, 16, 7.0, 7.0 + 1 / 3, 6.0, width=1.1))
    np.testing.assert_allclose(
        found.position[1:], [(7 + 1 / 3 - 7.5) * 0.018, 0.5 * 0.018], atol=3e-4
    )


def test_a_contact_has_its_rim_and_noise_is_no_contact():
    """A light fingertip keeps its whole force; cells that never reach the threshold are none."""
    force = finger(16, 16, 5.0, 5.0, 4.0)
    force[12, 12] = 0.9 * 0.2
    (contact,) = contacts(force, threshold=0.2)
    assert contact.force == pytest.approx(4.0, rel=0.03)
    assert push(force, PLANE, 0.2).force[0] == pytest.approx(-contact.force)


def rows_of(*values):
    """A skin of 7 x 9 cells with these forces down its rows, on columns 2 to 6."""
    force = np.zeros((7, 9))
    force[: len(values), 2:7] = np.array(values)[:, None]
    return force


@pytest.mark.parametrize(
    ("values", "n"),
    [
        ((3, 3, 0, 3, 3), 2),  # a free row
        ((3, 3, 0.5, 3, 3), 2),  # not quite free: noise, blur, a stiff cover
        ((3, 3, 1.7, 3, 3), 2),  # just below 0.6 of the lower peak
        ((3, 3, 1.9, 3, 3), 1),  # just above: a palm is never flat
        ((9, 9, 0.7, 1, 1), 1),  # a shoulder beside a strong touch
        ((9, 9, 0.5, 1, 1), 2),
        ((3, 3, 0.01, 0.15, 0.15), 1),  # the second is below the threshold
        ((3, 0.5, 3, 0.5, 3), 3),
    ],
)
def test_two_touches_are_two_where_the_force_between_them_falls(values, n):
    geometry = make_geometry("plane", 7, 9)
    for force in (rows_of(*values), rows_of(*values).T):
        geometry = make_geometry("plane", *force.shape)
        assert len(contacts(force, geometry, 0.2)) == n


@hypothesis.settings(max_examples=150, deadline=None)
@hypothesis.given(
    hnp.arrays(
        float,
        (6, 7),
        elements=st.sampled_from([0.0, 0.0, 0.0, 0.01, 0.03, 0.15, 0.3, 1.0, 3.0, 9.0]),
    )
)
def test_every_touched_cell_is_in_one_contact_with_its_neighbours(force):
    """No force is lost or counted twice, and each contact is one connected patch."""
    frame = features.analyse_frame(force, make_geometry("plane", 6, 7), 0.2)
    patches, n = ndimage.label(force > 0.02, np.ones((3, 3)))
    touched = np.zeros(force.shape, bool)
    for k in range(1, n + 1):
        touched |= (patches == k) & (force[patches == k].max() > 0.2)
    np.testing.assert_array_equal(frame.labels > 0, touched)
    assert sum(c.force for c in frame.contacts) == pytest.approx(force[touched].sum())
    for k, contact in enumerate(frame.contacts, 1):
        own = frame.labels == k
        assert ndimage.label(own, np.ones((3, 3)))[1] == 1
        assert contact.force == pytest.approx(force[own].sum())
        assert contact.peak == force[own].max() > 0.2
    forces = [c.force for c in frame.contacts]
    assert all(np.diff(forces) < 1e-9)  # strongest first


@hypothesis.settings(max_examples=150, deadline=None)
@hypothesis.given(
    hnp.arrays(float, (6, 7), elements=st.sampled_from([0.0, 0.0, 0.3, 0.5, 1.0, 2.0, 3.0, 9.0]))
)
def test_contacts_that_touch_have_a_valley_between_them(force):
    """On no way from one contact's peak to another's does the force stay above 0.6 of the lower."""
    frame = features.analyse_frame(force, make_geometry("plane", 6, 7), 0.2)
    for k, contact in enumerate(frame.contacts, 1):
        high, _ = ndimage.label(force >= 0.6 * contact.peak, np.ones((3, 3)))
        place = high[(frame.labels == k) & (force == contact.peak)][0]
        above = frame.labels[high == place]
        rivals = [frame.contacts[j - 1].peak for j in set(above.tolist()) - {0, k}]
        assert not any(peak >= contact.peak for peak in rivals)


# --- what is soft all over ---


def test_a_body_that_leans_on_many_cells_is_a_touch_although_each_feels_little():
    """A torso against a large skin: 98 N, and no cell has the threshold of 20 g."""
    y, x = np.mgrid[:32, :32] - 16.0
    force = 0.18 * np.exp(-(y**2 + x**2) / 16.0**2)
    (contact,) = contacts(force, make_geometry("plane", 32, 32), 0.2)
    assert contact.force == pytest.approx(force.sum(), rel=0.05)


def test_a_skin_that_reads_a_little_everywhere_is_not_touched():
    assert contacts(np.full((16, 16), 0.137), PLANE, 0.2) == []  # the naive method's idle skin
    large = make_geometry("plane", 64, 64)
    assert contacts(np.full((64, 64), 0.015), large, 0.2) == []  # what a tare may leave


@pytest.mark.parametrize(("threshold", "size"), [(0.2, 32), (1.0, 16)])
def test_a_body_that_leans_on_two_places_is_a_touch_as_well(threshold, size):
    """Two shoulder blades, 39 N each, below every limit of one contact; two of 19 N are not."""
    force, half = np.zeros((size, size)), size // 2 - 1
    force[2:-2, :half] = force[2:-2, -half:] = 1.0
    force *= 78.0 / force.sum()
    assert force.max() < threshold
    large = make_geometry("plane", size, size)
    assert sum(c.force for c in contacts(force, large, threshold)) == pytest.approx(78.0)
    assert contacts(force * 19.0 / 39.0, large, threshold) == []
    force[0, :2] = 5.0  # nor does a touch elsewhere hide them
    found = contacts(force, large, threshold)
    assert [round(c.force) for c in found] == [78, 10]


@pytest.mark.parametrize("threshold", [0.2, 0.5, 1.0])
def test_no_threshold_hides_a_body_from_the_stop(threshold):
    """80 N on a hundred cells; 1 N is the largest threshold that the parameter allows."""
    force = np.zeros((16, 16))
    force[3:13, 3:13] = 0.8
    (contact,) = contacts(force, PLANE, threshold)
    assert contact.force == pytest.approx(80.0)
