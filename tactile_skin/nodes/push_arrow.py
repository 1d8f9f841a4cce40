# SPDX-License-Identifier: Apache-2.0
"""push_arrow: skin/centre, skin/push_direction -> skin/push_arrow, which rviz can draw.

rviz has no display for a Vector3Stamped; a polygon in the shape of an arrow needs no plugin, and
is gone when its message is empty.
"""

from __future__ import annotations

import numpy as np

from ..middleware.config import declared
from ..msg import Point32, PointStamped, Polygon, PolygonStamped, Vector3Stamped
from ..parameters.nodes import PushArrow as Parameters
from . import QUEUE


class PushArrow:
    """Publishes an arrow that ends at the centre of force and points where the push goes.

    Without a push it is an empty polygon.
    """

    def __init__(self, node):
        self.length = declared(node, Parameters).length
        self._arrow = node.create_publisher(PolygonStamped, "skin/push_arrow", 10)
        self._centre = PointStamped()
        node.create_subscription(PointStamped, "skin/centre", self.on_centre, QUEUE)
        node.create_subscription(Vector3Stamped, "skin/push_direction", self.on_direction, QUEUE)

    def on_centre(self, msg: PointStamped) -> None:
        self._centre = msg

    def on_direction(self, msg: Vector3Stamped) -> None:
        """Take the direction; the centre of its frame is here in general, or a frame behind."""
        p, d = self._centre.point, msg.vector
        points = arrow(np.array([p.x, p.y, p.z]), np.array([d.x, d.y, d.z]), self.length)
        polygon = Polygon([Point32(*map(float, point)) for point in points])
        self._arrow.publish(PolygonStamped(msg.header, polygon))


def arrow(tip: np.ndarray, direction: np.ndarray, length: float) -> list[np.ndarray]:
    """Corners of an arrow drawn in one closed line; none for a direction of length zero.

    Args:
        tip: where it ends [m].
        direction: where it points, a unit vector, or zero.
        length: of the shaft [m].
    """
    if not direction @ direction > 0.0:  # nor for NaN, of an unknown shape
        return []
    flattest = np.eye(3)[np.argmin(np.abs(direction))]
    across = np.cross(direction, flattest)
    across *= 0.1 * length / np.linalg.norm(across)
    neck, tail = tip - 0.25 * length * direction, tip - length * direction
    return [tail, neck, neck + across, tip, neck - across, neck]
