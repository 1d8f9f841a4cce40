# SPDX-License-Identifier: Apache-2.0
"""Topics -> what a skin feels by one reading; no node of a launch file, see launch.Skin."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ...behaviours.stop import StopMessage
from ...msg import DiagnosticArray, Image, PointCloud2, WrenchStamped, cloud_columns, image_array
from .. import QUEUE, now, seconds
from ..stop_on_push import STATUS, most_of, stop_message_of
from ..touch import xyz

_PARTS = {
    "skin/pressure": Image,
    "skin/pressure_std": Image,
    "skin/contacts": PointCloud2,
    "skin/wrench": WrenchStamped,
}


class Snapshot(NamedTuple):
    """What a skin feels by one reading, and whether the robot must stand when it is asked for."""

    stamp: float  # when the reading arrived [s]
    pressure: np.ndarray  # (rows, cols) [Pa], read-only, as are all arrays
    std: np.ndarray  # (rows, cols) [Pa], one standard deviation of it
    force: float  # sum of the contacts' forces [N]
    bound: float  # the most that it may be [N]
    wrench: np.ndarray  # (6,) force [N], torque [N m]; NaN where the cover's shape is unknown
    contacts: dict[str, np.ndarray]  # fields of `skin/contacts`, a value for each contact
    stop: bool  # and why, as a stop hook is given them
    reason: str


class Latest:
    """Joins the messages of a reading, which have one stamp and come in any order."""

    def __init__(self, node, stop_topics: list[str]):
        self._node = node
        self._parts: dict[float, dict] = {}  # stamp -> topic -> message
        self._joined: tuple[float, dict] | None = None
        waiting = StopMessage(True, "waiting: no message from the stop yet")
        self._stops = dict.fromkeys(stop_topics, waiting)
        for topic, kind in _PARTS.items():
            node.create_subscription(kind, topic, partial(self._take, topic), QUEUE)
        for topic in stop_topics:
            node.create_subscription(DiagnosticArray, topic, partial(self._hear, topic), STATUS)

    def _hear(self, topic: str, msg: DiagnosticArray) -> None:
        self._stops[topic] = stop_message_of(msg, now(self._node))

    def _take(self, topic: str, msg) -> None:
        stamp = seconds(msg.header)
        parts = self._parts.setdefault(stamp, {})
        parts[topic] = msg
        if len(parts) == len(_PARTS):
            self._joined = stamp, parts
            self._parts = {t: kept for t, kept in self._parts.items() if t > stamp}
        elif len(self._parts) > QUEUE:  # the oldest has lost what it lacks
            del self._parts[next(iter(self._parts))]

    def snapshot(self) -> Snapshot | None:
        """Return what the newest reading says; None: there was none yet."""
        if (joined := self._joined) is None:
            return None
        stamp, (pressure, std, contacts, wrench) = joined[0], (joined[1][t] for t in _PARTS)
        columns = cloud_columns(contacts)
        vector = np.array([*xyz(wrench.wrench.force), *xyz(wrench.wrench.torque)])
        vector.setflags(write=False)
        decisions = [message.at(now(self._node)) for message in self._stops.values()]
        return Snapshot(
            stamp,
            image_array(pressure),
            image_array(std),
            float(columns["force"].sum()),
            most_of(columns),
            vector,
            columns,
            any(decision.stop for decision in decisions),
            " + ".join(decision.reason for decision in decisions if decision.reason),
        )
