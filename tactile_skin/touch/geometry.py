"""Where each cell is on the robot, and which way it faces.

Seen from outside, in front of the skin: row 0 is on top, columns run to the right. In the skin's
own frame that is x outwards, columns along +y, rows along -z, so that an unrotated skin sits on
the robot's front (REP 103: x forward, y left, z up) and its high columns are on the robot's left.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
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


@dataclass(frozen=True, eq=False)
class Geometry:
    """Positions and outward normals of the cells, in the base frame.

    Attributes:
        position: (rows, cols, 3) [m].
        normal: (rows, cols, 3) unit vectors, out of the robot; 0 where there is no cell, and
            everywhere on a cover of unknown shape, which has no direction of a push.
        cell_area: (rows, cols) area that senses, of each cell [m^2]; pressure = force / cell_area.
        pitch: distance between neighbouring cells [m]; of a table, the median.
    """

    position: np.ndarray
    normal: np.ndarray
    cell_area: np.ndarray
    pitch: float

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
    for name, vector in (("translation", translation), ("rpy", rpy)):
        if len(vector) != 3 or not np.isfinite(vector).all():
            raise ValueError(f"geometry: {name} = {vector!r}: must be three finite numbers")
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
_FAR = 100.0  # m, as in the parameters' ranges; beyond lie tables in millimetres
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
    text = read_text(path, _TABLE_BYTES)
    position = np.zeros((*cells.shape, 3))
    normal = np.zeros((*cells.shape, 3))
    area = np.full(cells.shape, float(cell_area))
    line_of: dict[tuple[int, int], int] = {}
    for number, values in _lines_of_cells(text, path):
        where = f"{path}: line {number}"
        rows, cols = cells.shape
        cell = (
            _index(values["row"], "row", rows, where),
            _index(values["col"], "col", cols, where),
        )
        if cell in line_of:
            raise FileError(
                f"{where}: row {cell[0]}, col {cell[1]}: already given in line {line_of[cell]}"
            )
        if not cells[cell]:
            raise FileError(f"{where}: row {cell[0]}, col {cell[1]}: circuit.mask has no such cell")
        line_of[cell] = number
        position[cell] = _position(values, where)
        normal[cell] = _normal(values, where)
        if "area" in values:
            area[cell] = _area(values["area"], where)
    absent = [cell for cell in map(tuple, np.argwhere(cells).tolist()) if cell not in line_of]
    if absent:
        raise FileError(
            f"{path}: row {absent[0][0]}, col {absent[0][1]}: no line for this cell"
            + (f", nor for {len(absent) - 1} others" if len(absent) > 1 else "")
        )
    return position, normal, area


def _lines_of_cells(text: str, path: str | Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the number of each line with a cell, from 1, and its words by the header's names."""
    names: list[str] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip(" ,\t") or line.lstrip().startswith("#"):
            continue
        where = f"{path}: line {number}"
        try:
            words = [word.strip() for word in next(csv.reader([line]))]
        except csv.Error as error:
            raise FileError(f"{where}: {error}") from error
        if names is None:
            names = _header(words, where)
            continue
        if len(words) != len(names):
            raise FileError(f"{where}: {len(words)} values: must be {len(names)}")
        yield number, dict(zip(names, words, strict=True))
    if names is None:
        raise FileError(f"{path}: is empty: must start with {','.join(_NEEDED)}")


def _position(values: dict[str, str], where: str) -> np.ndarray:
    position = np.array([_number(values[name], name, where) for name in "xyz"])
    if (far := np.abs(position).max()) > _FAR:
        raise FileError(f"{where}: {far:g} m from the origin: must be at most {_FAR:g} m")
    return position


def _normal(values: dict[str, str], where: str) -> np.ndarray:
    outward = np.array([_number(values[name], name, where) for name in ("nx", "ny", "nz")])
    length = math.hypot(*outward)
    if not 1e-9 < length < math.inf:
        raise FileError(f"{where}: nx, ny, nz = {outward.tolist()}: must have a length above 0")
    return outward / length


def _area(word: str, where: str) -> float:
    area = _number(word, "area", where)
    if not 0 < area <= _WIDE:
        raise FileError(f"{where}: area = {word}: must be above 0 and at most {_WIDE:g} m^2")
    return area


def _header(words: list[str], where: str) -> list[str]:
    missing = [name for name in _NEEDED if name not in words]
    unknown = [word for word in words if word not in (*_NEEDED, "area")]
    if missing or unknown or len(set(words)) != len(words):
        raise FileError(
            f"{where}: column names {shorten(','.join(words))}: must be {','.join(_NEEDED)} and, "
            "if wanted, area, each once"
        )
    return words


def _index(word: str, name: str, n: int, where: str) -> int:
    try:
        value = int(word)
    except ValueError:
        value = -1
    if not 0 <= value < n:
        raise FileError(
            f"{where}: {name} = {shorten(word)}: must be a whole number from 0 to {n - 1}"
        )
    return value


def _number(word: str, name: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileError(f"{where}: {name} = {shorten(word)}: must be a finite number")
    return value


def _median_pitch(places: np.ndarray) -> float:
    """Median distance [m] of (n, 3) cells to their nearest neighbour; 0 of a single cell."""
    if len(places) < 2:
        return 0.0
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(places).query(places, k=2)
    return float(np.median(distance[:, 1]))
