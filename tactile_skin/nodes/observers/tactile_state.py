# SPDX-License-Identifier: Apache-2.0
"""tactile_state: skin/pressure -> tactile_state, which Ubi's tactile_toolbox shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from ...msg import Header, Image, Message, image_array
from .. import READING


@dataclass
class ChannelFloat32(Message, package="sensor_msgs"):
    name: str = ""
    values: list[float] = field(default_factory=list)


@dataclass
class State:
    """Not in msg.py: few have the package tactile_msgs."""

    TYPE: ClassVar[str] = "tactile_msgs/msg/TactileState"
    header: Header = field(default_factory=Header)
    sensors: list[ChannelFloat32] = field(default_factory=list)


class TactileState:
    """Publishes tactile_state: all cells row by row [Pa], a channel named after the namespace.

    Needs the package tactile_msgs (github.com/ubi-agni/tactile_toolbox).
    """

    def __init__(self, node):
        self._name = node.get_namespace().strip("/") or "skin"
        self._state = node.create_publisher(State, "tactile_state", 10)
        node.create_subscription(Image, "skin/pressure", self.on_pressure, READING)

    def on_pressure(self, msg: Image) -> None:
        values = image_array(msg).ravel().tolist()
        self._state.publish(State(msg.header, [ChannelFloat32(self._name, values)]))
