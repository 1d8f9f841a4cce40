# SPDX-License-Identifier: Apache-2.0
"""The touch of one reading from the three topics that hold its parts."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..middleware.bus import Time
from ..msg import PointCloud2, PointStamped, WrenchStamped, cloud_columns
from ..touch.frames import Pose
from . import QUEUE, frames


class Touch(NamedTuple):
    """In the frame of the skin's messages; all zero without a contact."""

    stamp: float  # of the reading [s]
    total: float  # sum of the contacts' forces [N]
    force: tuple[float, float, float]  # sum of their vectors, on the robot [N]
    torque: tuple[float, float, float]  # about the base frame's origin [N m]
    centre: tuple[float, float, float]  # centre of force [m]
    places: np.ndarray  # (n, 3) centres of force of its contacts [m]
    frame: str = ""  # in which all this is

    def seen_from(self, pose: Pose) -> Touch:
        """Return the same in another frame, in which its own has this pose."""
        fx, fy, fz, *torque = pose.wrench(self.force, self.torque).tolist()
        centre = pose.rotation @ self.centre + pose.translation
        places = self.places @ pose.rotation.T + pose.translation
        return self._replace(
            force=(fx, fy, fz), torque=tuple(torque), centre=tuple(centre.tolist()), places=places
        )


def on_touch(node, callback: Callable[[Touch], None], base: str = "", usual: str = "") -> None:
    """skin/contacts, skin/wrench, skin/centre -> callback(touch), once a reading.

    Parts of one reading have one stamp; they may come in any order, on real ROS.

    Args:
        base: frame of the touch, by tf, and no touch while tf knows none; empty: the messages' own.
        usual: without a base, frame that the messages must be in; empty: any.
    """
    known = frames.hear(node) if base else None
    warned = False
    parts: dict[str, tuple] = {}  # name -> stamp [ns], value

    def take(name: str, msg, value) -> None:
        nonlocal warned
        stamp = Time.from_msg(msg.header.stamp).nanoseconds
        parts[name] = stamp, value
        if len(parts) == 3 and all(other == stamp for other, _ in parts.values()):
            force, torque = parts["wrench"][1]
            total, places = parts["contacts"][1]
            centre = parts["centre"][1]
            frame = msg.header.frame_id
            touch = Touch(stamp / 1e9, total, force, torque, centre, places, frame)
            if known is not None and frame != base:
                try:
                    touch = touch.seen_from(known.lookup(base, frame, touch.stamp))
                except LookupError:
                    return
            elif known is None and usual and frame.lstrip("/") not in ("", usual.lstrip("/")):
                if not warned:
                    text = "touches are in %s, velocities in %s: pushes have no direction: %s"
                    advice = "set base_frame, or one frame_id for all nodes"
                    node.get_logger().warning(text, frame, usual, advice)
                warned = True
                return
            callback(touch)

    def on_contacts(msg: PointCloud2) -> None:
        columns = cloud_columns(msg, "x", "y", "z", "force")
        places = np.stack([columns[axis] for axis in "xyz"], 1)
        take("contacts", msg, (float(columns["force"].sum()), places))

    def on_wrench(msg: WrenchStamped) -> None:
        take("wrench", msg, (xyz(msg.wrench.force), xyz(msg.wrench.torque)))

    def on_centre(msg: PointStamped) -> None:
        take("centre", msg, xyz(msg.point))

    node.create_subscription(PointCloud2, "skin/contacts", on_contacts, QUEUE)
    node.create_subscription(WrenchStamped, "skin/wrench", on_wrench, QUEUE)
    node.create_subscription(PointStamped, "skin/centre", on_centre, QUEUE)


def xyz(v) -> tuple[float, float, float]:
    """Return a Vector3 or Point as numbers."""
    return v.x, v.y, v.z
