"""cmd_vel_gate: cmd_vel_in, the stop's messages and the touch -> cmd_vel."""

from __future__ import annotations

import numpy as np

from ..behaviours.gate import Gate, GateConfig
from ..middleware.config import declared
from ..msg import Twist, TwistStamped
from ..parameters.fields import configured
from ..parameters.nodes import CmdVelGate as Parameters
from . import frames
from .cmd_vel import CmdVel, twist_of
from .touch import Touch, on_touch, xyz


class CmdVelGate:
    """Publishes cmd_vel with every command, and at least 50 times a second: gate.py, cmd_vel.py.

    Positions, forces and velocities are in one frame, or tf knows where the skin's frame is in that
    of the velocities, `base_frame`.
    """

    def __init__(self, node):
        given = declared(node, Parameters)
        self.gate = Gate(configured(GateConfig, given))
        self._base = given.base_frame
        self._frames = frames.hear(node) if self._base else None
        self._cmd_vel = CmdVel(node, given, self.gate.decide, self.gate.stop)
        self._cmd_vel.frame = self._base or self._cmd_vel.frame
        on_touch(node, self.on_touch)
        node.create_subscription(self._cmd_vel.kind, "cmd_vel_in", self.on_command, 1)

    def on_touch(self, touch: Touch) -> None:
        if self._frames is not None and touch.frame != self._base:
            try:
                touch = touch.seen_from(self._frames.lookup(self._base, touch.frame, touch.stamp))
            except LookupError:
                return  # a push without a direction: the gate closes
        places = np.vstack([touch.centre, touch.places])
        self.gate.touch(touch.stamp, touch.total, touch.force, places)

    def on_command(self, msg: Twist | TwistStamped) -> None:
        twist = twist_of(msg)
        self.gate.command(self._cmd_vel.now(), xyz(twist.linear), xyz(twist.angular))
        self._cmd_vel.publish()

    def close(self) -> None:
        self._cmd_vel.close()
