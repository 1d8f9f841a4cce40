"""The robot's tf: what it says of a frame, and where the skin is mounted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from ..middleware.bus import DurabilityPolicy, QoSProfile, Time
from ..msg import Header, Quaternion, Transform, TransformStamped, Vector3
from ..touch.frames import Frames, Pose, pose_of, quaternion_of

_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass
class TFMessage:
    """Not in msg.py: tf2_msgs is not in every installation, and only who asks for tf needs it."""

    TYPE: ClassVar[str] = "tf2_msgs/msg/TFMessage"
    transforms: list[TransformStamped] = field(default_factory=list)


def hear(node) -> Frames:
    """The frames of /tf and /tf_static, as they arrive."""
    frames = Frames()

    def take(message: TFMessage, static: bool) -> None:
        for stamped in message.transforms:
            t, q = stamped.transform.translation, stamped.transform.rotation
            pose = pose_of((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))
            stamp = Time.from_msg(stamped.header.stamp).nanoseconds / 1e9
            always = {} if static else {"stamp": stamp}
            frames.take(stamped.header.frame_id, stamped.child_frame_id, pose, **always)

    node.create_subscription(TFMessage, "/tf", lambda m: take(m, False), 100)
    node.create_subscription(TFMessage, "/tf_static", lambda m: take(m, True), _STATIC)
    return frames


def publish_static(node, parent: str, child: str, pose: Pose) -> None:
    """Say where `child` is in `parent`, once and for all."""
    x, y, z, w = quaternion_of(pose.rotation)
    transform = Transform(Vector3(*pose.translation.tolist()), Quaternion(x, y, z, w))
    header = Header(node.get_clock().now().to_msg(), parent)
    publisher = node.create_publisher(TFMessage, "/tf_static", _STATIC)
    publisher.publish(TFMessage([TransformStamped(header, child, transform)]))
