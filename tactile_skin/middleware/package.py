"""What the package brings: its programs, its launch and config folders."""

from __future__ import annotations

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
    "cmd_vel_gate": "cmd_vel_gate.CmdVelGate",
    "push_to_move": "push_to_move.PushToMove",
    "monitor": "observers.monitor.Monitor",
    "push_arrow": "push_arrow.PushArrow",
    "view": "observers.view.View",
    "tactile_state": "observers.tactile_state.TactileState",
}
RECORDER = "recorder"  # of any launch file, but not on ROS; so is
FOXGLOVE = "foxglove"
COMPOSED = "skin"  # the program that runs a whole skin on ROS
_OBSERVERS = {RECORDER: "observers.recorder.RecorderNode", FOXGLOVE: "observers.foxglove.Foxglove"}
CLASSES = NODES | _OBSERVERS


def share_dir() -> Path:
    """Where launch/ and config/ are: the source tree, or share/tactile_skin of the installation."""
    here = Path(__file__).resolve()
    for parent in here.parents[2:]:
        for place in (parent, parent / "share" / PACKAGE):
            if (place / "package.xml").is_file() and (place / "launch").is_dir():
                return place
    raise LaunchError(f"the launch and config folders of {PACKAGE} are not beside {here}")


def find(path) -> Path:
    """A launch file as given; a bare name that is no file here, among those of the package.

    Raises:
        LaunchError: a path to nothing whose last part is the name of one of the package.
    """
    if Path(path).exists():
        return Path(path)
    shipped = share_dir() / "launch" / Path(path).name
    if not shipped.is_file():
        return Path(path)  # to be named when it is read
    if os.path.dirname(path):  # who names a folder does not mean another file of the same name
        raise LaunchError(
            f"launch file {path}: does not exist; the one of {PACKAGE} is meant by its name alone: "
            f"{shipped.name}"
        )
    return shipped
