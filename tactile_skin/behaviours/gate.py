# SPDX-License-Identifier: Apache-2.0
"""Which motions a robot may make: the velocity gate. One page, no clock and no bus of its own.

What comes out is the command, the command slowed, or zero: never a motion that nobody asked for,
whatever the base can drive. It is

- zero for every stop but a push, when the stop or the command falls silent, and for a command that
  is no number, has a stamp that is old or in the future, or is of another frame;
- while a push is on: the command as it is if it moves the touched point with the push or along the
  skin; zero if it moves it against the push by more than 0.1 rad; in between it is slowed, so that
  noise of the direction does not make a robot stutter that drives along the skin;
- zero while the direction of the push is unknown: it is not published, nobody has stated the shape
  of the cover (`geometry.shape`), or the push comes from several sides (a squeeze).

A touched point moves at v + w x p, so a rotation that turns the skin into the hand is blocked, and
one that turns it away is not; with two hands on one side the point that goes most against them
counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..fields import Checked, parameter
from .stop import MAX_AHEAD, StopMessage

_EDGE = math.sin(0.1)  # sine of the angle into the contact at which a motion is blocked


class Motion(NamedTuple):
    linear: np.ndarray  # (3,) [m/s], in the base frame
    angular: np.ndarray  # (3,) [rad/s]
    reason: str  # why it is less than what was asked for; empty when it is not less


@dataclass(frozen=True)
class GateConfig(Checked):
    """When the gate lets a command pass.

    A touch below `touch` has no direction of its own: the last one holds until the push is over, or
    something touches another side.
    The alignment is 1 for a finger, 0.9 for two equal pushes 52 degrees apart, 0 for a squeeze.
    """

    command_timeout: float = parameter(
        0.25, "s", "maximum age of cmd_vel_in; this is the dead man's switch", 0.02, 2.0
    )
    stop_timeout: float = parameter(0.1, "s", "longest silence of the stop", 0.05, 1.0)
    touch_timeout: float = parameter(0.1, "s", "maximum age of a push direction", 0.02, 1.0)
    touch: float = parameter(
        5.0, "N", "contact force above which a touch has a direction", 0.1, 500.0
    )
    alignment: float = parameter(
        0.9, "", "minimum |sum of force vectors| / sum of forces of a push from one side", 0.5, 1.0
    )


class Gate:
    """Takes commands, touches and the stop's messages; all times are of one clock [s]."""

    def __init__(self, config: GateConfig):
        self.config = config
        self._command = (-math.inf, np.zeros(3), np.zeros(3))
        self._stamp, self._refused = -math.inf, ""  # of the command
        self._stop = (-math.inf, StopMessage(True, ""))
        self._seen, self._total = -math.inf, 0.0  # stamp and force of the newest touch
        self._push: tuple[np.ndarray, np.ndarray] | None = None  # direction, (n, 3) places
        self._trouble = "its direction is unknown"  # why there is no `_push`

    def command(
        self,
        t: float,
        linear: npt.ArrayLike,
        angular: npt.ArrayLike,
        stamp: float | None = None,
        refused: str = "",
    ) -> None:
        """Take a velocity that is asked for: (3,) [m/s] and (3,) [rad/s], in the base frame.

        Args:
            stamp: when it was made [s]; None: it does not say, and is new.
            refused: why it is not carried out; empty if it is.
        """
        self._command = t, np.asarray(linear, float), np.asarray(angular, float)
        self._stamp, self._refused = t if stamp is None else stamp, refused

    def stop(self, t: float, message: StopMessage) -> None:
        """Take a message of the stop."""
        self._stop = t, message
        self._forget_what_is_over()

    def touch(
        self, stamp: float, total: float, force: npt.ArrayLike, places: npt.ArrayLike
    ) -> None:
        """Take what a reading says of the touch, in the base frame.

        Args:
            total: sum of the cells' forces [N].
            force: (3,) sum of their vectors [N], on the robot.
            places: (3,) or (n, 3) centres of force of its contacts [m].
        """
        if not stamp > self._seen:
            return
        self._seen, self._total = stamp, total
        vector, at = np.asarray(force, float), np.array(places, float, ndmin=2)
        if not (np.isfinite(at).all() and math.isfinite(total) and not np.isinf(vector).any()):
            self._push, self._trouble = None, "its force is not finite"
        elif np.isnan(vector).any():
            self._push, self._trouble = None, "its direction is unknown: set geometry.shape"
        elif total >= self.config.touch:
            length = float(np.linalg.norm(vector))
            if length >= self.config.alignment * total:
                self._push = vector / length, at
            elif not length:  # no normals; a squeeze is never balanced to the last bit
                self._push, self._trouble = None, "its direction is unknown: set geometry.shape"
            else:
                self._push, self._trouble = None, "it comes from several sides"
        elif self._push and vector @ self._push[0] < self.config.alignment * total:
            self._push, self._trouble = None, "it comes from several sides"  # another hand
        self._forget_what_is_over()

    def decide(self, t: float) -> Motion:
        """Return what the robot may do at t, also when nothing comes: call it on a timer."""
        if self._seen > t + MAX_AHEAD:  # the clock was set back: what was seen is of no time
            self._seen = -math.inf
        since, linear, angular = self._command
        heard, message = self._stop
        decision = message.at(t)
        if not 0.0 <= t - heard <= self.config.stop_timeout:
            return zero("no message from the stop")
        if decision.stop and not decision.for_push_alone:
            return zero(decision.reason or "stop")
        if not 0.0 <= t - since <= self.config.command_timeout:
            return zero("no command")
        if self._refused:
            return zero(self._refused)
        if not -MAX_AHEAD <= t - self._stamp <= self.config.command_timeout:
            when = "in the future" if self._stamp > t else "old"
            return zero(f"the command's stamp is {when}: synchronise the clocks")
        if not (np.isfinite(linear).all() and np.isfinite(angular).all()):
            return zero("the command is not finite")
        if not decision.stop:
            return Motion(linear, angular, "")
        if not -MAX_AHEAD <= t - self._seen <= self.config.touch_timeout:
            return zero("push: its direction is not published")
        if self._push is None:
            return zero(f"push: {self._trouble}")
        direction, places = self._push
        with np.errstate(over="ignore", invalid="ignore"):
            velocity = linear + np.cross(angular, places)  # (n, 3) of the touched points
            speed = np.linalg.norm(velocity, axis=1)
        if not np.isfinite(speed).all():  # the square of 1e155 m/s is not
            return zero("the command is not finite")
        into = -(velocity @ direction)
        against = into > 1e-9 * speed
        if not against.any():
            return Motion(linear, angular, "")
        share = max(0.0, 1.0 - float((into[against] / speed[against]).max()) / _EDGE)
        return Motion(share * linear, share * angular, "push: motion against it")

    def _forget_what_is_over(self) -> None:
        """Forget the last direction of a push that is over and held no longer."""
        if not self._stop[1].stop and self._total < self.config.touch:
            self._push, self._trouble = None, "its direction is unknown"


def zero(reason: str) -> Motion:
    """No motion, and why."""
    return Motion(np.zeros(3), np.zeros(3), reason)
