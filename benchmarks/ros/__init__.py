# SPDX-License-Identifier: Apache-2.0
"""The skin on a real ROS."""
