# SPDX-License-Identifier: Apache-2.0
"""A tactile skin as a camera of LeRobot, which finds this package by its name."""

from .camera import TactileSkinCamera, TactileSkinCameraConfig
from .pictures import Depth, Rgb
from .reader import Frame

__all__ = ["Depth", "Frame", "Rgb", "TactileSkinCamera", "TactileSkinCameraConfig"]
