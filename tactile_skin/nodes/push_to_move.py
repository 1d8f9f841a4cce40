"""push_to_move: the touch and the stop's messages -> cmd_vel that follows the hand."""

from __future__ import annotations

from ..behaviours.admittance import ANGULAR, LINEAR, Admittance, AdmittanceConfig, Axis
from ..middleware.config import describe
from .cmd_vel import CmdVel
from .touch import Touch, on_touch

_FIELDS = {  # of an axis: what it is, and the largest value that may be asked for
    "mass": ("virtual mass [kg], or inertia [kg m^2]", 0.01, 1e4),
    "damping": ("[N s/m], or [N m s/rad]", 0.01, 1e5),
    "dead_band": ("up to which nothing moves [N], or [N m]", 0.0, 500.0),
    "max_speed": ("[m/s], or [rad/s]", 0.001, 2.0),
    "max_acceleration": ("[m/s^2], or [rad/s^2]", 0.001, 10.0),
}


class PushToMove:
    """Publishes cmd_vel with every reading, and at least 50 times a second: see admittance.py,
    cmd_vel.py.

    It takes the place of the stop for pushes, and only for them: it moves while skin/stop_status is
    free or says push and nothing else.
    """

    def __init__(self, node):
        default = AdmittanceConfig()

        def value(name, default, *bounds):
            return node.declare_parameter(name, default, describe(*bounds)).value

        def axis(prefix: str, default: Axis) -> Axis:
            return Axis(
                **{
                    name: value(f"{prefix}.{name}", getattr(default, name), *bounds)
                    for name, bounds in _FIELDS.items()
                }
            )

        linear, angular = axis("linear", LINEAR), axis("angular", ANGULAR)
        turns = value("turns", False, "whether the torque about the vertical turns the robot")
        self.admittance = Admittance(
            AdmittanceConfig(
                linear,
                angular if turns else None,
                value("touch_timeout", default.touch_timeout, "oldest reading [s]", 0.02, 1.0),
                value("stop_timeout", default.stop_timeout, "silence of the stop [s]", 0.05, 1.0),
                value("alignment", default.alignment, "|sum of forces| / sum of |forces|", 0.1, 1),
            )
        )
        self._cmd_vel = CmdVel(node, self.admittance.step, self.admittance.stop)
        on_touch(node, self.on_touch)

    def on_touch(self, touch: Touch) -> None:
        self.admittance.touch(touch.stamp, touch.total, touch.force, touch.torque)
        self._cmd_vel.publish()

    def close(self) -> None:
        self._cmd_vel.close()
