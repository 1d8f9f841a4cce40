# SPDX-License-Identifier: Apache-2.0
"""Topics and services of real ROS: 1 by rospy, 2 by rclpy, chosen when a node starts."""
