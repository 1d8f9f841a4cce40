"""Where each cell is on the robot, and which way it faces.

Seen from outside, in front of the skin: row 0 is on top, columns run to the right. In the skin's
own frame that is x outwards, columns along +y, rows along -z, so that an unrotated skin sits on
the robot's front (REP 103: x forward, y left, z up) and its high columns are on the robot's left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

SHAPES = ("plane", "cylinder")


@dataclass(frozen=True, eq=False)
class Geometry:
    """Positions and outward normals of the cells, in the base frame.

    Attributes:
        position: (rows, cols, 3) [m].
        normal: (rows, cols, 3) unit vectors, out of the robot.
        cell_area: area that senses, of one cell [m^2]; pressure = force / cell_area.
        pitch: distance between neighbouring cells [m].
    """

    position: np.ndarray
    normal: np.ndarray
    cell_area: float
    pitch: float


def make_geometry(
    shape: str,
    rows: int,
    cols: int,
    pitch: float = 0.018,
    cell_area: float = 0.012**2,
    radius: float = 0.15,
    translation=(0.0, 0.0, 0.0),
    rpy=(0.0, 0.0, 0.0),
) -> Geometry:
    """Cells on a plane, or on an upright cylinder with columns around it.

    Args:
        shape: "plane" (its middle in the skin frame's origin) or "cylinder" (its axis there).
        pitch: between neighbouring cells [m]; the paper's stripes are 12 mm wide with 6 mm gaps.
        radius: of the cylinder [m].
        translation, rpy: pose of the skin frame in the base frame [m, rad]; roll, pitch, yaw about
            fixed axes.

    Raises:
        ValueError: an unknown shape, a length that is not above 0, or a cylinder whose columns go
            around it more than once.
    """
    for name, value in (("pitch", pitch), ("cell_area", cell_area), ("radius", radius)):
        if not value > 0:
            raise ValueError(f"geometry: {name} = {value!r}: must be above 0")
    for name, value in (("translation", translation), ("rpy", rpy)):
        if len(value) != 3:
            raise ValueError(f"geometry: {name} = {value!r}: must be three numbers")
    along = (np.arange(cols) - (cols - 1) / 2) * pitch  # (cols,)
    up = ((rows - 1) / 2 - np.arange(rows)) * pitch  # (rows,)
    if shape == "plane":
        position = np.stack(np.broadcast_arrays(0.0, along[None, :], up[:, None]), -1)
        normal = np.broadcast_to([1.0, 0.0, 0.0], position.shape)
    elif shape == "cylinder":
        azimuth = along / radius
        if cols * pitch > 2 * np.pi * radius:
            raise ValueError(
                f"geometry: {cols} columns of {pitch} m do not fit around a radius of {radius} m"
            )
        outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(cols)], -1)  # (cols, 3)
        normal = np.broadcast_to(outward, (rows, cols, 3))
        position = radius * normal + up[:, None, None] * np.array([0.0, 0.0, 1.0])
    else:
        raise ValueError(f"geometry: shape {shape!r}: must be one of {', '.join(SHAPES)}")
    rotation = Rotation.from_euler("xyz", rpy).as_matrix()
    return Geometry(
        position @ rotation.T + np.asarray(translation, float),
        normal @ rotation.T,
        cell_area,
        pitch,
    )
