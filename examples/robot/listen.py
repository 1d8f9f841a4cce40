# SPDX-License-Identifier: Apache-2.0
"""Run a skin in the process of your own rclpy node, and hear it there as NumPy arrays.

python examples/robot/listen.py --ros-args -p port:=/dev/ttyUSB0 -r __ns:=/left
"""

import contextlib
import sys

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image, PointCloud2

from tactile_skin.msg import cloud_columns, image_array  # they take ROS's own messages as well
from tactile_skin.ros import compose


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        sensor = qos_profile_sensor_data
        self.create_subscription(Image, "skin/pressure", self.on_pressure, sensor)
        self.create_subscription(PointCloud2, "skin/contacts", self.on_contacts, sensor)

    def on_pressure(self, message: Image) -> None:
        pressure = image_array(message)  # (rows, cols) [Pa]
        self.get_logger().info(f"at most {pressure.max() / 1e3:.1f} kPa", throttle_duration_sec=1.0)

    def on_contacts(self, message: PointCloud2) -> None:
        found = cloud_columns(message, "id", "force")
        for number, force in zip(found["id"], found["force"], strict=True):
            self.get_logger().info(f"contact {number:.0f}: {force:.1f} N")


rclpy.init()
# without `compose` it hears a skin that runs elsewhere
with contextlib.suppress(KeyboardInterrupt), compose(*sys.argv[1:]):
    rclpy.spin(Listener())
