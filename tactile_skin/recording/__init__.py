# SPDX-License-Identifier: Apache-2.0
"""Recordings of a skin: MCAP files with ROS 2 messages, and frames of other boards as CSV, NumPy.

The file formats only: who records is nodes/recorder, what plays them back is replay/. Imports
files, msg, physics and middleware.
"""

from .reader import Recording, Topic

__all__ = ["Recording", "Topic"]
