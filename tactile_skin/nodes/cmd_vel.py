# SPDX-License-Identifier: Apache-2.0
"""What the nodes that move the robot have in common: the stop's messages in, cmd_vel out."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from ..behaviours.gate import Motion
from ..behaviours.stop import StopMessage
from ..msg import DiagnosticArray, Header, Twist, TwistStamped, Vector3
from . import diagnostics, now
from .stop_on_push import STATUS, STATUS_TOPIC, stop_message_of

PERIOD = 0.02  # s, between two velocities at most
_STILL = Motion(np.zeros(3), np.zeros(3), "the clock stands still")


class CmdVel:
    """Publishes cmd_vel at least 50 times a second, zeros included.

    A base that keeps its last command stops so. The final message is zero.

    It reports on diagnostics why motion is not permitted, always at level OK: an error there would
    be another stop.

    Attributes:
        frame: of stamped velocities.
        asked: header of the command that its motion is of; None: it is of no command.
        kind: of its velocities: Twist, or with the parameter `stamped` TwistStamped.

    Args:
        given: the node's parameters: `stamped`, `base_frame` and `frame_id`.
        decide: time [s] -> Motion.
        take_stop: called with (time [s], StopMessage) for each message of the stop.
    """

    def __init__(self, node, given, decide: Callable, take_stop: Callable):
        self._node, self._decide, self._take_stop = node, decide, take_stop
        self._message: StopMessage | None = None
        self._reason: str | None = None
        self._closed = threading.Lock()  # never released once the final zero is published
        self.kind = kind_of(given.stamped)
        self.frame = given.base_frame or given.frame_id
        self.asked: Header | None = None
        self._cmd_vel = node.create_publisher(self.kind, "cmd_vel", 1)
        self._diagnostics = diagnostics.Reporter(node)
        node.create_subscription(DiagnosticArray, STATUS_TOPIC, self.on_status, STATUS)
        node.create_timer(PERIOD, self.publish)
        node.create_timer(1.0, self.report)

    def on_status(self, msg: DiagnosticArray) -> None:
        t = now(self._node)
        message = stop_message_of(msg, t)
        self._take_stop(t, message)
        if (
            self._message is None or message[:2] != self._message[:2]
        ):  # a stop need not wait for the timer
            self.publish()
        self._message = message

    def publish(self) -> None:
        if self._closed.acquire(blocking=False):
            try:
                still = self._node.get_clock().stands_still
                motion = _STILL if still else self._decide(now(self._node))
                vectors = (Vector3(*map(float, v)) for v in (motion.linear, motion.angular))
                self._send(Twist(*vectors))
            finally:
                self._closed.release()
            if motion.reason != self._reason:
                self._reason = motion.reason
                self.report()

    def report(self) -> None:
        text = f"motion withheld: {self._reason}" if self._reason else "ok"
        self._diagnostics.publish(diagnostics.report(self._node, diagnostics.OK, text, {}))

    def close(self) -> None:
        self._closed.acquire()
        self._send(Twist())

    def _send(self, twist: Twist) -> None:
        """Send a motion as old as its command, and no motion as news."""
        if self.kind is TwistStamped:
            header = self.asked if twist != Twist() else None
            header = header or Header(self._node.get_clock().now().to_msg(), self.frame)
            self._cmd_vel.publish(TwistStamped(header, twist))
        else:
            self._cmd_vel.publish(twist)


def kind_of(stamped: bool) -> type:
    """Return the type of velocities."""
    return TwistStamped if stamped else Twist


def twist_of(message: Twist | TwistStamped) -> Twist:
    return message.twist if isinstance(message, TwistStamped) else message
