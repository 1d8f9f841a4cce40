# SPDX-License-Identifier: Apache-2.0
"""Messages of msg.py <-> those of ROS 2, field by field."""

from __future__ import annotations

import array
import dataclasses
import functools
import importlib
import typing

from ...errors import RosError
from .. import bus


@functools.cache
def ros_class(kind: type) -> type:
    """ROS's own class of a message or service of msg.py.

    Raises:
        RosError: the package with its definition is not installed.
    """
    package, folder, name = (full := bus.type_name(kind)).split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except ImportError as error:
        raise RosError(f"{full}: the ROS package {package} is not installed") from error


def to_ros(message, made=None):
    """Make ROS's own message of one of msg.py, field by field; `made`: the object to fill.

    Fields have the same names. Where their Python types differ, the fresh object's own value shows
    which is wanted.
    """
    made = ros_class(type(message))() if made is None else made
    for field in dataclasses.fields(message):
        value, like = getattr(message, field.name), getattr(made, field.name)
        if isinstance(like, array.array):  # uint8[]
            value = array.array(like.typecode, value)
        elif isinstance(like, bytes) and isinstance(value, int):  # byte
            value = bytes([value])
        elif isinstance(value, list):
            value = [to_ros(v) if dataclasses.is_dataclass(v) else v for v in value]
        setattr(made, field.name, to_ros(value) if dataclasses.is_dataclass(value) else value)
    return made


def from_ros(kind: type, message):
    """Make the message of msg.py that is the like of one of ROS."""
    return kind(*(_decoded(hint, getattr(message, name)) for name, hint in _fields(kind)))


@functools.cache
def _fields(kind: type) -> list[tuple[str, type]]:
    hints = typing.get_type_hints(kind)
    return [(field.name, hints[field.name]) for field in dataclasses.fields(kind)]


def _decoded(hint, value):
    if typing.get_origin(hint) is list:
        return [_decoded(*typing.get_args(hint), item) for item in value]
    if hint is int and isinstance(value, bytes):  # byte
        return value[0]
    if hint is bytes:
        return bytes(value)
    return from_ros(hint, value) if dataclasses.is_dataclass(hint) else value
