# SPDX-License-Identifier: Apache-2.0
"""The same nodes on ROS 2, by rclpy: one a process, or all in one.

ROS carries the messages from process to process; within a process a node has what it has on the
bus: one thread for its callbacks, bounded queues, checked parameters, isolated exceptions.

    serial_driver --ros-args -r __node:=left --params-file skin.yaml -p port:=/dev/ttyUSB0
    skin --ros-args --params-file skin.yaml -p serial_driver:port:=/dev/ttyUSB0 -p monitor:=true
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import sys
from dataclasses import replace
from pathlib import Path

from . import launch
from .errors import LaunchError, did_you_mean
from .files import one_line
from .middleware.bus import Node
from .middleware.package import BODY, COMPOSED, PARTS, node_class
from .middleware.plan import NodeAction, Plan, shared_out, which_run, with_skins
from .middleware.ros.arguments import RosArguments, split_arguments
from .middleware.ros.node import Process, RosNode, ToRos
from .nodes import diagnostics, frames

_logger = logging.getLogger("tactile_skin")


class RosSkin(launch.Skin):
    """Nodes of this process that are on ROS as well, until a signal or ROS ends them."""

    def __init__(self, plan: Plan, process: Process):
        super().__init__(plan)
        self._process = process
        self._lost = False
        self._to_ros = ToRos()
        _logger.setLevel(logging.DEBUG)  # ROS has levels of its own
        _logger.propagate, _logger.handlers = False, [self._to_ros]

    def build(self) -> list[Node]:
        self._settings.callback(self._leave)
        super().build()
        for handle in self._handles:
            diagnostics.ensure_reported(handle)
            if isinstance(handle, RosNode):  # as _make_node makes them
                handle.connect(diagnostics.TOPIC, diagnostics.ALL, *frames.TOPICS)
        self._process.start(self.shutdown)
        return self._handles

    def _start_processes(self) -> None:
        """Start none: on ROS they are its launch's."""

    def _make_node(self, action: NodeAction) -> RosNode:
        node = RosNode(self._process, action.name, context=self._context, **action.arguments())
        self._to_ros.nodes[node.get_logger().name] = node.ros
        return node

    def _leave(self) -> None:
        self._lost = self._process.failed  # not what it may raise while it is closed
        self._process.close()

    @property
    def failed(self) -> bool:
        return self._lost or super().failed


def compose(*words: str) -> RosSkin:
    """Return the nodes of `skin` for this process, which may have nodes of rclpy of its own.

    They have a context and an executor of their own; use it with `with`.

    Args:
        words: as those of `ros2 run tactile_skin skin`: "--ros-args", "-p", "port:=/dev/ttyUSB0".

    Raises:
        ValueError: a word that is not understood, or a value that is not allowed.
        RosError: rclpy is not installed.
    """
    args = split_arguments(list(words))[1]
    return RosSkin(plan_of(COMPOSED, args), Process(args.others))


def run(executable: str, words: list[str] | None = None) -> int:
    """Run a program of `ros2 run tactile_skin`, a node or `skin`; the exit status, as of `cli`."""
    try:
        own, args = split_arguments(sys.argv[1:] if words is None else words)
        parser = argparse.ArgumentParser(prog=executable, description=_about(executable))
        parser.parse_args(own)
        skin = RosSkin(plan_of(executable, args), Process(args.others))
        # a signal that came before it ran has asked for the same
        with contextlib.suppress(KeyboardInterrupt, SystemExit), skin:
            skin.spin()
        return 1 if skin.failed else 0
    except KeyboardInterrupt:
        return 130
    except (ValueError, OSError, ModuleNotFoundError) as error:
        print(f"{executable}: error: {one_line(error)}", file=sys.stderr)
        return 2


def _about(executable: str) -> str:
    """Return the first line of the node's module."""
    if executable == COMPOSED:
        return f"All nodes of a skin in one process: {', '.join(PARTS)}."
    return (sys.modules[node_class(executable).__module__].__doc__ or "").splitlines()[0]


def plan_of(executable: str, args: RosArguments) -> Plan:
    """Return the nodes of a program, with what its command line gives them.

    What is for `skin` is for each of its nodes; what is for one of these comes after it.
    """
    alone = executable != COMPOSED
    names = {executable} if alone else {*PARTS, COMPOSED}
    names |= {args.name_of(kind, alone or kind == COMPOSED) for kind in names}
    if strangers := args.addressed() - names:
        name = min(strangers)
        raise LaunchError(f"--ros-args: {name}: no such node{did_you_mean(name, names)}")
    name = args.name_of(executable)
    of_all = None, executable, name
    program = NodeAction(
        executable,
        name,
        args.namespace_of(executable, name).strip("/"),
        args.parameters_of(*of_all),
        args.remappings_of(*of_all),
        Path(executable),
    )
    parts = [program] if alone else _parts_of(program)
    for part in parts if not alone else ():
        part.name = name = args.name_of(part.executable, alone=False)
        part.namespace = args.namespace_of(part.executable, name, *of_all[1:]).strip("/")
        part.parameters += args.parameters_of(part.executable, name)
        part.remappings = args.remappings_of(part.executable, name) + program.remappings
    for file in program.files():
        if file.nodes:
            raise LaunchError(
                f"{file.path}: nodes: {file.nodes[0]['node']}: is for tactile-skin launch; on ROS "
                "start it as a node of its own"
            )
    nodes = [node for part in parts for node in with_skins(part)]
    if executable == BODY and program.values().get("separate") is True:
        nodes = nodes[-1:]  # the launch file starts those of the skins
    return Plan(nodes)


def _parts_of(program: NodeAction) -> list[NodeAction]:
    """Return the nodes that the program `skin` is to run, each with the parameters that it has."""
    given = shared_out(program, PARTS, PARTS)
    names = replace(program, name=COMPOSED).full_name, program.full_name
    return [
        replace(program, executable=kind, name=kind, parameters=given[kind], programs=names)
        for kind, runs in which_run(program.values()).items()
        if runs
    ]


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], sys.argv[2:]) if sys.argv[1:] else "which node?")
