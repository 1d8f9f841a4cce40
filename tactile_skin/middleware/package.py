# SPDX-License-Identifier: Apache-2.0
"""What the package brings, its nodes, its launch and config folders, and the nodes of a user's."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

from ..errors import LaunchError

PACKAGE = "tactile_skin"
NODES = {  # exec -> class, imported when it is started
    "serial_driver": "serial_driver.SerialDriver",
    "compensation": "compensation.Compensation",
    "gesture_feature": "gesture_feature.GestureFeature",
    "gestures": "observers.gestures.Gestures",
    "stop_on_push": "stop_on_push.StopOnPush",
    "body": "body.Body",
    "cmd_vel_gate": "cmd_vel_gate.CmdVelGate",
    "push_to_move": "push_to_move.PushToMove",
    "monitor": "observers.monitor.Monitor",
    "push_arrow": "push_arrow.PushArrow",
    "view": "observers.view.View",
}
# of each skin, in the way of the data
SKIN_NODES = "serial_driver", "compensation", "gesture_feature", "stop_on_push"
SOURCES = {  # topic -> the node that publishes it from its start on
    "skin/adc": "serial_driver",
    "skin/pressure": "compensation",
    "skin/contacts": "gesture_feature",
    "skin/stop_status": "stop_on_push",
}
BODY = "body"  # the node of several skins: who starts it starts their nodes as well
VIEW = "view"  # it shows one skin, or those of a body; so does
MONITOR = "monitor"
RECORDER = "recorder"  # of any launch file, but not on ROS
COMPOSED = "skin"  # the program of a skin's nodes
# Its nodes, in the way of the data, and whether they run unless a parameter says so.
PARTS = {
    **dict.fromkeys(SKIN_NODES, True),
    "gestures": False,
    "cmd_vel_gate": False,
    "push_to_move": False,
    "monitor": False,
}
CLASSES = NODES | {RECORDER: "observers.recorder.RecorderNode"}


def share_dir() -> Path:
    """Where launch/ and config/ are: the source tree, or share/tactile_skin of the installation."""
    here = Path(__file__).resolve()
    for parent in here.parents[2:]:
        for place in (parent, parent / "share" / PACKAGE):
            if (place / "package.xml").is_file() and (place / "launch").is_dir():
                return place
    raise LaunchError(f"the launch and config folders of {PACKAGE} are not beside {here}")


def find(path) -> Path:
    """Find a launch file: as given, or by a bare name among those of the package."""
    shipped = share_dir() / "launch" / Path(path).name
    # who names a folder does not mean another file of the same name
    bare = not os.path.dirname(path) and not Path(path).exists()
    return shipped if bare and shipped.is_file() else Path(path)


def node_class(executable: str, file: object = "launch file") -> type:
    """Return the class of a node: one of ours by its name, or module.Class of a user's.

    Raises:
        LaunchError: the module cannot be imported, or has no such class.
    """
    ours = executable in CLASSES
    full = f"{PACKAGE}.nodes.{CLASSES[executable]}" if ours else executable
    module, _, name = full.rpartition(".")
    where = f"{file}: node {executable}"
    try:
        found = importlib.import_module(module)
    except (ImportError, TypeError, ValueError) as error:  # the latter of a name that is none
        raise LaunchError(
            f"{where}: must be module.Class or one of {', '.join(NODES)}: importing {module!r} "
            f"failed: {error}"
        ) from error
    kind = getattr(found, name, None)
    if not isinstance(kind, type):
        own = [n for n, v in vars(found).items() if isinstance(v, type)]
        own = [n for n in own if vars(found)[n].__module__ == found.__name__]
        there = ", ".join(own) or "none"
        raise LaunchError(f"{where}: {module} has no class {name!r}; there are: {there}")
    return kind
