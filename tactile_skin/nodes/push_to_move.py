# SPDX-License-Identifier: Apache-2.0
"""push_to_move: the touch and the stop's messages -> cmd_vel that follows the hand."""

from __future__ import annotations

from ..behaviours.admittance import Admittance
from ..middleware.config import declared
from ..parameters.nodes import PushToMove as Parameters
from .cmd_vel import CmdVel
from .touch import Touch, on_touch


class PushToMove:
    """Publishes cmd_vel with every reading, and at least 50 times a second.

    See admittance.py and cmd_vel.py.

    It takes the place of the stop for pushes, and only for them: it moves while skin/stop_status is
    free or says push and nothing else.
    """

    def __init__(self, node):
        given = declared(node, Parameters)
        self.admittance = Admittance(given)
        self._cmd_vel = CmdVel(node, given, self.admittance.step, self.admittance.stop)
        on_touch(node, self.on_touch, given.base_frame, given.frame_id)

    def on_touch(self, touch: Touch) -> None:
        self.admittance.touch(touch.stamp, touch.total, touch.force, touch.torque)
        self._cmd_vel.publish()

    def close(self) -> None:
        self._cmd_vel.close()
