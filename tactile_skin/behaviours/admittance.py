# SPDX-License-Identifier: Apache-2.0
"""Led by a push: the paper's motor-assisted positioning, as an admittance.

The robot moves as a mass m on a damper d would under the push, m dv/dt + d v = F: it follows the
hand, and comes to rest when the hand lets go. Below a dead band nothing moves.

The step is the exact solution for a force that holds for the step, v(t + dt) = a v + (1 - a) F / d
with a = exp(-d dt / m), stable for any dt. Limits of speed and acceleration then only shorten the
way from the old velocity to the new one. A release slows the robot down within its limits. Whatever
else ends a push - a stop for another reason, readings that stay away, a stop node that is silent,
hands on several sides - is zero at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fields import Checked, group, parameter
from .gate import Motion, zero
from .stop import MAX_AHEAD, StopMessage

_REST = 1e-3  # m/s, rad/s: slower than this, and not pushed, is at rest


class Axis(Checked):
    """One kind of motion; a steady force F above the dead band moves at F / damping."""

    mass: float
    damping: float
    dead_band: float
    max_speed: float
    max_acceleration: float

    def step(self, velocity: np.ndarray, force: np.ndarray, dt: float) -> np.ndarray:
        """Return the velocity (n,) after dt [s] under a force (n,) that holds meanwhile."""
        size = float(np.linalg.norm(force))
        if size <= self.dead_band:
            force = np.zeros_like(force)
        else:
            force = force * (1.0 - self.dead_band / size)
        decay = math.exp(-self.damping * dt / self.mass)
        target = decay * velocity + (1.0 - decay) * force / self.damping
        target = _within(target, self.max_speed)
        limit = self.max_acceleration * dt
        new = velocity + _within(target - velocity, limit)
        slow = np.linalg.norm(new) < _REST and np.linalg.norm(velocity) <= limit
        return np.zeros_like(new) if slow and not force.any() else new


def _within(vector: np.ndarray, length: float) -> np.ndarray:
    """Return the vector, shortened to a length."""
    size = float(np.linalg.norm(vector))
    return vector if size <= length else vector * (length / size)


@dataclass(frozen=True)
class Linear(Axis):
    """Along the floor."""

    mass: float = parameter(20.0, "kg", "virtual mass", 0.01, 1e4)
    damping: float = parameter(80.0, "N s/m", "force per velocity", 0.01, 1e5)
    dead_band: float = parameter(5.0, "N", "below which the robot does not move", 0.0, 500.0)
    max_speed: float = parameter(0.3, "m/s", "largest velocity", 0.001, 2.0)
    max_acceleration: float = parameter(1.0, "m/s^2", "largest change of it", 0.001, 10.0)


@dataclass(frozen=True)
class Angular(Axis):
    """About the vertical."""

    mass: float = parameter(2.0, "kg m^2", "virtual inertia", 0.01, 1e4)
    damping: float = parameter(8.0, "N m s/rad", "force per velocity", 0.01, 1e5)
    dead_band: float = parameter(1.0, "N m", "below which the robot does not move", 0.0, 500.0)
    max_speed: float = parameter(0.5, "rad/s", "largest velocity", 0.001, 2.0)
    max_acceleration: float = parameter(2.0, "rad/s^2", "largest change of it", 0.001, 10.0)


@dataclass(frozen=True)
class AdmittanceConfig(Checked):
    """What a robot that follows a push may do; hands on several sides lead nowhere."""

    linear: Linear = group(Linear)
    turns: bool = parameter(False, "", "let the torque about the vertical turn the robot")
    angular: Angular = group(Angular)
    touch_timeout: float = parameter(
        0.1,
        "s",
        "maximum age of a reading that moves the robot; this is the dead man's switch",
        0.02,
        1.0,
    )
    stop_timeout: float = parameter(0.1, "s", "longest silence of the stop", 0.05, 1.0)
    alignment: float = parameter(
        0.7, "", "minimum |sum of force vectors| / sum of forces of one hand", 0.1, 1.0
    )


class Admittance:
    """Takes touches and the stop's messages as they come; all times are of one clock [s]."""

    def __init__(self, config: AdmittanceConfig):
        self.config = config
        self._stop = (-math.inf, StopMessage(True, ""))
        self._seen = -math.inf  # stamp of the newest touch
        self._wrench = np.zeros(3)  # (3,) force along x, y [N] and torque about z [N m]
        self._trouble = ""  # why the newest touch leads nowhere
        self._t: float | None = None  # of the last step
        self._velocity = np.zeros(3)  # (3,) along x, y [m/s] and about z [rad/s]

    def stop(self, t: float, message: StopMessage) -> None:
        """Take a message of the stop."""
        self._stop = t, message

    def touch(
        self,
        stamp: float,
        total: float,
        force: Sequence[float] | np.ndarray,
        torque: Sequence[float] | np.ndarray,
    ) -> None:
        """Take what a reading says of the touch, in the base frame.

        Args:
            total: sum of the cells' forces [N].
            force: (3,) sum of their vectors [N], on the robot.
            torque: (3,) about the base frame's origin [N m].
        """
        if not stamp > self._seen:
            return
        self._seen = stamp
        self._wrench = np.array([force[0], force[1], torque[2]], float)
        self._trouble = ""
        one_side = np.linalg.norm(force) >= self.config.alignment * total
        if not (np.isfinite([*force, *torque]).all() and math.isfinite(total)):
            unknown = math.isfinite(total) and np.isnan(force).all()
            self._trouble = "the wrench is not finite" + ": set geometry.shape" * bool(unknown)
        elif total > self.config.linear.dead_band and not one_side:
            self._trouble = "pushes from several sides"

    def step(self, t: float) -> Motion:
        """Return the velocity from now on; call it on a timer, with each reading if you want."""
        config = self.config
        if self._seen > t + MAX_AHEAD:  # the clock was set back: what was seen is of no time
            self._seen = -math.inf
        # after a longer pause than that the touch is too old to say what happened meanwhile
        dt = 0.0 if self._t is None else min(max(0.0, t - self._t), config.touch_timeout)
        self._t = t
        heard, message = self._stop
        decision = message.at(t)
        reason = ""
        if not 0.0 <= t - heard <= config.stop_timeout:
            reason = "no message from the stop"
        elif decision.stop and not decision.for_push_alone:
            reason = decision.reason or "stop"
        elif not -MAX_AHEAD <= t - self._seen <= config.touch_timeout:
            reason = "no reading"
        elif self._trouble:
            reason = self._trouble
        if reason:
            self._velocity = np.zeros(3)
            return zero(reason)
        velocity = np.zeros(3)
        velocity[:2] = config.linear.step(self._velocity[:2], self._wrench[:2], dt)
        if config.turns:
            velocity[2:] = config.angular.step(self._velocity[2:], self._wrench[2:], dt)
        self._velocity = velocity
        x, y, yaw = velocity
        return Motion(np.array([x, y, 0.0]), np.array([0.0, 0.0, yaw]), "")
