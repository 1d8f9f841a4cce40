# SPDX-License-Identifier: Apache-2.0
"""From the pressure on each cell to contacts, tracks and gestures in the robot's frame.

Imports nothing of ours but files, which reads a table of cells.
"""
