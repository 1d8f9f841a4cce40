# SPDX-License-Identifier: Apache-2.0
"""gestures: skin/pressure -> what a hand does to the skin, by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...middleware.config import circuit_of, declared, geometry_of
from ...msg import Header, Image, PointCloud2, String, cloud_columns, cloud_of, image_array
from ...parameters.nodes import Gestures as Parameters
from ...touch.episode import FEATURES
from ...touch.model import load_model
from ...touch.recogniser import STATES, Named, Recogniser
from .. import QUEUE, READING, seconds
from ..gesture_feature import heard

SHIPPED = Path(__file__).parents[2] / "learning" / "weights" / "gestures.npz"
_RECORD_YOURS = (
    "no gesture is named without gestures.model: record yours, 'tactile-skin gestures record NAME';"
    " 'gestures train takes/ --out mine.gestures.npz' makes the file that it is set to"
)
_SIMULATED = "gestures.model: shipped knows simulated hands: of a real one it names 35 % rightly"
_FIELDS = ("x", "y", "z", "id", "touch", "state", "force", "duration", "label")
_CODE = {state: float(code) for code, state in enumerate(STATES)}
_SAME = 2.0  # pitches within which a gesture is of a touch in skin/contacts


class Gestures:
    """Publishes the names of gestures.

    Publishes skin/gesture, the name of a gesture once a decision; skin/gesture_classes, a point for
    each gesture that goes on or has just ended; and skin/gestures, the features of each by which it
    was judged last. It has no say in the stop.
    """

    def __init__(self, node):
        given = declared(node, Parameters)
        self.geometry = geometry_of(given.geometry, circuit_of(given.circuit))
        self._std: np.ndarray | float = 0.0
        self._contacts = np.zeros((0, 4))  # x, y, z [m], id
        self._name = node.create_publisher(String, "skin/gesture", 10)
        self._classes = node.create_publisher(PointCloud2, "skin/gesture_classes", 10)
        self._features = node.create_publisher(PointCloud2, "skin/gestures", 10)
        shipped = given.model == "shipped"
        if shipped or not given.model:
            node.get_logger().warning(_SIMULATED if shipped else _RECORD_YOURS)
        if not given.model:
            return
        self.model = load_model(SHIPPED if shipped else given.model)
        self.recogniser = Recogniser(self.model, self.geometry.pitch, given.min_probability)
        node.on_set_parameters(self.on_parameters)
        node.create_subscription(Image, "skin/pressure_std", self.on_std, READING)
        node.create_subscription(PointCloud2, "skin/contacts", self.on_contacts, QUEUE)
        node.create_subscription(Image, "skin/pressure", self.on_pressure, READING)

    def on_parameters(self, values: dict) -> None:
        self.recogniser.min_probability = values["min_probability"]

    def on_std(self, msg: Image) -> None:
        self._std = image_array(msg) * self.geometry.cell_area

    def on_contacts(self, msg: PointCloud2) -> None:
        columns = cloud_columns(msg, "x", "y", "z", "id")
        self._contacts = np.stack([columns[name] for name in ("x", "y", "z", "id")], 1)

    def on_pressure(self, msg: Image) -> None:
        t = seconds(msg.header)
        force = image_array(msg) * self.geometry.cell_area
        named = self.recogniser.update(t, force, self._std)
        for gesture in named:
            if gesture.decided:
                self._name.publish(String(gesture.label))
        if named and heard(self._classes):
            self._classes.publish(self._cloud(named, msg.header))
        if named and heard(self._features):
            self._features.publish(self._described(named, msg.header))

    def _cloud(self, named: list[Named], header: Header) -> PointCloud2:
        """Return a point per gesture.

        Its fields are x, y, z [m], id, touch (the nearest id in skin/contacts, 0: none), state (0
        new, 1 held, 2 decided, 3 ended), force [N], duration [s], label (place among the classes,
        -1: not sure, or other), and the probability of each class.
        """
        classes = self.model.classes
        rows = []
        for each in named:
            at = self._position(each)
            touch = self._touch_at(at) if each.force > 0.0 else 0.0
            label = classes.index(each.label) if each.label in classes else -1
            numbers = each.id, touch, _CODE[each.state], each.force, each.duration, label
            shares = each.probabilities.tolist() or [0.0] * len(classes)
            rows.append((*at.tolist(), *numbers, *shares))
        return cloud_of((*_FIELDS, *(f"p_{name}" for name in classes)), rows, header)

    def _described(self, named: list[Named], header: Header) -> PointCloud2:
        """Return a point per gesture: x, y, z [m], id, state, and `episode.FEATURES`."""
        rows = [
            (*self._position(g).tolist(), g.id, _CODE[g.state], *g.features.tolist()) for g in named
        ]
        return cloud_of(("x", "y", "z", "id", "state", *FEATURES), rows, header)

    def _position(self, gesture: Named) -> np.ndarray:
        return self.geometry.position[tuple(map(round, gesture.place))]

    def _touch_at(self, at: np.ndarray) -> float:
        if not len(self._contacts):
            return 0.0
        away = np.linalg.norm(self._contacts[:, :3] - at, axis=1)
        nearest = int(away.argmin())
        near = away[nearest] < _SAME * self.geometry.pitch
        return float(self._contacts[nearest, 3]) if near else 0.0
