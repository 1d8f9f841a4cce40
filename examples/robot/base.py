# SPDX-License-Identifier: Apache-2.0
"""A base: drives as cmd_vel says, and stands when it falls silent; publishes its velocity."""

import contextlib
import time

import rclpy
from geometry_msgs.msg import Twist
from rclpy.executors import ExternalShutdownException

SILENCE = 0.12  # s after which it stands, as docs/robot.md asks of a base
PERIOD = 0.02  # s between two looks


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("base")
    velocity = node.create_publisher(Twist, "velocity", 10)
    last = [Twist(), 0.0]  # command, when it came

    def on_command(command: Twist) -> None:
        last[:] = command, time.monotonic()

    def drive() -> None:
        command, at = last
        velocity.publish(command if time.monotonic() - at < SILENCE else Twist())

    node.create_subscription(Twist, "cmd_vel", on_command, 1)
    node.create_timer(PERIOD, drive)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):  # Ctrl-C
        rclpy.spin(node)


if __name__ == "__main__":
    main()
