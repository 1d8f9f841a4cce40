# SPDX-License-Identifier: Apache-2.0
"""body: stops, contacts and wrenches of several skins -> those of the body."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..behaviours.stop import TRANSPORT, Decision
from ..body.stop import BodyStop
from ..body.touches import OLDEST, BodyTouch, BodyTracker, Piece, coincident
from ..middleware.bus import Time
from ..middleware.config import circuit_of, declared, geometry_of
from ..msg import (
    DiagnosticArray,
    Header,
    Point,
    PointCloud2,
    PointStamped,
    Trigger,
    Vector3,
    Vector3Stamped,
    Wrench,
    WrenchStamped,
    cloud_columns,
    cloud_of,
)
from ..parameters.nodes import Body as Parameters
from ..parameters.shared import Circuit, Framed, Geometry
from ..touch.frames import IDENTITY, Frames, Pose
from ..touch.geometry import UNKNOWN
from ..touch.geometry import Geometry as SkinGeometry
from . import now, seconds
from .frames import hear
from .gesture_feature import CONTACT, heard
from .stop_on_push import (
    HEARTBEAT,
    PUSH,
    STATUS,
    STATUS_TOPIC,
    Decisions,
    answered,
    most_of,
    stop_message_of,
)
from .touch import xyz

_OFTEN = 0.01  # s between decisions while nothing changes: half of HEARTBEAT
_NEWEST = 1  # messages of a topic that wait: a body that lags reads a stop before old contacts
_PIECE = "force", "area", "peak", "bound", "peak_bound"  # fields of a contact that add up
_SKIN = "skin"  # field of a contact: the place of its skin in the parameter `skins`, from 0
# key of a value: each skin and how old the reading of its stop was when the body heard it [s];
# below 0: the clock of its computer is ahead
AGES = "ages"
STOPPING = "skins"  # key of a value of the status: the skins that stop the body, between spaces


class Body:
    """Publishes for several skins, each in a namespace of its name, what one publishes.

    Publishes skin/stop and skin/stop_status, whose reason begins with the skin's name; and, once
    for each frame of the fastest skin, skin/contacts, with the field `skin` and ids that stay
    across seams, skin/wrench, skin/centre and skin/push_direction. The service `~/reset` frees what
    the body latched: a push that lay on several skins, or a skin that was silent, late or nowhere
    on tf; each skin's own stop has one as well.

    Where a skin's frame_id is not the body's, tf says where it is; until it does the body is
    stopped. Such a skin may move, and has no neighbours.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        self._names = [name for name in given.skins if name]
        if not self._names:
            raise ValueError("skins: must name those of the body: start it with a config of skins")
        self._frame = given.frame_id
        self._frames: dict[str, str] = {}  # skin -> of its messages
        skins: dict[str, dict[str, SkinGeometry]] = {}  # frame -> skin -> where its cells are in it
        for name in self._names:
            circuit = circuit_of(declared(node, Circuit, f"{name}.circuit."))
            geometry = geometry_of(declared(node, Geometry, f"{name}.geometry."), circuit)
            if not geometry.normal.any():
                raise ValueError(
                    f"{name}.geometry.shape = {UNKNOWN}: a body has to know where each skin is: "
                    "give its shape, translation and rpy"
                )
            self._frames[name] = declared(node, Framed, f"{name}.").frame_id.lstrip("/")
            skins.setdefault(self._frames[name], {})[name] = geometry
        for frame, there in skins.items():
            if pair := coincident(there):
                raise ValueError(
                    f"{' and '.join(pair)}: geometry: lie at one place in {frame}: give each its "
                    "translation and rpy"
                )
        fixed = skins.pop(self._frame.lstrip("/"), {})
        self._tf = hear(node) if skins else Frames()
        self.stop = BodyStop(self._names, given, now(self.node))
        self.tracker = BodyTracker(fixed)
        self._stamps: dict[str, float] = {}  # skin -> of its newest contacts
        self._wrenches: dict[str, tuple[float, np.ndarray]] = {}  # skin -> stamp, force and torque
        self._fresh: set[str] = set()  # skins that have come since the last message
        self._bases: dict[str, float] = {}  # skin -> stamp of what its stop is based on
        self._ages: dict[str, float] = {}  # skin -> how old that was when it was heard [s]
        self._pushed = False  # whether a push is on in the wrench that was published last
        self._decisions = Decisions(node)
        self._decided = -math.inf  # s, when it was decided last
        self._contacts = node.create_publisher(PointCloud2, "skin/contacts", 10)
        self._wrench = node.create_publisher(WrenchStamped, "skin/wrench", 10)
        self._centre = node.create_publisher(PointStamped, "skin/centre", 10)
        self._direction = node.create_publisher(Vector3Stamped, "skin/push_direction", 10)
        for name in self._names:
            self._listen(name)
        node.on_set_parameters(self.on_parameters)
        node.create_service(Trigger, "~/reset", self.on_reset)
        node.create_timer(HEARTBEAT, self.on_timer)
        self.on_timer()

    def _listen(self, name: str) -> None:
        def hear(kind, topic: str, callback, qos) -> None:
            where = f"{name}/{topic}"
            self.node.create_subscription(kind, where, lambda msg: callback(name, msg), qos)

        hear(DiagnosticArray, STATUS_TOPIC, self.on_status, STATUS)
        hear(WrenchStamped, "skin/wrench", self.on_wrench, _NEWEST)
        hear(PointCloud2, "skin/contacts", self.on_contacts, _NEWEST)

    def on_parameters(self, values: dict) -> None:
        """Limits that change while the robot moves."""
        self.stop.config = dataclasses.replace(self.stop.config, **values)

    def on_status(self, name: str, msg: DiagnosticArray) -> None:
        t = now(self.node)
        self._bases[name] = seconds(msg.header)
        self._ages[name] = t - self._bases[name]
        skin = self.stop.skins[name]
        before = skin.reasons(t)
        skin.hear(t, stop_message_of(msg, t), self._bases[name])
        # many skins say often that they are as before
        if not 0.0 <= t - self._decided < _OFTEN or skin.reasons(t) != before:
            self._decide(t, always=False)

    def on_wrench(self, name: str, msg: WrenchStamped) -> None:
        if (pose := self._pose(name, msg.header)) is None:
            return
        stamp = seconds(msg.header)
        self._wrenches[name] = stamp, pose.wrench(xyz(msg.wrench.force), xyz(msg.wrench.torque))
        if self._stamps.get(name) == stamp:
            self._joined(name, msg.header)

    def on_contacts(self, name: str, msg: PointCloud2) -> None:
        stamp = seconds(msg.header)
        columns = cloud_columns(msg) if msg.width else {}  # most touch nothing
        self.stop.touched(name, stamp, most_of(columns) if columns else 0.0)
        if (pose := self._pose(name, msg.header)) is None:
            return
        self.tracker.update(stamp, name, _pieces(columns, pose) if columns else [])
        self._stamps[name] = stamp
        if self._wrenches.get(name, (None,))[0] == stamp:
            self._joined(name, msg.header)

    def _pose(self, name: str, header: Header) -> Pose | None:
        """Return where the frame of a skin's message is in the body's; None: a fault."""
        here, said = header.frame_id.lstrip("/"), self._frames[name]
        pose, words = None, ""
        if here != said:
            words = f"its messages are in {here}, its frame_id is {said}: set one for all its nodes"
        elif here == self._frame.lstrip("/"):
            pose = IDENTITY
        else:
            try:
                pose = self._tf.lookup(self._frame, here, seconds(header))
            except LookupError as error:
                words = f"{error}: publish it on tf, or set one frame_id for all skins"
        self.stop.skins[name].fault = words
        return pose

    def _joined(self, name: str, header: Header) -> None:
        """Publish once a round of the skins: the contacts and wrench of one are there."""
        header = Header(header.stamp, self._frame)
        again, live = name in self._fresh, self._live(seconds(header))
        self._fresh.add(name)
        if not again and not live <= self._fresh:
            return
        self._fresh = {name} if again else set()
        touches = self.tracker.touches()
        if heard(self._contacts):
            self._contacts.publish(self._cloud(touches, header))
        wrench = sum((self._wrenches[k][1] for k in live if k in self._wrenches), np.zeros(6))
        force, torque = wrench[:3], wrench[3:].tolist()
        if heard(self._wrench):
            self._wrench.publish(
                WrenchStamped(header, Wrench(Vector3(*force.tolist()), Vector3(*torque)))
            )
        total = sum(touch.force for touch in touches)
        if heard(self._centre):
            centre = sum((x.force * x.position for x in touches), np.zeros(3)) / (total or 1.0)
            self._centre.publish(PointStamped(header, Point(*centre.tolist())))
        if heard(self._direction):
            length = float(np.linalg.norm(force))
            direction = force / length if length > 1e-6 * total else np.zeros(3)
            self._direction.publish(Vector3Stamped(header, Vector3(*direction.tolist())))
        self._pushed = self.stop.pushed

    def _live(self, stamp: float) -> set[str]:
        """Return the skins whose contacts are of now: what a silent one last felt is over."""
        oldest = stamp - OLDEST
        return {name for name, last in self._stamps.items() if last >= oldest}

    def _cloud(self, touches: list[BodyTouch], header: Header) -> PointCloud2:
        rows = [
            (
                *x.position.tolist(),
                x.force,
                x.area,
                x.peak,
                x.id,
                *x.velocity.tolist(),
                0.0 if x.new else 1.0,
                x.bound,
                x.peak_bound,
                self._names.index(x.skin),
            )
            for x in touches
        ]
        return cloud_of((*CONTACT, _SKIN), rows, header)

    def on_timer(self) -> None:
        self._decide(now(self.node))

    def on_reset(self, _, response):
        causes = self.stop.reset(now(self.node))
        self.on_timer()
        return answered(response, causes)

    def _decide(self, t: float, always: bool = True) -> None:
        self._decided = t
        decision = self.stop.decide(t)
        if always or decision != self._decisions.last:
            self._publish(decision, t)

    def _publish(self, decision: Decision, t: float, final: bool = False) -> None:
        based = min(self._bases.values(), default=t)
        good_for = self.stop.until - TRANSPORT - based
        values = {
            PUSH: str(self._pushed).lower(),
            STOPPING: " ".join(self.stop.stopping(t)),
            AGES: " ".join(f"{name} {age:.3f}" for name, age in self._ages.items()),
            "good_for": f"{good_for if math.isfinite(good_for) else -1.0:g}",
        }
        header = Header(Time(round(based * 1e9)).to_msg(), self._frame)
        self._decisions.publish(decision, values, header, final)

    def close(self) -> None:
        """Publish a final stop: nothing monitors the skins from here on."""
        decision = self.stop.decide(now(self.node))
        words = "fault: the body shuts down"
        self._publish(decision._replace(stop=True, reason=words, causes=()), 0.0, final=True)


def _pieces(columns: dict[str, np.ndarray], pose: Pose) -> list[Piece]:
    """Return the contacts of a skin's message in the body's frame."""
    columns = {"bound": columns["force"], "peak_bound": columns["peak"]} | columns
    table = np.stack([columns[name] for name in ("id", "x", "y", "z", *_PIECE)], 1)
    return [
        Piece(int(row[0]), pose.rotation @ row[1:4] + pose.translation, *row[4:].tolist())
        for row in table.astype(float)
    ]
