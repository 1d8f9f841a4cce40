# SPDX-License-Identifier: Apache-2.0
"""The ROS messages that the skin speaks: ROS's own field names, types and defaults.

Plain dataclasses, so that a node's code reads the same in-process and on real ROS. `TYPE` is the
ROS 2 name of each. A published message is shared by all its subscribers: treat it as read-only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt


class Message:
    """What all messages have: the fields of a dataclass, and the name of their type."""

    TYPE: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __init_subclass__(cls, package: str) -> None:
        cls.TYPE = f"{package}/msg/{cls.__name__}"


# --- builtin_interfaces, std_msgs ---------------------------------------------------------------


@dataclass
class Time(Message, package="builtin_interfaces"):
    sec: int = 0
    nanosec: int = 0


@dataclass
class Header(Message, package="std_msgs"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Bool(Message, package="std_msgs"):
    data: bool = False


@dataclass
class String(Message, package="std_msgs"):
    data: str = ""


@dataclass
class Float32(Message, package="std_msgs"):
    data: float = 0.0


# --- geometry_msgs ------------------------------------------------------------------------------


@dataclass
class Vector3(Message, package="geometry_msgs"):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Point(Message, package="geometry_msgs"):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion(Message, package="geometry_msgs"):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Transform(Message, package="geometry_msgs"):
    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass
class TransformStamped(Message, package="geometry_msgs"):
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass
class Vector3Stamped(Message, package="geometry_msgs"):
    header: Header = field(default_factory=Header)
    vector: Vector3 = field(default_factory=Vector3)


@dataclass
class PointStamped(Message, package="geometry_msgs"):
    header: Header = field(default_factory=Header)
    point: Point = field(default_factory=Point)


@dataclass
class Point32(Message, package="geometry_msgs"):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Polygon(Message, package="geometry_msgs"):
    points: list[Point32] = field(default_factory=list)


@dataclass
class PolygonStamped(Message, package="geometry_msgs"):
    header: Header = field(default_factory=Header)
    polygon: Polygon = field(default_factory=Polygon)


@dataclass
class Wrench(Message, package="geometry_msgs"):
    force: Vector3 = field(default_factory=Vector3)
    torque: Vector3 = field(default_factory=Vector3)


@dataclass
class WrenchStamped(Message, package="geometry_msgs"):
    header: Header = field(default_factory=Header)
    wrench: Wrench = field(default_factory=Wrench)


@dataclass
class Twist(Message, package="geometry_msgs"):
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class TwistStamped(Message, package="geometry_msgs"):
    header: Header = field(default_factory=Header)
    twist: Twist = field(default_factory=Twist)


# --- sensor_msgs --------------------------------------------------------------------------------


@dataclass
class Image(Message, package="sensor_msgs"):
    header: Header = field(default_factory=Header)
    height: int = 0
    width: int = 0
    encoding: str = ""
    is_bigendian: int = 0
    step: int = 0
    data: bytes = b""


@dataclass
class PointField(Message, package="sensor_msgs"):
    INT8: ClassVar[int] = 1
    UINT8: ClassVar[int] = 2
    INT16: ClassVar[int] = 3
    UINT16: ClassVar[int] = 4
    INT32: ClassVar[int] = 5
    UINT32: ClassVar[int] = 6
    FLOAT32: ClassVar[int] = 7
    FLOAT64: ClassVar[int] = 8
    name: str = ""
    offset: int = 0
    datatype: int = 0
    count: int = 0


@dataclass
class PointCloud2(Message, package="sensor_msgs"):
    header: Header = field(default_factory=Header)
    height: int = 0
    width: int = 0
    fields: list[PointField] = field(default_factory=list)
    is_bigendian: bool = False
    point_step: int = 0
    row_step: int = 0
    data: bytes = b""
    is_dense: bool = False


@dataclass
class TimeReference(Message, package="sensor_msgs"):
    header: Header = field(default_factory=Header)
    time_ref: Time = field(default_factory=Time)
    source: str = ""


# --- diagnostic_msgs ----------------------------------------------------------------------------


@dataclass
class KeyValue(Message, package="diagnostic_msgs"):
    key: str = ""
    value: str = ""


@dataclass
class DiagnosticStatus(Message, package="diagnostic_msgs"):
    OK: ClassVar[int] = 0
    WARN: ClassVar[int] = 1
    ERROR: ClassVar[int] = 2
    STALE: ClassVar[int] = 3
    level: int = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: list[KeyValue] = field(default_factory=list)


@dataclass
class DiagnosticArray(Message, package="diagnostic_msgs"):
    header: Header = field(default_factory=Header)
    status: list[DiagnosticStatus] = field(default_factory=list)


# --- std_srvs -----------------------------------------------------------------------------------


class Trigger:
    TYPE: ClassVar[str] = "std_srvs/srv/Trigger"

    @dataclass
    class Request:
        pass

    @dataclass
    class Response:
        success: bool = False
        message: str = ""


# --- arrays in and out of messages --------------------------------------------------------------

PAIR = "32FC2"  # encoding of a picture with two numbers a cell
_ENCODINGS: dict[str, np.dtype[Any]] = {
    "16UC1": np.dtype("<u2"),
    "32FC1": np.dtype("<f4"),
    PAIR: np.dtype("<f4"),
}


def image(array: np.ndarray, encoding: str, header: Header) -> Image:
    """Return an (rows, cols) array as an Image, row-major, little-endian.

    Its encoding is 16UC1 or 32FC1; 32FC2 of an (rows, cols, 2) array.
    """
    _check_encoding(encoding)
    data = np.ascontiguousarray(array, _ENCODINGS[encoding])
    height, width = data.shape[:2]
    step = data.nbytes // max(height, 1)
    return Image(header, height, width, encoding, 0, step, data.tobytes())


def image_array(msg: Image) -> np.ndarray:
    """Return an Image as an (rows, cols) array, of 32FC2 (rows, cols, 2), read-only.

    Raises:
        ValueError: an encoding other than 16UC1, 32FC1 and 32FC2, or data of another size.
    """
    _check_encoding(msg.encoding)
    dtype = _ENCODINGS[msg.encoding].newbyteorder(">" if msg.is_bigendian else "<")
    shape = (msg.height, msg.width, 2) if msg.encoding == PAIR else (msg.height, msg.width)
    if len(msg.data) != math.prod(shape) * dtype.itemsize:
        raise ValueError(
            f"image of {msg.height} x {msg.width} {msg.encoding} holds {len(msg.data)} bytes"
        )
    return np.frombuffer(msg.data, dtype).reshape(shape)


def _check_encoding(encoding: str) -> None:
    if encoding not in _ENCODINGS:
        raise ValueError(f"image encoding {encoding!r}: must be one of {', '.join(_ENCODINGS)}")


def cloud(columns: dict[str, np.ndarray], header: Header) -> PointCloud2:
    """Named columns of n values each -> PointCloud2 of n points, float32 fields."""
    return cloud_of(tuple(columns), np.stack([np.asarray(c) for c in columns.values()], 1), header)


def cloud_of(names: tuple[str, ...], table: npt.ArrayLike, header: Header) -> PointCloud2:
    """(n, len(names)) table -> PointCloud2 of n points, float32 fields."""
    points = np.array(table, "<f4").reshape(-1, len(names))
    n, width = points.shape
    fields = list(_fields(names))
    return PointCloud2(
        header, 1, n, fields, False, 4 * width, 4 * width * n, points.tobytes(), True
    )


@lru_cache(maxsize=16)
def _fields(names: tuple[str, ...]) -> tuple[PointField, ...]:
    return tuple(PointField(name, 4 * k, PointField.FLOAT32, 1) for k, name in enumerate(names))


def cloud_columns(msg: PointCloud2, *names: str) -> dict[str, np.ndarray]:
    """PointCloud2 of float32 fields, as `cloud` makes them -> columns of these names, or all."""
    table = np.frombuffer(msg.data, "<f4").reshape(msg.width, msg.point_step // 4)
    columns = {}
    for f in msg.fields:
        if msg.is_bigendian or f.datatype != PointField.FLOAT32:
            raise ValueError("point cloud: must hold little-endian FLOAT32 fields")
        if not names or f.name in names:
            columns[f.name] = table[:, f.offset // 4]
    return columns
