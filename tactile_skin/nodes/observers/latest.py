# SPDX-License-Identifier: Apache-2.0
"""Topics -> what a skin feels by one reading; no node of a launch file, see launch.Skin."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ...behaviours.stop import StopMessage
from ...msg import (
    DiagnosticArray,
    Image,
    PointCloud2,
    WrenchStamped,
    cloud_columns,
    image_array,
)
from .. import QUEUE, now, seconds
from ..stop_on_push import STATUS, most_of, stop_message_of
from ..touch import xyz

_PARTS = {
    "skin/pressure": Image,
    "skin/pressure_std": Image,
    "skin/contacts": PointCloud2,
    "skin/wrench": WrenchStamped,
}


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What a skin feels by one reading, and whether the robot must stand when it is asked for.

    Attributes:
        stamp: when the reading arrived [s].
        pressure: (rows, cols) [Pa], read-only, as are all arrays.
        std: (rows, cols) [Pa], one standard deviation of it.
        force: sum of the contacts' forces [N].
        bound: the most that it may be [N].
        wrench: (6,) force [N] and torque [N m] on the robot, in the frame of the skin; NaN where
            the shape of the cover is unknown.
        contacts: fields of `skin/contacts`, a value for each contact.
        stop, reason: as a stop hook is given them.
    """

    stamp: float
    pressure: np.ndarray
    std: np.ndarray
    force: float
    bound: float
    wrench: np.ndarray
    contacts: dict[str, np.ndarray]
    stop: bool
    reason: str


class Latest:
    """Joins the messages of a reading, which have one stamp and come in any order.

    Args:
        stop_topics: full names of the statuses that stop the robot.
    """

    def __init__(self, node, stop_topics: list[str]):
        self._node = node
        self._parts: dict[float, dict] = {}  # stamp -> topic -> message
        self._joined: tuple[float, dict] | None = None
        waiting = StopMessage(True, "waiting: no message from the stop yet")
        self._stops = dict.fromkeys(stop_topics, waiting)
        for topic, kind in _PARTS.items():
            take = functools.partial(self._take, topic)
            node.create_subscription(kind, topic, take, QUEUE)
        for topic in stop_topics:
            hear = functools.partial(self._hear, topic)
            node.create_subscription(DiagnosticArray, topic, hear, STATUS)

    def _hear(self, topic: str, msg: DiagnosticArray) -> None:
        self._stops[topic] = stop_message_of(msg, now(self._node))

    def _take(self, topic: str, msg) -> None:
        stamp = seconds(msg.header)
        parts = self._parts.setdefault(stamp, {})
        parts[topic] = msg
        if len(parts) == len(_PARTS):
            self._joined = stamp, parts
        if len(parts) == len(_PARTS) or len(self._parts) > QUEUE:  # what lacks a part has lost it
            self._parts = {t: kept for t, kept in self._parts.items() if t > stamp}

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
