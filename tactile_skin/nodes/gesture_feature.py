"""gesture_feature: skin/pressure -> contacts, wrench, push direction, stroke."""

from __future__ import annotations

import numpy as np

from .. import features
from ..bus import Time
from ..config import circuit_of, describe, geometry_of
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
    cloud,
    image_array,
)
from . import QUEUE


class GestureFeature:
    """Publishes per frame, in the base frame: skin/contacts, skin/wrench, skin/centre,
    skin/push_direction with skin/push_confidence, skin/stroke [m/s] with skin/stroke_confidence.
    """

    def __init__(self, node):
        self.geometry = geometry_of(node, circuit_of(node))
        self.cell_threshold = node.declare_parameter(
            "cell_threshold", 0.2, describe("a contact has a cell with more [N]", 1e-3, 10.0)
        ).value
        self.stroke = features.Stroke()
        self._contacts = node.create_publisher(PointCloud2, "skin/contacts", 10)
        self._wrench = node.create_publisher(WrenchStamped, "skin/wrench", 10)
        self._centre = node.create_publisher(PointStamped, "skin/centre", 10)
        self._direction = node.create_publisher(Vector3Stamped, "skin/push_direction", 10)
        self._confidence = node.create_publisher(Float32, "skin/push_confidence", 10)
        self._stroke = node.create_publisher(Vector3Stamped, "skin/stroke", 10)
        self._stroke_confidence = node.create_publisher(Float32, "skin/stroke_confidence", 10)
        node.create_subscription(Image, "skin/pressure", self.on_pressure, QUEUE)

    def on_pressure(self, msg: Image) -> None:
        header = msg.header
        force = image_array(msg).astype(float) * self.geometry.cell_area  # (rows, cols) [N]
        shape = self.geometry.position.shape[:2]
        if msg.encoding != "32FC1" or force.shape != shape or not (force >= 0.0).all():
            raise ValueError(
                f"skin/pressure is {msg.encoding} {force.shape}: must be 32FC1 {shape}, 0 or more"
            )
        found = features.contacts(force, self.geometry, self.cell_threshold)
        self._contacts.publish(contact_cloud(found, header))  # first: the stop waits for it
        push = features.push(force, self.geometry, self.cell_threshold)
        self._wrench.publish(
            WrenchStamped(header, Wrench(_vector(push.force), _vector(push.torque)))
        )
        self._centre.publish(PointStamped(header, Point(*map(float, push.centre))))
        self._direction.publish(Vector3Stamped(header, _vector(push.direction)))
        self._confidence.publish(Float32(push.confidence))
        velocity, confidence = self.stroke.update(
            Time.from_msg(header.stamp).nanoseconds / 1e9, found
        )
        self._stroke.publish(Vector3Stamped(header, _vector(velocity)))
        self._stroke_confidence.publish(Float32(confidence))


def contact_cloud(found: list[features.Contact], header: Header) -> PointCloud2:
    """A point per contact: x, y, z [m], force [N], area [m^2], peak [N on one cell]."""
    position = np.array([c.position for c in found]).reshape(-1, 3)
    columns = dict(zip("xyz", position.T, strict=True))
    for name in ("force", "area", "peak"):
        columns[name] = np.array([getattr(c, name) for c in found])
    return cloud(columns, header)


def _vector(v) -> Vector3:
    return Vector3(float(v[0]), float(v[1]), float(v[2]))
