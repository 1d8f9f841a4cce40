# SPDX-License-Identifier: Apache-2.0
"""The robot's tf: what it says of a frame, and where the skin is mounted."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..middleware.bus import DurabilityPolicy, QoSProfile
from ..msg import Header, Message, Quaternion, Transform, TransformStamped, Vector3
from ..touch.frames import Frames, Pose, pose_of, quaternion_of
from . import seconds

TOPICS = TF, TF_STATIC = "/tf", "/tf_static"  # of the whole robot
_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass
class TFMessage(Message, package="tf2_msgs"):
    """Not in msg.py: tf2_msgs is not in every installation, and only who asks for tf needs it."""

    transforms: list[TransformStamped] = field(default_factory=list)


def hear(node) -> Frames:
    """Return the frames of /tf and /tf_static, as they arrive."""
    pose_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))  # SciPy's import would hold up the first message
    frames, refused = Frames(), set()

    def take(message: TFMessage, static: bool) -> None:
        for stamped in message.transforms:
            t, q = stamped.transform.translation, stamped.transform.rotation
            try:
                pose = pose_of((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))
            except ValueError as error:  # of a joint that sends NaN, say: the others are right
                if stamped.child_frame_id not in refused:
                    refused.add(stamped.child_frame_id)
                    node.get_logger().warning("%s: %s", stamped.child_frame_id, error)
                continue
            always = {} if static else {"stamp": seconds(stamped.header)}
            frames.take(stamped.header.frame_id, stamped.child_frame_id, pose, **always)

    node.create_subscription(TFMessage, TF, lambda m: take(m, False), 100)
    node.create_subscription(TFMessage, TF_STATIC, lambda m: take(m, True), _STATIC)
    return frames


def publish_static(node, parent: str, child: str, pose: Pose) -> None:
    """Say where `child` is in `parent`, once and for all."""
    x, y, z, w = quaternion_of(pose.rotation)
    transform = Transform(Vector3(*pose.translation.tolist()), Quaternion(x, y, z, w))
    header = Header(node.get_clock().now().to_msg(), parent)
    publisher = node.create_publisher(TFMessage, TF_STATIC, _STATIC)
    publisher.publish(TFMessage([TransformStamped(header, child, transform)]))
