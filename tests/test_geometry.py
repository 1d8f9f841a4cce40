"""Cells sit and face where REP 103 puts them."""

import numpy as np
import pytest

from tactile_skin.geometry import make_geometry


def test_a_plane_faces_forward_and_is_centred():
    geometry = make_geometry("plane", 3, 5, pitch=0.02)
    np.testing.assert_allclose(geometry.position.mean((0, 1)), 0.0, atol=1e-12)
    np.testing.assert_allclose(geometry.position[0, 0], [0.0, -0.04, 0.02])  # top, robot's right
    np.testing.assert_allclose(geometry.normal, np.broadcast_to([1.0, 0.0, 0.0], (3, 5, 3)))


def test_a_cylinder_keeps_pitch_and_radius():
    geometry = make_geometry("cylinder", 4, 9, pitch=0.018, radius=0.15)
    np.testing.assert_allclose(np.linalg.norm(geometry.position[..., :2], axis=-1), 0.15)
    arc = 0.15 * np.arccos(np.sum(geometry.normal[0, 0] * geometry.normal[0, 1]))
    assert arc == pytest.approx(0.018)
    np.testing.assert_allclose(np.linalg.norm(geometry.normal, axis=-1), 1.0)
    assert geometry.normal[0, -1, 1] > 0.4  # high columns face the robot's left


def test_the_pose_turns_and_shifts():
    geometry = make_geometry(
        "plane", 2, 2, pitch=0.02, translation=(1.0, 2.0, 3.0), rpy=(0.0, 0.0, np.pi / 2)
    )
    np.testing.assert_allclose(geometry.normal[0, 0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(geometry.position.mean((0, 1)), [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"shape": "torus"}, "shape 'torus'"),
        ({"shape": "plane", "pitch": 0.0}, "pitch = 0.0"),
        ({"shape": "cylinder", "radius": 0.01}, "do not fit around"),
    ],
)
def test_a_geometry_that_cannot_be_is_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        make_geometry(rows=4, cols=16, **kwargs)
