# SPDX-License-Identifier: Apache-2.0
"""Messages of msg.py <-> CDR bytes, and their definitions, by rosbags; the way to mcap."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from .. import msg
from ..extras import load
from ..middleware.ros.messages import from_ros
from ..msg import Message

_M = TypeVar("_M", bound=Message)
KINDS: dict[str, type[Message]] = {  # ROS 2 type -> class of a message
    kind.TYPE: kind
    for _, kind in inspect.getmembers(msg, lambda kind: dataclasses.is_dataclass(kind))
}
SCHEMAS, MESSAGES = "ros2msg", "cdr"  # names of ROS 2's formats, in MCAP
_PARTS = "reader", "records", "stream_reader", "writer"


def new_topics(node, heard: set[str]) -> Iterator[tuple[str, type[Message]]]:
    """Yield each topic of a node's process that is not among those heard yet, and its messages."""
    for topic, (name,) in node.get_topic_names_and_types():
        if topic not in heard and name in KINDS:
            heard.add(topic)
            yield topic, KINDS[name]


@functools.cache
def mcap():
    """Return the library of the container (ModuleNotFoundError: it is not installed)."""
    for part in _PARTS:
        _load(f"mcap.{part}")
    return _load("mcap")


@functools.cache
def _store():
    typesys = _load("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _load(module: str):
    return load(module, f"recordings need {module.partition('.')[0]}", "record")


def check() -> None:
    """Check that the libraries of recordings are installed.

    Raises:
        ModuleNotFoundError: a library is not installed.
    """
    mcap(), _store()


def definition(kind: type[Message]) -> str:
    """ROS 2's definition of a message and of its parts, as MCAP's encoding ros2msg wants it."""
    return _store().generate_msgdef(kind.TYPE, ros_version=2)[0]


def encode(message: Message) -> bytes:
    """Encode a message of msg.py as CDR."""
    if isinstance(data := getattr(message, "data", None), bytes):
        message = dataclasses.replace(message, data=np.frombuffer(data, np.uint8))
    return bytes(_store().serialize_cdr(message, message.TYPE))


def decode(kind: type[_M], data: bytes, like: bool = False) -> _M:
    """CDR -> a message of msg.py (ValueError: bytes that are no such message).

    Args:
        like: one with the same attributes will do, in half the time.
    """
    try:
        message = _store().deserialize_cdr(data, kind.TYPE)
        return message if like else from_ros(kind, message)
    except Exception as error:  # of generated code: whatever a wrong byte leads to
        raise ValueError(f"{len(data)} bytes are no {kind.TYPE}: {error!r}") from error
