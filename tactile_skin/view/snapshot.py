"""What the topics said last, as one thing to draw."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..middleware.bus import DurabilityPolicy, QoSProfile, Time
from ..msg import DiagnosticArray, DiagnosticStatus, Image, PointCloud2, cloud_columns, image_array

STOP = "skin/stop_status"
DIAGNOSTICS = "skin/diagnostics"
GESTURES = "skin/gesture_classes"
LAG = 20  # readings that a pressure picture may come behind: 0.2 s at 100 a second
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# topic -> its type, and how many of its newest messages count
READINGS = {
    "skin/adc": (Image, LAG),
    "skin/pressure": (Image, 1),
    "skin/pressure_std": (Image, 1),
    "skin/contacts": (PointCloud2, 1),
}
# the same, and how many may wait
OTHERS = {
    "skin/rest": (Image, LATCHED),
    STOP: (DiagnosticArray, LATCHED),
    DIAGNOSTICS: (DiagnosticArray, 50),
    GESTURES: (PointCloud2, 10),
}
TOPICS = READINGS | OTHERS
CONTACT = ("x", "y", "z", "force", "id", "vx", "vy", "vz")


@dataclass(frozen=True)
class NodeStatus:
    """What a node said last on diagnostics."""

    level: int
    message: str
    values: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The newest of each topic.

    Attributes:
        stamp: of the reading [s].
        read_at: when its last byte arrived, on the monotonic clock [s]; None: in a recording.
        adc: (rows, cols) uint16 of skin/adc; None as long as there is none.
        pressure, std: (rows, cols) float32 [Pa], of the same reading if there are.
        contacts: (n, 8) float32, the columns CONTACT.
        gestures: id of a contact -> the name of its gesture, as far as it is sure.
        rest: (rows, cols) float32, resistance of the untouched cells [ohm], once measured.
        stop: whether the robot is stopped, with its reason; None: nobody said.
        nodes: name -> what it said last on diagnostics.
    """

    stamp: float = 0.0
    read_at: float | None = None
    adc: np.ndarray | None = None
    pressure: np.ndarray | None = None
    std: np.ndarray | None = None
    contacts: np.ndarray = field(default_factory=lambda: np.zeros((0, len(CONTACT)), np.float32))
    gestures: dict[int, str] = field(default_factory=dict)
    rest: np.ndarray | None = None
    stop: bool | None = None
    reason: str = ""
    nodes: dict[str, NodeStatus] = field(default_factory=dict)


class Collector:
    """Takes the messages of TOPICS, in any order.

    A pressure picture comes after its reading, when the next one may already be there.
    """

    def __init__(self):
        self._readings: dict[float, np.ndarray] = {}  # by their stamps, the oldest first
        self._solved: dict[str, tuple[float, np.ndarray]] = {}  # topic -> its stamp, its picture
        self._others: dict = {}
        self._nodes: dict[str, NodeStatus] = {}

    def copy(self) -> Collector:
        """One that knows the same, and goes its own way."""
        other = Collector()
        other._readings, other._others = dict(self._readings), dict(self._others)
        other._solved, other._nodes = dict(self._solved), self._nodes
        return other

    def take(self, topic: str, message) -> None:
        """Take a message of a topic.

        Raises:
            ValueError: a message that holds something else than the topic carries.
        """
        if topic == DIAGNOSTICS:
            self._nodes = self._nodes | {s.name: _said(s) for s in message.status}
        elif topic == STOP:
            status = message.status[0]
            stop = status.level != DiagnosticStatus.OK
            self._others |= {"stop": stop, "reason": status.message if stop else ""}
        elif topic == "skin/contacts":
            columns = cloud_columns(message, *CONTACT)
            self._others["contacts"] = np.stack([columns[name] for name in CONTACT], 1)
        elif topic == GESTURES:
            self._others["gestures"] = _named(cloud_columns(message))
        elif topic == "skin/rest":
            self._others["rest"] = image_array(message)
        else:
            stamp = Time.from_msg(message.header.stamp).nanoseconds / 1e9
            if topic == "skin/adc":
                if stamp not in self._readings:
                    self._readings[stamp] = image_array(message)
                while len(self._readings) > LAG:
                    del self._readings[next(iter(self._readings))]
            else:
                self._solved[topic] = stamp, image_array(message)

    def snapshot(self) -> Snapshot:
        """Return the newest reading with a pressure picture; without one, the newest."""
        if not self._readings:
            return Snapshot(nodes=self._nodes, **self._others)
        solved, _ = self._solved.get("skin/pressure", (None, None))
        stamp = solved if solved in self._readings else next(reversed(self._readings))
        pictures = {topic: picture for topic, (at, picture) in self._solved.items() if at == stamp}
        return Snapshot(
            stamp=stamp,
            adc=self._readings[stamp],
            pressure=pictures.get("skin/pressure"),
            std=pictures.get("skin/pressure_std"),
            nodes=self._nodes,
            **self._others,
        )


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
