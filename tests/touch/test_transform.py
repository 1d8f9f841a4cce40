# SPDX-License-Identifier: Apache-2.0
"""Frames as tf has them, against rotations worked out by SciPy; and messages as on a robot."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.bench import Bench

from tactile_skin.msg import Header, Quaternion, Time, Transform, TransformStamped, Vector3
from tactile_skin.nodes import frames as tf
from tactile_skin.nodes.gesture_feature import GestureFeature
from tactile_skin.nodes.touch import Touch
from tactile_skin.touch.frames import Frames, pose_of
from tactile_skin.touch.geometry import rotation_of

# Made by hand, of a small arm on wheels: frame, child, translation [m], quaternion x y z w,
# stamp [s]; None: static.
ROBOT = [
    ("base_link", "shoulder", (0.1, 0.0, 0.5), (0.0, 0.0, 0.70710678, 0.70710678), 100.0),
    ("shoulder", "forearm", (0.3, 0.0, 0.0), (0.0, 0.38268343, 0.0, 0.92387953), 100.0),
    ("forearm", "skin", (0.0, 0.0, 0.04), (0.0, -0.70710678, 0.0, 0.70710678), None),
    ("odom", "base_link", (2.0, 3.0, 0.0), (0.0, 0.0, 0.0, 1.0), 100.0),
]


POSE = pose_of((0.3, -0.2, 1.0), Rotation.from_euler("xyz", (0.5, 1.0, -2.0)).as_quat())


def test_what_is_no_rotation_is_refused():
    with pytest.raises(ValueError, match="must be a unit quaternion"):
        pose_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))


def test_there_and_back_is_nowhere():
    frames = Frames()
    frames.take("a", "b", POSE)
    found = frames.lookup("a", "b", 0.0).after(frames.lookup("b", "a", 0.0))
    assert found.rotation == pytest.approx(np.eye(3))
    assert found.translation == pytest.approx(np.zeros(3))


@pytest.mark.parametrize("target", ["nowhere", "a"])
@pytest.mark.parametrize("parent", ["c", "circle"])
def test_frames_that_are_not_connected(target, parent):
    """Nor are those of a circle."""
    frames = Frames()
    frames.take("a", "b", POSE)
    frames.take(parent, "d", POSE)
    frames.take("d", "circle", POSE)
    with pytest.raises(LookupError, match=f"no transform from d to {target}"):
        frames.lookup(target, "d", 0.0)


def messages():
    """One robot_state_publisher's: the joint of its gripper sends what is no rotation."""
    bad = TransformStamped(Header(Time(100), "forearm"), "gripper")
    bad.transform.rotation = Quaternion(math.nan, 0.0, 0.0, math.nan)
    for parent, child, at, q, stamp in ROBOT:
        header = Header(Time(int(stamp or 0.0)), parent)
        transform = Transform(Vector3(*at), Quaternion(*q))
        static = stamp is None
        yield static, tf.TFMessage([bad, TransformStamped(header, child, transform)])


@pytest.fixture
def robot():
    """A node that hears /tf, and what it knows."""
    bench = Bench(100.0)
    node, other = bench.node("gate"), bench.node("robot")
    found = tf.hear(node)
    publishers = [other.create_publisher(tf.TFMessage, t, 10) for t in ("/tf", "/tf_static")]
    for static, message in messages():
        publishers[static].publish(message)
    bench.spin()
    return found


def test_a_robots_tf_is_followed(robot):
    """By SciPy: shoulder turned by 90 degrees, forearm bent by 45, the skin on its upper side."""
    turned = Rotation.from_euler("z", 90, degrees=True)
    bent = Rotation.from_euler("y", 45, degrees=True)
    up = Rotation.from_euler("y", -90, degrees=True)
    pose = robot.lookup("base_link", "skin", 100.2)
    assert pose.rotation == pytest.approx((turned * bent * up).as_matrix(), abs=1e-6)
    at = np.array([0.1, 0.0, 0.5]) + turned.apply(
        np.add([0.3, 0.0, 0.0], bent.apply([0.0, 0.0, 0.04]))
    )
    assert pose.translation == pytest.approx(at, abs=1e-6)


@pytest.mark.parametrize(("now", "later"), [(100.2, 100.6), (99.6, 40.0)])
def test_an_arm_that_is_no_longer_heard_is_nowhere(robot, now, later):
    """Also when the clock was set back: it was known for as long as that."""
    robot.lookup("base_link", "skin", now)
    with pytest.raises(LookupError):
        robot.lookup("base_link", "skin", later)
    robot.lookup("forearm", "skin", math.copysign(1e9, later - now))  # that one is fixed


def test_a_touch_is_seen_from_another_frame(robot):
    """Its torque is about the other frame's origin."""
    pose = robot.lookup("base_link", "skin", 100.0)
    force, centre = np.array([-10.0, 0.0, 0.0]), np.array([0.05, 0.01, 0.02])
    torque = np.cross(centre, force)
    touch = Touch(100.0, 10.0, force, torque, centre, centre[None], "skin").seen_from(pose)
    assert touch.force == pytest.approx(pose.rotation @ force)
    assert touch.torque == pytest.approx(np.cross(touch.centre, touch.force))
    assert touch.places[0] == pytest.approx(touch.centre)


def test_the_skin_says_where_it_is_mounted():
    bench = Bench()
    values = {"skin_frame": "skin", "geometry.translation": [0.1, 0.2, 0.3]}
    values["geometry.rpy"] = [0.0, 0.0, 1.0]
    GestureFeature(bench.node("gesture_feature", values))
    found = tf.hear(bench.node("late"))
    bench.spin()
    pose = found.lookup("base_link", "skin", 1e9)
    assert pose.translation == pytest.approx([0.1, 0.2, 0.3])
    assert pose.rotation == pytest.approx(rotation_of(0.0, 0.0, 1.0))
