# SPDX-License-Identifier: Apache-2.0
"""Where each cell is on the robot, and which way it faces.

Seen from outside row 0 is on top, columns run to the right. In the skin's own frame that is x
outwards, columns along +y, rows along -z: an unrotated skin sits on the robot's front (REP 103: x
forward, y left, z up).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import FileError
from ..files import read_text, shorten

UNKNOWN = "unknown"  # a cover whose shape nobody has stated
SHAPES = ("plane", "cylinder", "sphere", "table", UNKNOWN)
PITCH = 0.018  # m: the paper's stripes are 12 mm wide with gaps of 6 mm
CELL_AREA = 0.012**2  # m^2
_FAR = 100.0  # m, as in the parameters' ranges; beyond lie places in millimetres
_TURN = 6.3  # rad, a turn; beyond lie angles in degrees


@dataclass(frozen=True, eq=False)
class Geometry:
    """Positions and outward normals of the cells, in the base frame."""

    position: np.ndarray  # (rows, cols, 3) [m]
    # (rows, cols, 3) unit vectors, out of the robot; 0 where there is no cell, and everywhere on a
    # cover of unknown shape, which has no direction of a push
    normal: np.ndarray
    # (rows, cols) area that senses, of each cell [m^2]; pressure = force / cell_area
    cell_area: np.ndarray
    pitch: float  # distance between neighbouring cells [m]; of a table, the median

    @cached_property
    def lever(self) -> np.ndarray:
        """(rows * cols, 10): what 1 N on each cell adds to all that is summed up.

        That is force [N] and torque about the base frame's origin [N m] on the robot, position
        [m], and 1.
        """
        inward = -self.normal.reshape(-1, 3)
        position = self.position.reshape(-1, 3)
        ones = np.ones((len(position), 1))
        return np.hstack([inward, np.cross(position, inward), position, ones])


def make_geometry(
    shape: str,
    rows: int,
    cols: int,
    pitch: float = PITCH,
    cell_area: float = CELL_AREA,
    radius: float = 0.15,
    translation: Sequence[float] = (0.0, 0.0, 0.0),
    rpy: Sequence[float] = (0.0, 0.0, 0.0),
    table: str | Path = "",
    cells: np.ndarray | None = None,
) -> Geometry:
    """Cells on a plane, an upright cylinder with columns around it, a sphere, or from a table.

    Args:
        shape: "plane" (its middle in the skin frame's origin), "cylinder" (its axis there),
            "sphere" (its centre there; the cloth lies so that distances from its middle are kept),
            "table", or "unknown": places as on a plane, no normals.
        pitch: between neighbouring cells [m].
        cell_area: that senses, of one cell [m^2]; of a table, where it names none.
        radius: of the cylinder or sphere [m].
        translation, rpy: pose of the skin frame in the base frame [m, rad]; roll, pitch, yaw about
            fixed axes.
        table: CSV file of a "table", see `read_table`.
        cells: (rows, cols) bool, which cells exist and so must stand in the table; None: all.

    Raises:
        ValueError: an unknown shape, a length that is not above 0, a cloth that does not fit around
            its cylinder or sphere, or a table that is none.
        OSError: the table cannot be read.
    """
    for name, value in (("pitch", pitch), ("cell_area", cell_area), ("radius", radius)):
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"geometry: {name} = {value!r}: must be finite and above 0")
    for name, vector, most, unit in (
        ("translation", translation, _FAR, "m"),
        ("rpy", rpy, _TURN, "rad"),
    ):
        if len(vector) != 3 or not np.isfinite(vector).all():
            raise ValueError(f"geometry: {name} = {vector!r}: must be three finite numbers")
        if np.abs(vector).max() > most:
            raise ValueError(f"geometry: {name} = {vector!r}: must be at most {most:g} {unit} each")
    if table and shape != "table":
        raise ValueError(f"geometry: table = {str(table)!r}: is read only with shape: table")
    area = np.full((rows, cols), cell_area)
    if shape == "table":
        cells = np.ones((rows, cols), bool) if cells is None else cells
        position, normal, area = read_table(table, cells, cell_area)
        pitch = _median_pitch(position[cells]) or pitch
    elif shape in SHAPES:
        along = (np.arange(cols) - (cols - 1) / 2) * pitch  # (cols,)
        up = ((rows - 1) / 2 - np.arange(rows)) * pitch  # (rows,)
        position, normal = _SURFACES[shape](along[None, :], up[:, None], radius, pitch)
    else:
        raise ValueError(f"geometry: shape {shape!r}: must be one of {', '.join(SHAPES)}")
    rotation = rotation_of(*rpy)
    return Geometry(
        position @ rotation.T + np.asarray(translation, float), normal @ rotation.T, area, pitch
    )


def rotation_of(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """(3, 3) rotation about the fixed axes x, y, z in turn [rad]."""
    # by hand: SciPy's takes a tenth of a second to import, at each start of a skin
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    rotation: np.ndarray = about_z @ about_y @ about_x
    return rotation


_Cells = tuple[np.ndarray, np.ndarray]  # (rows, cols, 3) position [m], and unit normal


def _plane(along: np.ndarray, up: np.ndarray, radius: float, pitch: float) -> _Cells:
    position = np.stack(np.broadcast_arrays(0.0, along, up), -1)
    return position, np.broadcast_to([1.0, 0.0, 0.0], position.shape)


def _unknown(along: np.ndarray, up: np.ndarray, radius: float, pitch: float) -> _Cells:
    position, normal = _plane(along, up, radius, pitch)
    return position, np.zeros_like(normal)


def _cylinder(along: np.ndarray, up: np.ndarray, radius: float, pitch: float) -> _Cells:
    if along.size * pitch > 2 * np.pi * radius:
        raise ValueError(
            f"geometry: {along.size} columns of {pitch} m do not fit around a radius of {radius} m"
        )
    azimuth = along / radius
    normal = np.stack(np.broadcast_arrays(np.cos(azimuth), np.sin(azimuth), 0.0 * up), -1)
    return radius * normal + up[..., None] * np.array([0.0, 0.0, 1.0]), normal


def _sphere(along: np.ndarray, up: np.ndarray, radius: float, pitch: float) -> _Cells:
    """Azimuthal equidistant: each cell as far from the middle, and in the direction, as flat."""
    distance = np.hypot(along, up)
    if distance.max() >= np.pi * radius:
        raise ValueError(
            f"geometry: a corner {distance.max():.3g} m from the middle does not fit on a sphere "
            f"of {radius} m"
        )
    angle = distance / radius
    sideways = np.sinc(angle / np.pi) / radius  # sin(angle) / distance
    normal = np.stack([np.cos(angle), sideways * along, sideways * up], -1)
    return radius * normal, normal


_SURFACES = {"plane": _plane, "cylinder": _cylinder, "sphere": _sphere, UNKNOWN: _unknown}


# --- a table of cells ----------------------------------------------------------------------------

_NEEDED = ("row", "col", "x", "y", "z", "nx", "ny", "nz")
_TABLE_BYTES = 1024 * 1024  # the 4,096 cells of the largest skin at 256 characters each
_WIDE = 1.0  # m^2, the same


def read_table(
    path: str | Path, cells: np.ndarray, cell_area: float = CELL_AREA
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read a CSV file with a line per cell, as a spreadsheet or a CAD script writes it.

    Columns, in any order: row, col (from 0), x, y, z [m] in the skin frame, nx, ny, nz (outward
    normal of any length), and, if wanted, area [m^2]. Empty lines and lines that start with # are
    passed over.

    Args:
        cells: (rows, cols) bool, which cells exist: each must be there once.
        cell_area: of cells without an area [m^2].

    Returns:
        position (rows, cols, 3), unit normal (rows, cols, 3), area (rows, cols); where no cell
        exists position and normal are 0.

    Raises:
        FileError: no such file content; the message names the file, the line and the value.
        OSError: the file cannot be read.
    """
    if not str(path):
        raise ValueError("geometry: shape: table needs the name of a file: table")
    lines = [
        (number, line.replace('"', ""))
        for number, line in enumerate(read_text(path, _TABLE_BYTES).splitlines(), 1)
        if line.strip(" ,\t") and not line.lstrip().startswith("#")
    ]
    names = [name.strip() for name in lines[0][1].split(",")] if lines else []
    if sorted(names) not in (sorted(_NEEDED), sorted((*_NEEDED, "area"))):
        here = f"line {lines[0][0]}: column names {shorten(lines[0][1])}" if lines else "is empty"
        raise FileError(f"{path}: {here}: must be {','.join(_NEEDED)} and, if wanted, area")
    position, normal = np.zeros((2, *cells.shape, 3))
    area, line_of = np.full(cells.shape, float(cell_area)), np.zeros(cells.shape, int)
    for number, line in lines[1:]:
        where = f"{path}: line {number}, {shorten(line)}"
        try:
            values = dict(zip(names, map(float, line.split(",")), strict=True))
        except ValueError as error:
            raise FileError(f"{where}: must be {len(names)} numbers") from error
        row, col, *place, nx, ny, nz = (values[name] for name in _NEEDED)
        size, length = values.get("area", cell_area), math.hypot(nx, ny, nz)
        there = row in range(cells.shape[0]) and col in range(cells.shape[1])
        cell = (int(row), int(col)) if there else (0, 0)
        for sound, wrong in (
            (there, "row, col: must be whole numbers below {} and {}".format(*cells.shape)),
            (cells[cell], "circuit.mask has no such cell"),
            (not line_of[cell], f"the cell is given in line {line_of[cell]} already"),
            (np.abs(place).max() <= _FAR, f"x, y, z: must be at most {_FAR:g} m"),
            (1e-9 < length < math.inf, "nx, ny, nz: must have a finite length above 0"),
            (0.0 < size <= _WIDE, f"area: must be above 0 and at most {_WIDE:g} m^2"),
        ):
            if not sound:
                raise FileError(f"{where}: {wrong}")
        line_of[cell], area[cell] = number, size
        position[cell], normal[cell] = place, np.array([nx, ny, nz]) / length
    absent = np.argwhere(cells & (line_of == 0))
    if len(absent):
        more = f", nor for {len(absent) - 1} others" if len(absent) > 1 else ""
        row, col = absent[0]
        raise FileError(f"{path}: row {row}, col {col}: no line for this cell{more}")
    return position, normal, area


def _median_pitch(places: np.ndarray) -> float:
    """Median distance [m] of (n, 3) cells to their nearest neighbour; 0 of a single cell."""
    if len(places) < 2:
        return 0.0
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(places).query(places, k=2)
    return float(np.median(distance[:, 1]))
