# SPDX-License-Identifier: Apache-2.0
"""gesture_feature: skin/pressure -> contacts, wrench, push direction, stroke, gestures."""

from __future__ import annotations

import functools

import numpy as np

from ..middleware.config import circuit_of, declared, geometry_of
from ..msg import (
    Float32,
    Header,
    Image,
    Point,
    PointCloud2,
    PointStamped,
    Vector3,
    Vector3Stamped,
    Wrench,
    WrenchStamped,
    cloud_of,
    image_array,
)
from ..parameters.nodes import GestureFeature as Parameters
from ..physics.proof import UNPROVED
from ..touch import features
from ..touch.frames import Pose
from ..touch.geometry import rotation_of
from ..touch.tracking import RELEASED, STATES, Touch, Tracker, stroke
from . import READING, frames, seconds

CONTACT = (
    "x",
    "y",
    "z",
    "force",
    "area",
    "peak",
    "id",
    "vx",
    "vy",
    "vz",
    "state",
    "bound",
    "peak_bound",
)
_PRESSURE, _BOUND = "skin/pressure", "skin/pressure_bound"
_NO_WAY = np.full(3, np.nan)  # vector of a push on a cover of unknown shape
_CODE = {state: float(code) for code, state in enumerate(STATES)}


class GestureFeature:
    """Publishes what touches the skin.

    Publishes per frame, in the base frame: skin/contacts, skin/wrench, skin/centre,
    skin/push_direction with skin/push_confidence, skin/stroke [m/s] with skin/stroke_confidence.
    Without the shape of the cover the vectors of a push are NaN, which is no force of 0 N.
    """

    def __init__(self, node):
        given = declared(node, Parameters)
        self.geometry = geometry_of(given.geometry, circuit_of(given.circuit))
        self.cell_threshold = given.cell_threshold
        node.on_set_parameters(self.on_parameters)
        if given.skin_frame:
            at = np.array(given.geometry.translation)
            pose = Pose(rotation_of(*given.geometry.rpy), at)
            frames.publish_static(node, given.frame_id, given.skin_frame, pose)
        self._faces = bool(self.geometry.normal.any())  # its shape is known
        if not self._faces:
            node.get_logger().warning(
                "geometry.shape is unknown: pushes have no direction and no wrench; "
                "set it to plane, cylinder, sphere or table"
            )
        self.tracker = Tracker(self.geometry.pitch)
        self._contacts = node.create_publisher(PointCloud2, "skin/contacts", 10)
        self._wrench = node.create_publisher(WrenchStamped, "skin/wrench", 10)
        self._centre = node.create_publisher(PointStamped, "skin/centre", 10)
        self._direction = node.create_publisher(Vector3Stamped, "skin/push_direction", 10)
        self._confidence = node.create_publisher(Float32, "skin/push_confidence", 10)
        self._stroke = node.create_publisher(Vector3Stamped, "skin/stroke", 10)
        self._stroke_confidence = node.create_publisher(Float32, "skin/stroke_confidence", 10)
        self._parts: dict[str, Image] = {}  # topic -> its last picture
        self._touched = False  # in the last frame
        self._stamp: object = None  # of the last reading that was taken
        for topic in (_PRESSURE, _BOUND):
            callback = functools.partial(self._take, topic)
            node.create_subscription(Image, topic, callback, READING)

    def on_parameters(self, values: dict) -> None:
        self.cell_threshold = values["cell_threshold"]

    def _take(self, topic: str, msg: Image) -> None:
        """Take a picture; those of one reading have one stamp, and come in any order on ROS."""
        self._parts[topic] = msg
        pressure, bound = self._parts.get(_PRESSURE), self._parts.get(_BOUND)
        if pressure is None or pressure.header.stamp == self._stamp:
            return
        # without any bound they are somebody else's pressures
        if bound is None or pressure.header.stamp == bound.header.stamp:
            self._stamp = pressure.header.stamp
            self.on_pressure(pressure, bound)

    def on_pressure(self, msg: Image, most: Image | None) -> None:
        """Publish what a picture says; without the most that it may be it is not proved."""
        header = msg.header
        pressure = image_array(msg)
        shape = self.geometry.cell_area.shape
        if (
            msg.encoding != "32FC1"
            or pressure.shape != shape
            or not (pressure.min() >= 0.0 and pressure.max() < np.inf)  # False for NaN
        ):
            raise ValueError(
                f"skin/pressure is {msg.encoding} {pressure.shape}: "
                f"must be 32FC1 {shape}, finite and 0 or more"
            )
        force = pressure * self.geometry.cell_area  # (rows, cols) [N], float64
        given = image_array(most) if most is not None else None
        if given is not None and given.shape == (*shape, 2):
            bound = given * self.geometry.cell_area[..., None]
        else:
            bound = np.stack([force, UNPROVED * force], -1)
        frame = features.analyse_frame(
            force, self.geometry, self.cell_threshold, bound, held=self._touched
        )
        self._touched = bool(frame.contacts)
        touches = self.tracker.update(seconds(header), frame)
        self._contacts.publish(contact_cloud(touches, header))  # first: the stop waits for it
        push = frame.push
        if not self._faces:
            push = push._replace(force=_NO_WAY, torque=_NO_WAY, direction=_NO_WAY)
        if heard(self._wrench):
            wrench = Wrench(_vector(push.force), _vector(push.torque))
            self._wrench.publish(WrenchStamped(header, wrench))
        if heard(self._centre):
            self._centre.publish(PointStamped(header, Point(*push.centre.tolist())))
        if heard(self._direction):
            self._direction.publish(Vector3Stamped(header, _vector(push.direction)))
        if heard(self._confidence):
            self._confidence.publish(Float32(push.confidence))
        velocity, confidence = stroke(touches)
        if heard(self._stroke):
            self._stroke.publish(Vector3Stamped(header, _vector(velocity)))
        if heard(self._stroke_confidence):
            self._stroke_confidence.publish(Float32(confidence))


def heard(publisher) -> bool:
    """Whether a message would reach anybody: most topics are for the few who ask for them."""
    return publisher.get_subscription_count() > 0


def contact_cloud(touches: list[Touch], header: Header) -> PointCloud2:
    """Return a point per touch that is there.

    Its fields are x, y, z [m], force [N], area [m^2], peak [N on one cell], id, vx, vy, vz [m/s],
    state (0 new, 1 held), bound [N], the most that its force may be,
    peak_bound [N], the same of its peak if newtons are right.

    A released touch is no point: whoever takes points for obstacles would stop for it.
    """
    rows = [
        (
            *c.position.tolist(),
            c.force,
            c.area,
            c.peak,
            number,
            *velocity.tolist(),
            _CODE[state],
            c.bound,
            c.peak_bound,
        )
        for number, state, c, velocity, _ in touches
        if state != RELEASED
    ]
    return cloud_of(CONTACT, rows, header)


def _vector(v) -> Vector3:
    return Vector3(*v.tolist())
