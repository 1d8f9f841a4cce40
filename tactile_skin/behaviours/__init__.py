# SPDX-License-Identifier: Apache-2.0
"""What the robot does about it: the stop, the gate of its motion, pushing it along, hooks.

Imports fields.
"""
