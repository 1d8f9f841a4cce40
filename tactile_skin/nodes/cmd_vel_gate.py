# SPDX-License-Identifier: Apache-2.0
"""cmd_vel_gate: cmd_vel_in, the stop's messages and the touch -> cmd_vel."""

from __future__ import annotations

import numpy as np

from ..behaviours.gate import Gate
from ..middleware.config import declared
from ..msg import Header, Twist, TwistStamped
from ..parameters.nodes import CmdVelGate as Parameters
from . import now, seconds
from .cmd_vel import CmdVel, twist_of
from .touch import Touch, on_touch, xyz


class CmdVelGate:
    """Publishes cmd_vel with every command and touch, and at least 50 times a second.

    See gate.py and cmd_vel.py.

    A push has no direction while tf does not know its frame in that of the velocities. A stamped
    command that passes keeps its stamp.
    """

    def __init__(self, node):
        self._node, given = node, declared(node, Parameters)
        self.gate = Gate(given)
        self._cmd_vel = CmdVel(node, given, self.gate.decide, self.gate.stop)
        on_touch(node, self.on_touch, given.base_frame, given.frame_id)
        node.create_subscription(self._cmd_vel.kind, "cmd_vel_in", self.on_command, 1)

    def on_touch(self, touch: Touch) -> None:
        places = np.vstack([touch.centre, touch.places])
        self.gate.touch(touch.stamp, touch.total, touch.force, places)
        if touch.total:  # another side may be touched: that need not wait for the timer
            self._cmd_vel.publish()

    def on_command(self, msg: Twist | TwistStamped) -> None:
        twist, stamp, refused = twist_of(msg), None, ""
        if isinstance(msg, TwistStamped):
            header, ours = msg.header, self._cmd_vel.frame
            # a stamp of 0 is none, as for ros2_control's controllers
            stamp = seconds(header) or None
            self._cmd_vel.asked = Header(header.stamp, ours) if stamp else None
            if header.frame_id not in ("", ours):
                refused = f"the command is in {header.frame_id!r}, the gate in {ours}"
        t = now(self._node)
        self.gate.command(t, xyz(twist.linear), xyz(twist.angular), stamp, refused)
        self._cmd_vel.publish()

    def close(self) -> None:
        self._cmd_vel.close()
