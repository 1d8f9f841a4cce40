# SPDX-License-Identifier: Apache-2.0
"""Topics -> what hooks are called for; no node of a launch file, see launch.Skin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...msg import DiagnosticArray, Float32, PointCloud2, Vector3Stamped, cloud_columns
from ...touch.events import Gesture, Gestured, Pushed, PushEvents, Released, Stroked, StrokeEvents
from ...touch.model import OTHER
from ...touch.recogniser import ENDED, STATES
from .. import QUEUE, seconds
from ..stop_on_push import PUSH, STATUS, STATUS_TOPIC
from ..touch import Touch, on_touch, xyz


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
        self._pass_on(self._events.stop(seconds(msg.header), values.get(PUSH) == "true"))

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


class GestureListener:
    """skin/gesture_classes -> tell(Gestured), once a decision."""

    def __init__(self, node, tell: Callable):
        self._tell = tell
        self._labels: dict[int, str] = {}  # of the gestures that go on
        node.create_subscription(PointCloud2, "skin/gesture_classes", self.on_classes, QUEUE)

    def on_classes(self, msg: PointCloud2) -> None:
        columns = cloud_columns(msg)
        classes = [name.removeprefix("p_") for name in columns if name.startswith("p_")]
        for k in range(msg.width):
            point = {name: float(column[k]) for name, column in columns.items()}
            number, label = int(point["id"]), int(point["label"])
            name = classes[label] if label >= 0 else ""
            over = STATES[int(point["state"])] == ENDED
            if over and not name:
                name = OTHER
            if name and name != self._labels.get(number):
                self._tell(_gestured(point, name, number))
                self._labels[number] = name
            if over:
                self._labels.pop(number, None)


def _gestured(point: dict[str, float], name: str, number: int) -> Gestured:
    place = np.array([point["x"], point["y"], point["z"]])
    probability = point.get(f"p_{name}", 0.0)
    gesture = Gesture(name, probability, number, place, point["force"], point["duration"])
    return Gestured(gesture)


LISTENERS = {  # event -> who hears it
    Pushed: PushListener,
    Released: PushListener,
    Stroked: StrokeListener,
    Gestured: GestureListener,
}
