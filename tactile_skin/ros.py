"""The same nodes on real ROS: each in a process of its own, on rclpy (ROS 2) or rospy (ROS 1).

ROS carries the messages from process to process; within its process a node has what it has on the
bus: one thread for its callbacks, bounded queues, checked parameters, isolated exceptions. So what
differs between the two ROS is one small class each, which knows topics and services only.

    serial_driver --ros-args -r __node:=left --params-file skin.yaml -p port:=/dev/ttyUSB0

Both understand ROS 2's command line.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import logging
import signal
import subprocess
import sys
import threading
from pathlib import Path

import yaml

from . import launch
from .errors import RosError
from .files import one_line, shorten
from .middleware import bus
from .middleware.config import ParameterFile
from .middleware.launch_file import FOXGLOVE, NODES, PACKAGE, RECORDER, NodeAction, Plan
from .middleware.processes import end_commands, start_command
from .middleware.ros.node import MODULES, RosNode, ToRos, choose
from .middleware.threads import one_thread
from .nodes import diagnostics
from .yaml_files import parse_yaml

_logger = logging.getLogger("tactile_skin")


@dataclasses.dataclass
class RosArguments:
    """What stands between --ros-args and --; None: as the executable is called."""

    name: str | None = None
    namespace: str = ""
    parameters: list[ParameterFile | bus.Parameter] = dataclasses.field(default_factory=list)
    remappings: list[str] = dataclasses.field(default_factory=list)

    def overrides(self, full_name: str) -> list[bus.Parameter]:
        """For the node of this name; what comes later wins."""
        found = {}
        for item in self.parameters:
            for p in item.overrides(full_name) if isinstance(item, ParameterFile) else [item]:
                found[p.name] = p
        return list(found.values())


def split_arguments(words: list[str]) -> tuple[list[str], RosArguments]:
    """A command line -> (what is the program's own, what is ROS's).

    Raises:
        ValueError: a ROS argument that is not understood, by name.
    """
    own, args, rest = [], RosArguments(), list(words)
    while rest:
        word = rest.pop(0)
        if word != "--ros-args":
            own.append(word)
            continue
        while rest and (word := rest.pop(0)) != "--":
            if word == "--ros-args":
                continue
            if word not in ("-r", "--remap", "-p", "--param", "--params-file"):
                raise ValueError(
                    f"--ros-args: {word!r}: must be -r from:=to, -p name:=value or --params-file"
                )
            value = rest.pop(0) if rest else ""
            if word == "--params-file":
                args.parameters.append(ParameterFile(value))
                continue
            name, assigned, to = value.partition(":=")
            if not assigned or not name or ":" in name:
                raise ValueError(f"--ros-args: {word} {value!r}: must be name:=value")
            if word in ("-p", "--param"):
                value_of = parse_yaml(to, f"--ros-args: {word} {shorten(value)}")
                args.parameters.append(bus.Parameter(name, value_of))
            elif name in ("__node", "__name"):
                args.name = to
            elif name == "__ns":
                args.namespace = to
            else:
                args.remappings += ["-r", value]
    return own, args


def run(executable: str, words: list[str] | None = None) -> int:
    """One node until SIGTERM or SIGINT: what `ros2 run tactile_skin NODE` starts.

    Returns:
        the exit status: 0, 1 for a run that failed or a ROS that did, 2 for a mistake.
    """
    try:
        own, args = split_arguments(sys.argv[1:] if words is None else words)
        parser = argparse.ArgumentParser(prog=executable, description=_about(executable))
        parser.add_argument(
            "--ros", type=int, choices=(1, 2), help="1: rospy, 2: rclpy (default: what is there)"
        )
        version = choose(parser.parse_args(own).ros)
        with one_thread():
            sys.setswitchinterval(0.0005)  # the default, 5 ms, is longer than a frame's whole way
            return _run(executable, version, args)
    except KeyboardInterrupt:
        return 130
    except (ValueError, OSError, ModuleNotFoundError) as error:
        print(f"{executable}: error: {one_line(error)}", file=sys.stderr)
        return 2


def _about(executable: str) -> str:
    """The first line of the node's module."""
    return sys.modules[launch.node_class(executable).__module__].__doc__.splitlines()[0]


def _run(executable: str, version: int, args: RosArguments) -> int:
    name = args.name or executable
    ros = MODULES[version][1](name, "/" + args.namespace.strip("/"))
    _logger.setLevel(logging.INFO)
    _logger.propagate = False
    _logger.addHandler(ToRos(ros))
    asked = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: asked.set())
    executor, part = bus.MultiThreadedExecutor(), None
    try:
        node = RosNode(
            ros,
            name,
            namespace=args.namespace,
            cli_args=args.remappings,
            parameter_overrides=args.overrides(f"{args.namespace}/{name}"),
        )
        part = launch.node_class(executable)(node)
        _check_overrides(args, node)
        diagnostics.ensure_reported(node)
        executor.add_node(node)
        ros.start()
        while not asked.wait(0.1) and node.context.ok() and ros.ok():
            pass
        lost = ros.failed  # not what it may raise while it is closed
        node.context.try_shutdown()
    finally:
        if hasattr(part, "close"):
            try:
                part.close()
            except Exception:  # a closed stdout, or a ROS that is gone
                _logger.exception("close() raised")
        executor.shutdown()
        _logger.handlers.clear()
        ros.close()
    return 1 if lost or getattr(part, "failed", False) else 0


def _check_overrides(args: RosArguments, node: RosNode) -> None:
    """Refuse misspelt names; what a file says to every node (/**) may be meant for another."""
    own = {"/" + node.get_fully_qualified_name().strip("/"), node.get_name()}
    wanted = set()
    for item in args.parameters:
        if isinstance(item, ParameterFile):
            wanted |= {key for name in own for key in item.sections.get(name, {})}
        else:
            wanted.add(item.name)
    for key in sorted(wanted & set(node.undeclared())):
        raise bus.ParameterError(
            f"parameter {key!r} of node {node.get_name()} is unknown; "
            f"there are: {', '.join(node.parameter_names())}"
        )


def __getattr__(name: str):
    """An entry point for each node of NODES, under its name."""
    if name in NODES:
        return functools.partial(run, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def command(action: NodeAction, version: int) -> list[str]:
    """The command line that starts a node of a launch file, as `ros2 launch` would."""
    words = [
        sys.executable,
        "-m",
        f"{PACKAGE}.ros",
        action.executable,
        "--ros",
        str(version),
    ]
    words += ["--ros-args", "-r", f"__node:={action.name}"]
    words += ["-r", f"__ns:={action.namespace}"] if action.namespace else []
    for item in action.parameters:
        if isinstance(item, ParameterFile):
            words += ["--params-file", str(Path(item.path).resolve())]
        else:
            words += ["-p", f"{item[0]}:={_as_yaml(item[1])}"]
    for source, target in action.remappings:
        words += ["-r", f"{source}:={target}"]
    return words


def _as_yaml(value) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, width=sys.maxsize)
    return text.removesuffix("...\n").strip()


def launch_processes(plan: Plan, version: int) -> int:
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
    launch.Skin(Plan(nodes=plan.nodes)).build()
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
            nodes[name] = start_command(command(action, version))
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
