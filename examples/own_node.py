# SPDX-License-Identifier: Apache-2.0
"""A node of your own in the process of the skin: it publishes how hard the skin is touched, 0 to 1.

A node gets a handle with the methods of an rclpy node: parameters in, callbacks, publish.

    python examples/own_node.py        # 20 seconds on a simulated board
    python examples/own_node.py 5
"""

import sys

from tactile_skin.launch import launch
from tactile_skin.msg import Float32, WrenchStamped


class TouchLevel:
    """skin/wrench -> touch_level: |force| / full_scale, at most 1."""

    def __init__(self, node):
        self.full_scale = node.declare_parameter("full_scale", 30.0).value  # N
        self.publisher = node.create_publisher(Float32, "touch_level", 10)
        node.create_subscription(WrenchStamped, "skin/wrench", self.on_wrench, 10)

    def on_wrench(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        newtons = (force.x**2 + force.y**2 + force.z**2) ** 0.5
        self.publisher.publish(Float32(min(newtons / self.full_scale, 1.0)))


if __name__ == "__main__":
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    levels = []
    skin = launch("demo.launch.yaml", scene="push_left", monitor=False)
    skin.add(TouchLevel, {"full_scale": 40.0}, name="touch_level")
    with skin:
        skin.node.create_subscription(Float32, "touch_level", levels.append, 10)
        skin.spin(seconds)
    print(f"{len(levels)} levels, the largest {max(m.data for m in levels):.2f}")
