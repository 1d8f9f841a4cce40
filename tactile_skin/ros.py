"""The same nodes on ROS 2, by rclpy: one a process, or all in one.

ROS carries the messages from process to process; within a process a node has what it has on the
bus: one thread for its callbacks, bounded queues, checked parameters, isolated exceptions.

    serial_driver --ros-args -r __node:=left --params-file skin.yaml -p port:=/dev/ttyUSB0
    skin --ros-args --params-file skin.yaml -p serial_driver:port:=/dev/ttyUSB0 -p monitor:=true
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import logging
import signal
import subprocess
import sys
import threading
from collections.abc import Collection
from pathlib import Path

import yaml

from . import launch
from .errors import LaunchError, ParameterError, RosError
from .files import one_line
from .middleware.bus import Context, Node
from .middleware.launch_file import NodeAction, Plan
from .middleware.launched import check_commands, check_names, close, given
from .middleware.package import COMPOSED, FOXGLOVE, NODES, PACKAGE, RECORDER
from .middleware.parameter_file import CONFIG, ParameterFile
from .middleware.processes import end_commands, start_command
from .middleware.ros.arguments import RosArguments, split_arguments
from .middleware.ros.node import RosNode, ToRos
from .middleware.ros.ros2 import Ros2
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


class Program(launch.Skin):
    """The nodes of a ROS program, with what its command line gives them."""

    def __init__(self, executable: str, plan: Plan, context: Context | None = None):
        super().__init__(plan, context)
        self._whole = executable == COMPOSED

    def close_nodes(self) -> None:
        """Of a program that was only built."""
        for node in self._nodes:
            close(node)

    def _check_names(self, action: NodeAction, full_name: str, own: Collection[str]) -> None:
        """Refuse what no node knows; a launch file also gives `skin` what is for any of its parts,
        whether or not they run."""
        process = set(PARTS).union(*map(all_names, PARTS)) if self._whole else None
        check_names(action, full_name, own, process)


class RosSkin(Program):
    """Nodes of this process that are on ROS as well, until a signal or ROS ends them."""

    def __init__(self, executable: str, plan: Plan, ros: Ros2):
        super().__init__(executable, plan)
        self._ros = ros
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
                handle.connect(diagnostics.TOPIC, *frames.TOPICS)
        self._ros.start(self.shutdown)
        return self._handles

    def _make_node(self, action: NodeAction) -> RosNode:
        node = RosNode(self._ros, action.name, context=self._context, **given(action))
        self._to_ros.nodes[action.name] = node.ros
        return node

    def _leave(self) -> None:
        self._lost = self._ros.failed  # not what it may raise while it is closed
        self._ros.close()

    @property
    def failed(self) -> bool:
        return self._lost or super().failed


def run(executable: str, words: list[str] | None = None) -> int:
    """A program of `ros2 run tactile_skin` until SIGTERM or SIGINT: a node, or `skin`.

    Returns:
        the exit status: 0, 1 for a run that failed or a ROS that did, 2 for a mistake.
    """
    try:
        own, args = split_arguments(sys.argv[1:] if words is None else words)
        parser = argparse.ArgumentParser(prog=executable, description=_about(executable))
        parser.parse_args(own)
        plan = plan_of(executable, args)
        namespace = "/" + args.namespace_of(executable).strip("/")
        skin = RosSkin(executable, plan, Ros2(args.name_of(executable), namespace, args.logs))
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
    """The first line of the node's module."""
    if executable == COMPOSED:
        return f"All nodes of a skin in one process: {', '.join(PARTS)}."
    return (sys.modules[launch.node_class(executable).__module__].__doc__ or "").splitlines()[0]


def plan_of(executable: str, args: RosArguments) -> Plan:
    """The nodes of a program, with what its command line gives them.

    Raises:
        ParameterError: a part of `skin` that is neither true nor false.
    """
    alone = executable != COMPOSED
    plan = Plan()
    for kind in (executable,) if alone else _parts(args):
        name = args.name_of(kind, alone)
        parameters = [
            item if isinstance(item, ParameterFile) else (item.name, item.value)
            for item in args.parameters_of(kind, name)
        ]
        rules = [
            (source, to)
            for source, _, to in (r.partition(":=") for r in args.remappings_of(kind, name))
        ]
        namespace = args.namespace_of(kind).strip("/")
        plan.nodes.append(NodeAction(kind, name, namespace, parameters, rules, Path(executable)))
    return plan


def _parts(args: RosArguments) -> list[str]:
    """The nodes that `skin` runs."""
    full_name = f"{args.namespace_of(COMPOSED)}/{args.name_of(COMPOSED)}"
    wanted = dict(PARTS)
    for p in args.overrides(full_name):
        if p.name in PARTS:
            if not isinstance(p.value, bool):
                raise ParameterError(
                    f"parameter {p.name} of {COMPOSED} = {p.value!r}: must be true or false"
                )
            wanted[p.name] = p.value
    return [name for name, runs in wanted.items() if runs]


def __getattr__(name: str):
    """An entry point for each node of NODES, under its name, and for all of them together."""
    if name in NODES or name == COMPOSED:
        return functools.partial(run, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def command(action: NodeAction) -> list[str]:
    """The command line that starts a program of a launch file, as `ros2 launch` would."""
    return [sys.executable, "-m", f"{PACKAGE}.ros", action.executable, *_words(action)]


def _words(action: NodeAction) -> list[str]:
    """What a launch file gives a program, as ROS's arguments."""
    words = ["--ros-args"]
    words += ["-r", f"__node:={action.name}"] if action.name != action.executable else []
    words += ["-r", f"__ns:={action.namespace}"] if action.namespace else []
    for item in action.parameters:
        if isinstance(item, ParameterFile):
            path = str(Path(item.path).resolve())
            words += ["-p", f"{CONFIG}:={_as_yaml(path)}"] if item.own else ["--params-file", path]
        elif item[1] is not None:
            words += ["-p", f"{item[0]}:={_as_yaml(item[1])}"]
    for source, target in action.remappings:
        words += ["-r", f"{source}:={target}"]
    return words


def _check(actions: list[NodeAction]) -> None:
    """Build the programs' nodes in this process, to find mistakes before one is started."""
    context, handles = Context(), []
    with contextlib.ExitStack() as made:
        for action in actions:
            _, args = split_arguments(_words(action))
            nodes = [
                dataclasses.replace(node, file=action.file)
                for node in plan_of(action.executable, args).nodes
            ]
            program = Program(action.executable, Plan(nodes=nodes), context)
            made.callback(program.close_nodes)
            handles += program.build()
        names = [handle.get_fully_qualified_name() for handle in handles]
        if twice := [name for name in names if names.count(name) > 1]:
            raise LaunchError(f"node {twice[0]}: there are two of this name")
        check_commands(handles)


def _as_yaml(value) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, width=sys.maxsize)
    return text.removesuffix("...\n").strip()


def launch_processes(plan: Plan) -> int:
    """Start a launch file's commands and nodes as processes; end when a node ends by itself.

    A node that is killed ends nothing: the stop says so, as the robot's own launch would.

    Raises:
        ValueError: a mistake in the files; found before anything is started.
    """
    for action in plan.nodes:
        if action.kind == RECORDER:
            raise RosError("record: is without ROS; with it: ros2 bag record -a -s mcap")
        if action.kind == FOXGLOVE:
            raise RosError("foxglove: is without ROS; with it: foxglove_bridge")
        if action.user:
            raise RosError(
                f"{action.file}: node {action.kind}: --ros starts the nodes of {PACKAGE} only; "
                "start this one as a program of its own"
            )
    _check(plan.nodes)
    asked = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: asked.set())
    commands: list[subprocess.Popen] = []
    nodes: dict[str, subprocess.Popen] = {}
    status = 0
    try:
        for words in plan.commands:
            commands.append(start_command(words))
        for action in plan.nodes:
            name = f"{action.namespace}/{action.name}".strip("/")
            nodes[name] = start_command(command(action))
        running = dict(nodes)
        while running and not asked.wait(0.2):
            for name, process in nodes.items():
                if name not in running or process.poll() is None:
                    continue
                del running[name]
                if process.returncode >= 0:
                    status = process.returncode
                    asked.set()
                else:
                    ended = signal.Signals(-process.returncode).name
                    print(f"{name}: ended by {ended}; the others go on", file=sys.stderr)
    finally:
        end_commands(list(nodes.values()))
        end_commands(commands)  # the board last
    return status


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], sys.argv[2:]) if sys.argv[1:] else "which node?")
