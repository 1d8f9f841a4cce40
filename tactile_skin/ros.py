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
import json
import logging
import sys
from pathlib import Path

from . import launch
from .errors import LaunchError, ParameterError, did_you_mean
from .files import one_line
from .middleware.bus import Node
from .middleware.package import BODY, COMPOSED, PACKAGE, SKIN_NODES, node_class
from .middleware.parameter_file import CONFIG, ParameterFile, unknown_of, values_for
from .middleware.plan import NodeAction, Plan, given, with_skins
from .middleware.processes import end_with_launcher
from .middleware.ros.arguments import PARAMS_FILE, RosArguments, split_arguments
from .middleware.ros.node import RosNode, ToRos
from .middleware.ros.process import Process
from .nodes import diagnostics, frames
from .parameters.nodes import all_names

_logger = logging.getLogger("tactile_skin")
# The nodes of `skin`, in the way of the data, and whether they run unless a parameter says so.
PARTS = {
    "serial_driver": True,
    "compensation": True,
    "gesture_feature": True,
    "stop_on_push": True,
    "gestures": False,
    "cmd_vel_gate": False,
    "push_to_move": False,
    "monitor": False,
}


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

    def _make_node(self, action: NodeAction) -> RosNode:
        node = RosNode(self._process, action.name, context=self._context, **given(action))
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
    """Run a program of `ros2 run tactile_skin` until SIGTERM or SIGINT: a node, or `skin`.

    Returns:
        the exit status: 0, 1 for a run that failed or a ROS that did, 2 for a mistake.
    """
    try:
        own, args = split_arguments(sys.argv[1:] if words is None else words)
        parser = argparse.ArgumentParser(prog=executable, description=_about(executable))
        parser.parse_args(own)
        skin = RosSkin(plan_of(executable, args), Process(args.others))
        # a signal that came before it ran has asked for the same
        with contextlib.suppress(KeyboardInterrupt, SystemExit), skin:
            end_with_launcher(skin.shutdown)
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

    `skin` also takes what is for any of its parts, whether or not they run; what is for `skin` is
    for each of them.

    Raises:
        ParameterError: a part of `skin` that is neither true nor false.
        LaunchError: an argument for a node that the program does not have.
    """
    alone = executable != COMPOSED
    plan = Plan()
    together: tuple[str, ...] = ()  # names of all of them
    if not alone:
        plan.for_all = frozenset(PARTS).union(*map(all_names, PARTS))
        together = (COMPOSED, args.name_of(COMPOSED))
        space = args.namespace_of(*together).strip("/")
        for file in args.files():
            file.programs = tuple("/" + f"{space}/{name}".strip("/") for name in set(together))
    names = {executable} if alone else {*PARTS, *together}
    names |= {args.name_of(kind, alone) for kind in names}
    if strangers := args.addressed() - names:
        name = min(strangers)
        raise LaunchError(f"--ros-args: {name}: no such node{did_you_mean(name, names)}")
    for kind in (executable,) if alone else _parts(args, together):
        name = args.name_of(kind, alone)
        namespace = args.namespace_of(kind, *together).strip("/")
        given = args.parameters_of(kind, name, *together)
        rules = args.remappings_of(kind, name, *together)
        action = NodeAction(kind, name, namespace, given, rules, Path(executable))
        nodes = with_skins(action)
        if kind == BODY:
            plan.for_all = frozenset().union(*map(all_names, (*SKIN_NODES, BODY)))
            if action.values().get("separate") is True:
                plan.skins, nodes = _programs(nodes[:-1]), [action]
        plan.nodes += nodes
    return plan


def _programs(nodes: list[NodeAction]) -> list[list[str]]:
    """Return the command of the program `skin` for each namespace of a body's nodes."""
    programs: dict[str, list[str]] = {}
    for node in nodes:
        files = [p for p in node.parameters if isinstance(p, ParameterFile) and not p.by_launch]
        if node.namespace not in programs:
            words = [sys.executable, "-m", f"{PACKAGE}.ros", COMPOSED, "--ros-args"]
            words += ["-r", f"__ns:=/{node.namespace}"]
            for file in files:
                path = str(file.path)
                words += ["-p", f"{CONFIG}:={path}"] if file.own else [PARAMS_FILE, path]
            programs[node.namespace] = words
        others = [p for p in node.parameters if p not in files]
        for p in values_for(node.full_name, others):
            if not unknown_of([p.name], all_names(node.kind)):
                value = json.dumps(p.value)
                programs[node.namespace] += ["-p", f"{node.name}:{p.name}:={value}"]
    return list(programs.values())


def _parts(args: RosArguments, names: tuple[str, ...]) -> list[str]:
    """Return the nodes that `skin`, by one of these names, runs."""
    wanted = dict(PARTS)
    full = f"{args.namespace_of(*names)}/{names[-1]}"
    for p in values_for(full, args.parameters_of(*names)):
        if p.name in PARTS:
            if not isinstance(p.value, bool):
                raise ParameterError(
                    f"parameter {p.name} of {COMPOSED} = {p.value!r}: must be true or false"
                )
            wanted[p.name] = p.value
    return [name for name, runs in wanted.items() if runs]


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], sys.argv[2:]) if sys.argv[1:] else "which node?")
