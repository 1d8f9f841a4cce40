# SPDX-License-Identifier: Apache-2.0
"""Start each skin of a body as a process, and again if it ends, in the namespace of its name.

A file in Python, since YAML cannot say "for each skin that config names"; body.launch.yaml includes
it, unless separate:=false, and has the arguments.
"""

from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from tactile_skin.middleware.parameter_file import ParameterFile

GIVEN = "config", "wait_for_port", "method"


def skins(context) -> list[Node]:
    """Return the programs of the skins that this computer runs."""
    given = {name: LaunchConfiguration(name).perform(context) for name in GIVEN}
    file = ParameterFile(given["config"], own=True)
    return [
        Node(
            package="tactile_skin",
            executable="skin",
            namespace=name,
            output="screen",
            parameters=[given],
            respawn=True,
            respawn_delay=0.1,
        )
        for name in file.skins
        if name not in file.elsewhere
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([OpaqueFunction(function=skins)])
