"""Topics -> pushes, releases and strokes for hooks; no node of a launch file, see launch.Skin."""

from __future__ import annotations

from collections.abc import Callable

from ..middleware.bus import Time
from ..msg import DiagnosticArray, Float32, Vector3Stamped
from ..touch.events import PushEvents, StrokeEvents
from . import QUEUE
from .stop_on_push import STATUS, STATUS_TOPIC
from .touch import Touch, on_touch, xyz


class PushListener:
    """skin/stop_status and the touch -> tell(Pushed) and tell(Released)."""

    def __init__(self, node, tell: Callable):
        self._events, self._tell = PushEvents(), tell
        on_touch(node, self.on_touch)
        node.create_subscription(DiagnosticArray, STATUS_TOPIC, self.on_status, STATUS)

    def on_touch(self, touch: Touch) -> None:
        self._pass_on(self._events.touch(touch.stamp, touch.force, touch.centre))

    def on_status(self, msg: DiagnosticArray) -> None:
        values = {pair.key: pair.value for pair in msg.status[0].values}
        stamp = Time.from_msg(msg.header.stamp).nanoseconds / 1e9
        self._pass_on(self._events.stop(stamp, values.get("push") == "true"))

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
        self._velocity = xyz(msg.vector)

    def on_confidence(self, msg: Float32) -> None:
        for event in self._events.update(self._velocity, msg.data):
            self._tell(event)
