# SPDX-License-Identifier: Apache-2.0
"""What the topics said last, as one thing to draw."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..middleware.bus import DurabilityPolicy, QoSProfile, Time
from ..msg import DiagnosticArray, DiagnosticStatus, Image, PointCloud2, cloud_columns, image_array

STOP = "skin/stop_status"
DIAGNOSTICS = "skin/diagnostics"
CONTACTS = "skin/contacts"
GESTURES = "skin/gesture_classes"
LAG = 20  # readings that a pressure picture may come behind: 0.2 s at 100 a second
_BEHIND = 10  # pictures that the contacts may come behind
_RECENT = 0.5  # s by which contacts of an earlier reading are shown, if those of it are late
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# topic -> its type, and how many of its newest messages count
READINGS = {
    "skin/adc": (Image, LAG),
    "skin/pressure": (Image, _BEHIND),
    "skin/pressure_std": (Image, _BEHIND),
    CONTACTS: (PointCloud2, _BEHIND),
}
# the same, and how many may wait
OTHERS = {
    "skin/rest": (Image, LATCHED),
    STOP: (DiagnosticArray, LATCHED),
    DIAGNOSTICS: (DiagnosticArray, 50),
    GESTURES: (PointCloud2, 10),
}
TOPICS = READINGS | OTHERS
CONTACT = ("x", "y", "z", "force", "id", "vx", "vy", "vz", "peak")
NO_CONTACTS = np.zeros((0, len(CONTACT)), np.float32)


@dataclass(frozen=True)
class NodeStatus:
    """What a node said last on diagnostics."""

    level: int
    message: str
    values: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The newest of each topic."""

    stamp: float = 0.0  # of the reading [s]
    # when its last byte arrived, on the monotonic clock [s]; None: in a recording
    read_at: float | None = None
    adc: np.ndarray | None = None  # (rows, cols) uint16 of skin/adc; None as long as there is none
    # pressure, std: (rows, cols) float32 [Pa], of the same reading if there are
    pressure: np.ndarray | None = None
    std: np.ndarray | None = None
    # (n, 9) float32, the columns CONTACT, of the same reading unless they are late
    contacts: np.ndarray = field(default_factory=lambda: NO_CONTACTS)
    # id of a contact -> the name of its gesture, as far as it is sure
    gestures: dict[int, str] = field(default_factory=dict)
    # (rows, cols) float32, resistance of the untouched cells [ohm], once measured
    rest: np.ndarray | None = None
    # whether the robot is stopped, with its reason and causes; None: nobody said
    stop: bool | None = None
    reason: str = ""
    causes: tuple[str, ...] = ()
    force: float = 0.0  # of all contacts, as the stop counts it [N]
    # limit, cell_limit: force of all contacts, and on one cell, that is a push [N]; None: nobody
    # said
    limit: float | None = None
    cell_limit: float | None = None
    # name -> what it said last on diagnostics
    nodes: dict[str, NodeStatus] = field(default_factory=dict)


class Collector:
    """Takes the messages of TOPICS; of a reading, picture and contacts may come after the next."""

    def __init__(self):
        # topic -> stamp -> its picture or contacts, the oldest first
        self._kept: dict[str, dict[float, np.ndarray]] = {topic: {} for topic in READINGS}
        self._others: dict = {}
        self._nodes: dict[str, NodeStatus] = {}

    def copy(self) -> Collector:
        """One that knows the same, and goes its own way."""
        other = Collector()
        other._kept = {topic: dict(kept) for topic, kept in self._kept.items()}
        other._others, other._nodes = dict(self._others), self._nodes
        return other

    def take(self, topic: str, message) -> None:
        """Take a message of a topic.

        Raises:
            ValueError: a message that holds something else than the topic carries.
        """
        if topic == DIAGNOSTICS:
            self._nodes = self._nodes | {s.name: _said(s) for s in message.status}
        elif topic == STOP:
            self._others |= _stop(message.status[0])
        elif topic == GESTURES:
            self._others["gestures"] = _named(cloud_columns(message))
        elif topic == "skin/rest":
            self._others["rest"] = image_array(message)
        else:
            stamp = Time.from_msg(message.header.stamp).nanoseconds / 1e9
            kept, (_, count) = self._kept[topic], READINGS[topic]
            if stamp not in kept:
                kept[stamp] = _contacts(message) if topic == CONTACTS else image_array(message)
            while len(kept) > count:
                del kept[next(iter(kept))]

    def snapshot(self) -> Snapshot:
        """Return the newest reading that has a picture and contacts; else what there is of one."""
        readings, pressure, std, contacts = (self._kept[topic] for topic in READINGS)
        if not readings:
            return Snapshot(nodes=self._nodes, **self._others)
        solved = [stamp for stamp in pressure if stamp in readings]
        complete = [stamp for stamp in solved if stamp in contacts]
        stamp = (complete or solved or list(readings))[-1]
        return Snapshot(
            stamp=stamp,
            adc=readings[stamp],
            pressure=pressure.get(stamp),
            std=std.get(stamp),
            contacts=contacts.get(stamp, _recent(contacts, stamp)),
            nodes=self._nodes,
            **self._others,
        )


def _recent(contacts: dict[float, np.ndarray], stamp: float) -> np.ndarray:
    """Return the last contacts before a stamp, unless they are old."""
    before = [t for t in contacts if stamp - _RECENT < t <= stamp]
    return contacts[before[-1]] if before else NO_CONTACTS


def _contacts(message: PointCloud2) -> np.ndarray:
    columns = cloud_columns(message, *CONTACT)
    return np.stack([columns[name] for name in CONTACT], 1)


def _stop(status: DiagnosticStatus) -> dict:
    """Return what a status says of the stop, as attributes of a snapshot."""
    values = {pair.key: pair.value for pair in status.values}
    stop = status.level != DiagnosticStatus.OK
    return {
        "stop": stop,
        "reason": status.message if stop else "",
        "causes": tuple(values.get("causes", "").split()),
        "force": number(values.get("counts_as")) or 0.0,
        "limit": number(values.get("threshold")),
        "cell_limit": number(values.get("peak")),
    }


def lines_of(status: NodeStatus, name: str) -> tuple[int, ...]:
    """Return the numbers of lines that a value holds; none if it is of another make."""
    words = status.values.get(name, "").split()
    return tuple(map(int, words)) if all(map(str.isdecimal, words)) else ()


def number(text: str | None) -> float | None:
    """Return a value as a number; None: it is none that is finite."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _said(status: DiagnosticStatus) -> NodeStatus:
    return NodeStatus(
        status.level, status.message, {pair.key: pair.value for pair in status.values}
    )


def _named(columns: dict[str, np.ndarray]) -> dict[int, str]:
    """Return id of a contact -> name, of skin/gesture_classes."""
    classes = [name.removeprefix("p_") for name in columns if name.startswith("p_")]
    labels, touches = columns["label"].astype(int).tolist(), columns["touch"].astype(int).tolist()
    return {
        touch: classes[label] for touch, label in zip(touches, labels, strict=True) if label >= 0
    }
