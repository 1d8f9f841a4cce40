# SPDX-License-Identifier: Apache-2.0
"""The parameters of each node: default, unit, meaning, range.

A line here is all that a new parameter needs; the node reads it as an attribute.
"""

from __future__ import annotations

import dataclasses
import functools

from ..behaviours.admittance import AdmittanceConfig
from ..behaviours.gate import GateConfig
from ..behaviours.stop import PushLimits, StopConfig
from ..board.formats import PROTOCOLS, fields
from ..fields import group, leaves, parameter
from .shared import Circuit, Curve, Framed, Geometry, Shared, SkinDescription

# Those of `solvers.METHODS`, which takes as long to import as all the rest; a test compares them.
METHODS = "naive", "fixed_point", "newton", "map", "cnn", "physics", "auto"
SKINS = "names of those of a body, by the parameter file's `skins`"
_BASE = "frame of the velocities, by tf from frame_id; empty: they are the same"
_STAMPED = "velocities are TwistStamped, not Twist"

Format = dataclasses.make_dataclass(
    "Format",
    [
        (
            name,
            type(field.default),
            parameter(field.default, "", field.metadata["about"], *field.metadata["bounds"]),
        )
        for name, field in fields().items()
    ],
    frozen=True,
)
Format.__doc__ = "How another sketch sends its frames: text, and packets."


@dataclasses.dataclass(frozen=True)
class SerialDriver(Framed):
    """The bytes of the board."""

    circuit: Circuit = group(Circuit)
    port: str = parameter("auto", "", "serial device, or auto: the first that sends frames")
    serial_number: str = parameter(
        "",
        "",
        "of the USB board that auto looks for, or the USB socket of one that has none, by detect; "
        "empty: any",
    )
    baud: int = parameter(
        1_000_000,
        "bit/s",
        "as in your sketch; should allow twice the bytes that the board sends",
        300,
        20_000_000,
    )
    wait_for_port: float = parameter(0.0, "s", "time to wait for the port to appear", 0.0, 3600.0)
    protocol: str = parameter(
        "binary", "", "`tactile-skin detect` finds it (docs/boards.md)", choices=PROTOCOLS
    )
    format: Format = group(Format)  # type: ignore[valid-type]
    watchdog: float = parameter(3.0, "s", "silence after which the port is reopened", 0.1, 60.0)
    frozen_after: float = parameter(
        0.2,
        "s",
        "frames that repeat for this long come from a frozen board, which stops the robot: real "
        "samples contain noise, and how often a working board repeats itself is measured; 0: "
        "never, for a board that averages all noise away (docs/reliability.md)",
        0.0,
        60.0,
    )


@dataclasses.dataclass(frozen=True)
class Compensation:
    """From readings to pressures."""

    circuit: Circuit = group(Circuit)
    curve: Curve = group(Curve)
    geometry: Geometry = group(Geometry)
    method: str = parameter("auto", "", "docs/how.md compares them", choices=METHODS, live=True)
    weights: str = parameter(
        "", "", "file written by `tactile-skin train`; empty: the shipped weights"
    )
    board_threshold: float = parameter(
        0.0, "ADC steps", "up to which the board sends 0; disables the tare", 0.0, 65535.0
    )
    noise: float = parameter(
        0.0, "ADC steps", "RMS noise of a reading; 0: measured while nothing touches", 0.0, 1e3
    )
    time_limit: float = parameter(
        0.0,
        "s",
        "after which a frame fails, which stops the robot; 0: two frames of the board's, 0.05 to "
        "0.5 s",
        0.0,
        10.0,
    )
    tare: bool = parameter(
        True,
        "",
        "track the readings of the cells at rest (a touch is never tared away); false: only where "
        "each cell rests as the curve says, to 0.5 %, else its picture is suspect and stops the "
        "robot",
    )
    suspect_stops: bool = parameter(
        True, "", "faults of the circuit and a saturated input stop the robot"
    )


@dataclasses.dataclass(frozen=True)
class GestureFeature(Framed):
    """From pressures to contacts, wrench, push direction and gestures."""

    circuit: Circuit = group(Circuit)
    geometry: Geometry = group(Geometry)
    skin_frame: str = parameter(
        "", "", "the skin's name in tf, where geometry puts it in frame_id; empty: none"
    )
    cell_threshold: float = parameter(
        0.2,
        "N",
        "a contact has a cell above this (20 g), or 200 times this, at most 40 N, in total",
        1e-3,
        1.0,
        live=True,
    )


@dataclasses.dataclass(frozen=True)
class Gestures:
    """Names what a hand does; started by gestures:=true."""

    circuit: Circuit = group(Circuit)
    geometry: Geometry = group(Geometry)
    model: str = parameter(
        "", "", "written by `gestures train`; empty: none; shipped: trained on simulated hands"
    )
    min_probability: float = parameter(
        0.7, "", "from which on a gesture is named; less sure ones are 'other'", 0.3, 1.0, live=True
    )


@dataclasses.dataclass(frozen=True)
class Body(Framed, PushLimits):
    """Several skins as one: pushes that touch two or more of them, started by body.launch.yaml."""

    skins: list[str] = parameter([""], "", SKINS)
    separate: bool = parameter(True, "", "a process for each skin, if there are several cores")


@dataclasses.dataclass(frozen=True)
class StopOnPush(StopConfig):
    """What a push is, and when the robot is stopped for it."""

    curve: Curve = group(Curve)


@dataclasses.dataclass(frozen=True)
class CmdVelGate(Framed, GateConfig):
    """Started by cmd_vel_gate:=true."""

    base_frame: str = parameter("", "", _BASE)
    stamped: bool = parameter(False, "", _STAMPED)


@dataclasses.dataclass(frozen=True)
class PushToMove(Framed, AdmittanceConfig):
    """Started by push_to_move:=true; stop_on_push must not latch."""

    base_frame: str = parameter("", "", _BASE)
    stamped: bool = parameter(False, "", _STAMPED)


@dataclasses.dataclass(frozen=True)
class Monitor:
    """Started by monitor:=true."""

    skins: list[str] = parameter([""], "", SKINS)
    duration: float = parameter(
        0.0, "s", "end this long after the first frame; 0: at Ctrl-C", 0.0, 1e9
    )
    stamped: bool = parameter(False, "", _STAMPED)


@dataclasses.dataclass(frozen=True)
class View(SkinDescription):
    """Started by view:=true."""

    skins: list[str] = parameter([""], "", SKINS)
    host: str = parameter("127.0.0.1", "", "address to serve the page on; 0.0.0.0: all of them")
    port: int = parameter(8321, "", "TCP port of the page; 0: any that is free", 0, 65535)
    controls: bool = parameter(
        False, "", "whether a page may tare, reset the stop, record, detect and calibrate"
    )


@dataclasses.dataclass(frozen=True)
class PushArrow:
    """Started by rviz.launch.yaml."""

    length: float = parameter(0.2, "m", "of the arrow", 0.001, 100.0)


@dataclasses.dataclass(frozen=True)
class Recorder:
    """Started by record:=FILE.mcap, or a folder."""

    path: str = parameter("", "", "file to make, or folder for files named after their time")
    last: float = parameter(
        0.0,
        "s",
        "keep only so long before each stop, and 2 s after it; 0: keep everything",
        0.0,
        600.0,
    )
    max_duration: float = parameter(0.0, "s", "of a recording; 0: no limit", 0.0, 1e9)
    max_size: float = parameter(2000.0, "MB", "of its files together; 0: no limit", 0.0, 1e9)


SECTIONS: dict[str, type] = {  # node -> its parameters, in the order of config/skin.yaml
    "serial_driver": SerialDriver,
    "compensation": Compensation,
    "gesture_feature": GestureFeature,
    "gestures": Gestures,
    "stop_on_push": StopOnPush,
    "body": Body,
    "cmd_vel_gate": CmdVelGate,
    "push_to_move": PushToMove,
    "monitor": Monitor,
    "view": View,
    "push_arrow": PushArrow,
    "recorder": Recorder,
}


@functools.cache
def shared_names() -> frozenset[str]:
    """Return the names of the parameters that a file holds under /**."""
    return frozenset(leaf.name for leaf in leaves(Shared))


@functools.cache
def all_names(node: str) -> frozenset[str]:
    """Return the names of a node's parameters."""
    return frozenset(leaf.name for leaf in leaves(SECTIONS[node]))


@functools.cache
def own_names(node: str) -> frozenset[str]:
    """Return the names of the parameters that a file holds under the node's own name."""
    return all_names(node) - shared_names()
