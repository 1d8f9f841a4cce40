# SPDX-License-Identifier: Apache-2.0
"""Led by a push: the paper's motor-assisted positioning, as an admittance.

The robot moves as a mass m on a damper d would under the push, m dv/dt + d v = F: it follows the
hand, and comes to rest when the hand lets go. Below a dead band nothing moves.

The step is the exact solution for a force that holds for the step, v(t + dt) = a v + (1 - a) F / d
with a = exp(-d dt / m), so that it is stable for any dt: the new velocity lies between the old one
and F / d, and so does the energy. Limits of speed and acceleration then only shorten the way from
the old velocity to the new one.

A release slows the robot down within its limits. Whatever else ends a push - a stop for another
reason, readings that stay away, a stop node that is silent, hands on several sides - is zero at
once: what the skin says is not known to be true then, and the base has limits of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .gate import Motion, zero
from .stop import FROM_ZERO, MAX_AHEAD, POSITIVE, SHARE, StopMessage, check

_REST = 1e-3  # m/s, rad/s: slower than this, and not pushed, is at rest


@dataclass(frozen=True)
class Axis:
    """One kind of motion: along the floor (m, N), or about the vertical (rad, N m).

    Attributes:
        mass: virtual mass [kg], or moment of inertia [kg m^2].
        damping: [N s/m], or [N m s/rad]; a steady force F above the dead band moves at F / damping.
        dead_band: force up to which nothing moves [N], or [N m]; what is above it counts.
        max_speed: [m/s], or [rad/s].
        max_acceleration: [m/s^2], or [rad/s^2], also when it slows down after a release.
    """

    mass: float
    damping: float
    dead_band: float
    max_speed: float
    max_acceleration: float

    def __post_init__(self) -> None:
        check(self, "axis", "mass damping max_speed max_acceleration", POSITIVE)
        check(self, "axis", "dead_band", FROM_ZERO)

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


LINEAR = Axis(mass=20.0, damping=80.0, dead_band=5.0, max_speed=0.3, max_acceleration=1.0)
ANGULAR = Axis(mass=2.0, damping=8.0, dead_band=1.0, max_speed=0.5, max_acceleration=2.0)


@dataclass(frozen=True)
class AdmittanceConfig:
    """What a robot that follows a push may do.

    Attributes:
    linear: along the floor, x and y together.
    angular: about the vertical; None: the robot does not turn.
    touch_timeout: how old the last reading may be [s]: the dead man's switch.
    stop_timeout: how long the stop may be silent [s]; five of its heartbeats.
    alignment: |sum of the cells' force vectors| / sum of their forces, below which hands on several
        sides lead nowhere.
    """

    linear: Axis = LINEAR
    angular: Axis | None = None
    touch_timeout: float = 0.1
    stop_timeout: float = 0.1
    alignment: float = 0.7

    def __post_init__(self) -> None:
        check(self, "admittance", "touch_timeout stop_timeout", POSITIVE)
        check(self, "admittance", "alignment", SHARE)


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
            self._trouble = "the wrench is not finite"
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
        if config.angular is not None:
            velocity[2:] = config.angular.step(self._velocity[2:], self._wrench[2:], dt)
        self._velocity = velocity
        x, y, yaw = velocity
        return Motion(np.array([x, y, 0.0]), np.array([0.0, 0.0, yaw]), "")
