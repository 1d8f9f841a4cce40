"""The same nodes on real ROS: each in a process of its own, on rclpy (ROS 2) or rospy (ROS 1).

ROS carries the messages from process to process; within its process a node has what it has on the
bus: one thread for its callbacks, bounded queues, checked parameters, isolated exceptions. So what
differs between the two ROS is one small class each, which knows topics and services only.

    serial_driver --ros-args -r __node:=left --params-file skin.yaml -p port:=/dev/ttyUSB0

Both understand ROS 2's command line.
"""

from __future__ import annotations

import argparse
import array
import concurrent.futures
import dataclasses
import functools
import importlib
import importlib.util
import logging
import os
import signal
import subprocess
import sys
import threading
import time
import typing
from collections.abc import Callable
from pathlib import Path

import yaml

from . import bus, launch, msg
from .config import ParameterFile
from .files import one_line, parse_yaml, shorten
from .nodes import QUEUE
from .threads import one_thread

_SERVICE_WITHIN = 5.0  # s, for a node's answer
_LAST_WORD = 0.5  # s, for messages under way when a process ends
_logger = logging.getLogger("tactile_skin")


class RosError(ValueError):
    """ROS, or a part of it, is not there; the message says what to install."""


# --- messages -----------------------------------------------------------------------------------


@functools.cache
def ros_class(kind: type) -> type:
    """ROS's own class of a message or service of msg.py.

    Raises:
        RosError: the package with its definition is not installed.
    """
    package, folder, name = kind.TYPE.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except ImportError as error:
        raise RosError(f"{kind.TYPE}: the ROS package {package} is not installed") from error


def to_ros(message, made=None):
    """A message of msg.py -> ROS's own, field by field; `made`: the object to fill, if it is made.

    Fields have the same names in ROS 1 and ROS 2. Where their Python types differ, the fresh
    object's own value shows which is wanted.
    """
    made = ros_class(type(message))() if made is None else made
    for field in dataclasses.fields(message):
        value, like = getattr(message, field.name), getattr(made, field.name)
        setattr(made, field.name, _encoded(value, like))
    return made


def _encoded(value, like):
    if isinstance(value, msg.Time) and hasattr(like, "nsecs"):  # ROS 1's genpy.Time
        return type(like)(value.sec, value.nanosec)
    if dataclasses.is_dataclass(value):
        return to_ros(value)
    if isinstance(like, array.array):  # ROS 2's uint8[]
        return array.array(like.typecode, value)
    if isinstance(like, bytes) and isinstance(value, int):  # ROS 2's byte
        return bytes([value])
    if isinstance(value, list):
        return [to_ros(item) if dataclasses.is_dataclass(item) else item for item in value]
    return value


def from_ros(kind: type, message):
    """A message of ROS -> the one of msg.py that is its like."""
    return kind(*(_decoded(hint, getattr(message, name)) for name, hint in _fields(kind)))


@functools.cache
def _fields(kind: type) -> list[tuple[str, type]]:
    hints = typing.get_type_hints(kind)
    return [(field.name, hints[field.name]) for field in dataclasses.fields(kind)]


def _decoded(hint, value):
    if hint is msg.Time and hasattr(value, "nsecs"):
        return msg.Time(value.secs, value.nsecs)
    if dataclasses.is_dataclass(hint):
        return from_ros(hint, value)
    if typing.get_origin(hint) is list:
        (inner,) = typing.get_args(hint)
        return [_decoded(inner, item) for item in value]
    if hint is int and isinstance(value, bytes):
        return value[0]
    return bytes(value) if hint is bytes else value


# --- ROS 2 --------------------------------------------------------------------------------------


class Ros2:
    """Topics and services of one node by rclpy."""

    def __init__(self, name: str, namespace: str):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        # signals are main's: the stop has a last word to say
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(name, namespace=namespace)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._publishers = []
        self.failed = False  # rclpy itself has raised: nothing arrives any more
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def ok(self) -> bool:
        return self._thread.is_alive()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except Exception:
            self.failed = True
            _logger.exception("rclpy's executor has ended")

    def advertise(self, kind: type, topic: str, qos: bus.QoSProfile) -> tuple[Callable, Callable]:
        """What sends a message, and what counts the subscribers."""
        publisher = self._node.create_publisher(kind, topic, self._qos(qos))
        self._publishers.append(publisher)
        return publisher.publish, publisher.get_subscription_count

    def subscribe(self, kind: type, topic: str, callback, qos: bus.QoSProfile) -> None:
        self._node.create_subscription(kind, topic, _isolated(topic, callback), self._qos(qos))

    def serve(self, kind: type, name: str, answer) -> None:
        self._node.create_service(kind, name, answer)

    @staticmethod
    def _qos(qos: bus.QoSProfile):
        from rclpy.qos import DurabilityPolicy, QoSProfile

        return QoSProfile(depth=qos.depth, durability=DurabilityPolicy[qos.durability.name])

    def declare(self, name: str, value, descriptor: bus.ParameterDescriptor) -> None:
        """Show a parameter to `ros2 param`; nodes read theirs once, so that none can be set."""
        from rcl_interfaces import msg as rcl

        described = rcl.ParameterDescriptor(description=descriptor.description, read_only=True)
        for bounds in descriptor.floating_point_range:
            described.floating_point_range.append(
                rcl.FloatingPointRange(from_value=bounds.from_value, to_value=bounds.to_value)
            )
        for bounds in descriptor.integer_range:
            described.integer_range.append(
                rcl.IntegerRange(from_value=bounds.from_value, to_value=bounds.to_value)
            )
        self._node.declare_parameter(name, value, described, ignore_override=True)

    def log(self, level: int, text: str) -> None:
        logger = self._node.get_logger()
        if level >= logging.ERROR:  # a line for each: rclpy wants one severity per line
            logger.error(text)
        elif level >= logging.WARNING:
            logger.warning(text)
        elif level >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)

    def close(self) -> None:
        """Leave ROS once the last messages have arrived, or nobody takes them."""
        import rclpy
        from rclpy.duration import Duration

        end = time.monotonic() + _LAST_WORD
        for publisher in self._publishers:
            left = max(0.001, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))
        self._executor.shutdown(timeout_sec=1.0)
        rclpy.try_shutdown()


# --- ROS 1 --------------------------------------------------------------------------------------


def _isolated(topic: str, callback: Callable) -> Callable:
    """A subscriber's callback whose exceptions are logged: one would end rclpy's executor."""

    def call(message) -> None:
        try:
            callback(message)
        except Exception:
            _logger.exception("a message on %s was not taken", topic)

    return call


class Ros1:
    """Topics and services of one node by rospy; waits for a master.

    rospy registers once: a master that was restarted would know nobody. So each node looks once a
    second whether the master knows it, and registers anew what it does not.
    """

    def __init__(self, name: str, namespace: str):
        os.environ["ROS_NAMESPACE"] = namespace  # rospy reads it when it is imported
        import rospy

        self.failed = False  # rospy isolates what its threads call
        rospy.init_node(name, argv=[], disable_signals=True)
        self._rospy, self._closed = rospy, threading.Event()
        # a shutdown that the master asks for lets the node say its last word first
        rospy.on_shutdown(lambda: self._closed.wait(2 * _LAST_WORD))

    def start(self) -> None:
        threading.Thread(target=self._stay_registered, name="rospy", daemon=True).start()

    def ok(self) -> bool:
        """False once another node has taken this one's name."""
        return not self._rospy.core.is_shutdown_requested()

    def advertise(self, kind: type, topic: str, qos: bus.QoSProfile) -> tuple[Callable, Callable]:
        """What sends a message, and what counts the subscribers."""
        latch = qos.durability is bus.DurabilityPolicy.TRANSIENT_LOCAL
        # A queue, and so a thread, for each subscriber: a slow one delays nobody. Latched topics
        # have a depth of 1, which is what is kept, not how many may be on their way. And no Nagle:
        # he would hold a message back until the last one is acknowledged, up to 40 ms.
        size = max(qos.depth, QUEUE)
        publisher = self._rospy.Publisher(
            topic, kind, queue_size=size, latch=latch, tcp_nodelay=True
        )
        return publisher.publish, publisher.get_num_connections

    def subscribe(self, kind: type, topic: str, callback, qos: bus.QoSProfile) -> None:
        self._rospy.Subscriber(topic, kind, callback, queue_size=qos.depth, tcp_nodelay=True)

    def serve(self, kind: type, name: str, answer) -> None:
        self._rospy.Service(name, kind, lambda request: answer(request, kind._response_class()))

    def declare(self, name: str, value, descriptor: bus.ParameterDescriptor) -> None:
        """ROS 1's parameters are values on a server, which a node does not declare."""

    def log(self, level: int, text: str) -> None:
        if level >= logging.ERROR:
            self._rospy.logerr(text)
        elif level >= logging.WARNING:
            self._rospy.logwarn(text)
        elif level >= logging.INFO:
            self._rospy.loginfo(text)
        else:
            self._rospy.logdebug(text)

    def close(self) -> None:
        time.sleep(_LAST_WORD / 2)  # for the subscribers' queues; rospy cannot be asked
        self._closed.set()
        self._rospy.signal_shutdown("the node ends")

    def _stay_registered(self) -> None:
        import rosgraph

        name, master = self._rospy.get_name(), rosgraph.Master(self._rospy.get_name())
        lost = False
        while self.ok():
            time.sleep(1.0)
            try:
                missing = self._missing(name, master.getSystemState())
                if missing and self._taken(name, master):
                    # to register anew would end the other one too
                    self._rospy.signal_shutdown("another node has taken this one's name")
                    return
                if missing and not lost:
                    self.log(logging.WARNING, "the master has forgotten this node: it registers")
                self._register(missing)
                lost = bool(missing)
            except (OSError, rosgraph.MasterException):  # no master: what is connected stays so
                if not lost:
                    self.log(logging.WARNING, "the master does not answer")
                lost = True

    def _taken(self, name: str, master) -> bool:
        """Whether the master knows another node by this one's name."""
        import rosgraph

        try:
            other = master.lookupNode(name) != self._rospy.get_node_uri()
        except rosgraph.MasterError:  # it knows none
            other = False
        return other or not self.ok()  # one that is ending is forgotten as well

    @staticmethod
    def _missing(name: str, state) -> list[tuple[str, str, str]]:
        """(name, type or URI, kind of registration) of what the master does not know of us."""
        from rospy.impl import registration

        topics, services = registration.get_topic_manager(), registration.get_service_manager()
        kinds = registration.Registration
        missing = []
        for mine, known, kind in zip(
            (topics.get_publications(), topics.get_subscriptions(), services.get_services()),
            state,
            (kinds.PUB, kinds.SUB, kinds.SRV),
            strict=True,
        ):
            there = {topic for topic, nodes in known if name in nodes}
            missing += [(topic, detail, kind) for topic, detail in mine if topic not in there]
        return missing

    @staticmethod
    def _register(missing: list[tuple[str, str, str]]) -> None:
        from rospy.impl import registration

        for entry in missing:
            registration.get_registration_listeners().notify_added(*entry)


_MODULES = {2: ("rclpy", Ros2), 1: ("rospy", Ros1)}


def installed() -> int | None:
    """Which ROS this Python has: 2, 1, or None; with both, 2."""
    return next((v for v, (name, _) in _MODULES.items() if importlib.util.find_spec(name)), None)


def choose(version: int | None) -> int:
    """The wanted ROS, or the one that is there.

    Raises:
        RosError: it is not installed.
    """
    found = version or installed()
    if found is None:
        raise RosError("neither rclpy (ROS 2) nor rospy (ROS 1) is installed: see README.md")
    if not importlib.util.find_spec(_MODULES[found][0]):
        raise RosError(f"ROS {found}: {_MODULES[found][0]} is not installed: see README.md")
    return found


# --- the node -----------------------------------------------------------------------------------


class _WallClock:
    """The time of day, which processes and machines share. Timers run on the bus's own clock,
    which does not jump when the time of day is set."""

    def now(self) -> bus.Time:
        return bus.Time(time.time_ns())


class _Publisher:
    def __init__(self, msg_type: type, topic: str, send: Callable, count: Callable):
        self.msg_type, self.topic_name, self._send = msg_type, topic, send
        self.get_subscription_count = count

    def publish(self, message) -> None:
        if type(message) is not self.msg_type:
            raise TypeError(
                f"topic {self.topic_name} carries {self.msg_type.TYPE}, not {message!r}"
            )
        self._send(to_ros(message))


class RosNode(bus.Node):
    """A node of the bus whose topics and services are ROS's."""

    def __init__(self, ros: Ros1 | Ros2, node_name: str, **kwargs):
        super().__init__(node_name, context=bus.Context(), **kwargs)
        self._ros, self._wall_clock = ros, _WallClock()

    def get_clock(self):
        return self._wall_clock

    def create_publisher(self, msg_type, topic: str, qos_profile: bus.QoSProfile | int):
        name, qos = self.resolve_topic_name(topic), bus.as_qos(qos_profile)
        return _Publisher(msg_type, name, *self._ros.advertise(ros_class(msg_type), name, qos))

    def create_subscription(self, msg_type, topic: str, callback, qos_profile):
        subscription = super().create_subscription(msg_type, topic, callback, qos_profile)

        def arrived(message) -> None:  # in ROS's thread: queue it, nothing else
            subscription.put(from_ros(msg_type, message))

        self._ros.subscribe(
            ros_class(msg_type), subscription.topic_name, arrived, subscription.qos_profile
        )
        return subscription

    def create_service(self, srv_type, srv_name: str, callback):
        service = super().create_service(srv_type, srv_name, callback)
        client = super().create_client(srv_type, srv_name)

        def answer(request, response):  # in ROS's thread: the node's own does the work
            try:
                found = _ask(client, from_ros(srv_type.Request, request))
            except Exception as error:  # raised here it would end rclpy's executor
                self.get_logger().error("service %s: %r", service.srv_name, error)
                found = srv_type.Response(success=False, message=str(error) or repr(error))
            return to_ros(found, response)

        self._ros.serve(ros_class(srv_type), service.srv_name, answer)
        return service

    def create_client(self, srv_type, srv_name: str):
        raise NotImplementedError(f"{srv_name}: on ROS no node of the skin calls services")

    def declare_parameter(self, name: str, value, descriptor=None) -> bus.Parameter:
        parameter = super().declare_parameter(name, value, descriptor)
        self._ros.declare(name, parameter.value, descriptor or bus.ParameterDescriptor())
        return parameter


def _ask(client: bus.Client, request):
    """The response, or the exception that the node raised.

    Raises:
        RuntimeError: it does not answer in time; what it has not begun does not happen later.
    """
    future = client.call_async(request)
    try:
        return future.result(_SERVICE_WITHIN)
    except concurrent.futures.TimeoutError:
        if future.done():  # the node's own
            raise
        begun = "" if future.cancel() else ", but is at work on it"
        raise RuntimeError(f"the node did not answer within {_SERVICE_WITHIN:g} s{begun}") from None


class _ToRos(logging.Handler):
    """What is logged goes to ROS: its console and /rosout."""

    def __init__(self, ros: Ros1 | Ros2):
        super().__init__()
        self._ros = ros

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._ros.log(record.levelno, self.format(record))
        except Exception:  # a ROS that is gone
            self.handleError(record)


# --- the process --------------------------------------------------------------------------------


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
    ros = _MODULES[version][1](name, "/" + args.namespace.strip("/"))
    _logger.setLevel(logging.INFO)
    _logger.propagate = False
    _logger.addHandler(_ToRos(ros))
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
    """An entry point for each node of launch.NODES, under its name."""
    if name in launch.NODES:
        return functools.partial(run, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


# --- a launch file, a process per node ----------------------------------------------------------


def command(action: launch.NodeAction, version: int) -> list[str]:
    """The command line that starts a node of a launch file, as `ros2 launch` would."""
    words = [
        sys.executable,
        "-m",
        f"{launch.PACKAGE}.ros",
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


def launch_processes(plan: launch.Plan, version: int) -> int:
    """Start a launch file's commands and nodes as processes; end when a node ends by itself.

    A node that is killed ends nothing: the stop says so, as the robot's own launch would.

    Raises:
        ValueError: a mistake in the files; found before anything is started.
    """
    launch.Skin(launch.Plan(nodes=plan.nodes)).build()
    asked = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: asked.set())
    commands: list[subprocess.Popen] = []
    nodes: dict[str, subprocess.Popen] = {}
    status = 0
    try:
        for words in plan.commands:
            commands.append(launch.start_command(words))
        for action in plan.nodes:
            name = f"{action.namespace}/{action.name}".strip("/")
            nodes[name] = launch.start_command(command(action, version))
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
        launch.end_commands(list(nodes.values()))
        launch.end_commands(commands)  # the board last
    return status


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], sys.argv[2:]) if sys.argv[1:] else "which node?")
