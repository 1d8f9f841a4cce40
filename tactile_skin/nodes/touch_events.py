"""Topics -> pushes, releases and strokes for hooks; no node of a launch file, see launch.Skin."""

from __future__ import annotations

from collections.abc import Callable

from ..bus import Time
from ..events import PushEvents, StrokeEvents
from ..msg import DiagnosticArray, Float32, PointStamped, Vector3Stamped, WrenchStamped
from . import QUEUE
from .stop_on_push import STATUS, STATUS_TOPIC


class PushListener:
    """skin/stop_status, skin/wrench, skin/centre -> tell(Pushed) and tell(Released)."""

    def __init__(self, node, tell: Callable):
        self._events, self._tell = PushEvents(), tell
        self._force = (0.0, (0.0, 0.0, 0.0))  # stamp, vector
        node.create_subscription(WrenchStamped, "skin/wrench", self.on_wrench, QUEUE)
        node.create_subscription(PointStamped, "skin/centre", self.on_centre, QUEUE)
        node.create_subscription(DiagnosticArray, STATUS_TOPIC, self.on_status, STATUS)

    def on_wrench(self, msg: WrenchStamped) -> None:
        force = msg.wrench.force
        self._force = _seconds(msg.header), (force.x, force.y, force.z)

    def on_centre(self, msg: PointStamped) -> None:
        stamp, force = self._force
        if stamp == _seconds(msg.header):
            self._pass_on(self._events.touch(stamp, force, (msg.point.x, msg.point.y, msg.point.z)))

    def on_status(self, msg: DiagnosticArray) -> None:
        values = {pair.key: pair.value for pair in msg.status[0].values}
        self._pass_on(self._events.stop(_seconds(msg.header), values.get("push") == "true"))

    def _pass_on(self, events) -> None:
        for event in events:
            self._tell(event)


class StrokeListener:
    """skin/stroke, skin/stroke_confidence -> tell(Stroked)."""

    def __init__(self, node, tell: Callable):
        self._events, self._tell = StrokeEvents(), tell
        self._velocity = (0.0, 0.0, 0.0)
        node.create_subscription(Vector3Stamped, "skin/stroke", self.on_stroke, QUEUE)
        node.create_subscription(Float32, "skin/stroke_confidence", self.on_confidence, QUEUE)

    def on_stroke(self, msg: Vector3Stamped) -> None:
        self._velocity = msg.vector.x, msg.vector.y, msg.vector.z

    def on_confidence(self, msg: Float32) -> None:
        for event in self._events.update(self._velocity, msg.data):
            self._tell(event)


def _seconds(header) -> float:
    return Time.from_msg(header.stamp).nanoseconds / 1e9
