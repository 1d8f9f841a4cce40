# SPDX-License-Identifier: Apache-2.0
"""Topics, services and parameters of nodes on ROS 2, by rclpy."""
