# SPDX-License-Identifier: Apache-2.0
"""A process on ROS 2, and its nodes of the bus, whose topics and parameters are those of ROS."""

from __future__ import annotations

import functools
import logging
import math
import threading
import time
from collections.abc import Callable

from ...errors import RosError
from ...fields import About
from ...msg import DiagnosticArray, Twist, TwistStamped
from .. import bus
from ..package import SOURCES
from ..parameter_file import THEIRS
from .messages import from_ros, ros_class, to_ros

try:
    import rcl_interfaces.msg as rcl
    import rclpy.node  # and with it all of rclpy
except ModuleNotFoundError:  # said once it is needed
    rcl = rclpy = None

_SERVICE_WITHIN = 5.0  # s, for a node's answer
_STILL = 0.25  # s without news from /clock: ten messages of `ros2 bag play --clock`
_COMPARE = 2.0  # s, between two looks at what others publish and subscribe to
# Looks in a row, 10 s: discovery takes up to 6 s on a busy computer (benchmarks/ros/kill.py).
_DEAF = 5
_LAST_WORD = 0.5  # s, for messages under way when a process ends
_logger = logging.getLogger("tactile_skin")


class Process:
    """A process on ROS 2.

    Args:
        words: of the command line, for ROS itself.

    Attributes:
        context: rclpy's.
        failed: rclpy itself has raised, or does not show what is there: nothing arrives.

    Raises:
        RosError: ROS does not understand the words, or rclpy is not installed.
    """

    def __init__(self, words: list[str]):
        if rclpy is None:
            raise RosError("rclpy (ROS 2) is not installed: see docs/robot.md")
        args = ["--ros-args", *words] if words else []
        self.context = rclpy.Context()  # of its own: who composes may have the default one
        none = rclpy.signals.SignalHandlerOptions.NO  # launch.Skin's publish a final stop
        try:
            rclpy.init(args=args, context=self.context, signal_handler_options=none)
        except Exception as error:  # of a type that rclpy does not export
            raise RosError(f"--ros-args {' '.join(words)}: {error}") from error
        self.failed = False
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self._simulated = None  # the clock of all nodes, once one hears /clock: once is enough
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)

    def add(self, node):
        """Let messages arrive for a node of rclpy too; its clock."""
        self._executor.add_node(node)
        clock = node.get_clock()
        if clock.ros_time_is_active:
            if self._simulated:  # one hears for all
                node.destroy_subscription(next(node.subscriptions))
            clock = self._simulated = self._simulated or clock
        return clock

    def start(self, ended: Callable) -> None:
        """Let messages arrive; `ended` is called when none does any more."""
        self._ended = ended
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except Exception as error:
            if self.context.ok():  # else somebody has ended it
                self.give_up("rclpy's executor has ended", error)
        self._ended()

    def give_up(self, why: str, error: Exception | None = None) -> None:
        """End, as failed: only another start of this process helps."""
        self.failed = True
        _logger.error(why, exc_info=error)
        self._ended()

    def close(self) -> None:
        """Leave ROS once the last messages have arrived, or nobody takes them."""
        end = time.monotonic() + _LAST_WORD
        nodes = self._executor.get_nodes() if self.context.ok() else []
        for publisher in [p for node in nodes for p in node.publishers]:
            left = max(0.001, end - time.monotonic())
            publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=left))
        # The thread must have left rclpy before Python ends: killed inside C++ code, it would abort
        # the process. Without its context it leaves by itself.
        rclpy.try_shutdown(context=self.context)
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(_LAST_WORD)
        self._executor.shutdown(timeout_sec=_LAST_WORD)


class _RosClock:
    """The time of day, which processes and machines share, or a simulation's.

    Timers run on the bus's own clock, which neither jumps nor stands still.
    """

    def __init__(self, theirs):
        self._theirs, self._last, self._since = theirs, 0, time.monotonic()

    def now(self) -> bus.Time:
        simulated = self._theirs.ros_time_is_active
        return bus.Time(self._theirs.now().nanoseconds if simulated else time.time_ns())

    @property
    def stands_still(self) -> bool:
        """Whether it has shown the same for a while: who waits for it would wait for ever."""
        shown, t = self.now().nanoseconds, time.monotonic()
        if shown != self._last:
            self._last, self._since = shown, t
        return t - self._since > _STILL


class _Publisher(bus.Publisher):
    """Hands messages to the nodes of this process, and to ROS if anybody is there to hear them."""

    def __init__(self, node: RosNode, msg_type: type, topic: str, qos: bus.QoSProfile):
        super().__init__(node, msg_type, topic, qos)
        self._theirs = node.ros.create_publisher(ros_class(msg_type), topic, **_quality(self))

    def publish(self, message) -> None:
        super().publish(message)
        if self._kept.maxlen or self._theirs.get_subscription_count():
            self._theirs.publish(to_ros(message))

    def get_subscription_count(self) -> int:
        return super().get_subscription_count() + self._theirs.get_subscription_count()


class RosNode(bus.Node):
    """A node of the bus whose topics, services and parameters are on ROS as well.

    Nodes of one process share a context: what one of them publishes does not take the way over ROS
    to another. `connect` opens the rest to ROS, once all are there.

    Attributes:
        ros: rclpy's node.
    """

    waits = True
    publisher_class = _Publisher

    def __init__(self, process: Process, node_name: str, **kwargs):
        super().__init__(node_name, **kwargs)
        theirs = [p for p in self._overrides.items() if p[0].startswith(THEIRS)]
        given = [rclpy.parameter.Parameter(name, value=value) for name, value in theirs]
        place = {"context": process.context, "namespace": self.get_namespace()}
        self.ros = rclpy.create_node(node_name, parameter_overrides=given, **place)
        self._clock, self._process = _RosClock(process.add(self.ros)), process
        self._connected, self._shared = False, set[str]()
        self._heard: list = []  # on ROS
        self._warn_once = functools.cache(self.get_logger().warning)
        self._deaf = 0  # looks in a row
        look = functools.partial(self._isolated, self._look_at_graph)
        # which does not stand still with a simulation's
        steady = rclpy.clock.Clock(clock_type=rclpy.clock_type.ClockType.STEADY_TIME)
        self.ros.create_timer(_COMPARE, look, clock=steady)

    def get_clock(self):
        return self._clock

    def _added(self, subscription):
        return self._hear(super()._added(subscription))

    def connect(self, *shared: str) -> None:
        """Take from ROS what no node of this process publishes.

        Args:
            shared: topics on which nodes of this process and others have a word.
        """
        self._connected, self._shared = True, set(map(self.resolve_topic_name, shared))
        for subscription in tuple(self._subscriptions):
            self._hear(subscription)
        # not before: rclpy asks it for what is declared, too
        self.ros.add_on_set_parameters_callback(self._set_from_ros)

    def _hear(self, subscription):
        """Return the subscription, of what arrives on ROS."""
        msg_type, topic = subscription.msg_type, subscription.topic_name
        shared = topic in self._shared
        if not self._connected or (not shared and self.context.count_publishers(topic)):
            return subscription

        def arrived(message) -> None:  # in ROS's thread: queue it, nothing else
            taken = from_ros(msg_type, message)
            if shared and isinstance(taken, DiagnosticArray):  # transforms do not say whose
                ours = self.context.nodes
                if all(f"/{status.name}" in ours for status in taken.status):
                    return  # it has arrived within this process
            subscription.put(taken)

        def fetch() -> None:
            with theirs.handle:
                while taken := theirs.handle.take_message(theirs.msg_type, theirs.raw):
                    taker(taken[0])

        arrived.__qualname__ = f"of a message on {topic}"  # as it is logged
        taker = functools.partial(self._isolated, arrived)
        group = rclpy.callback_groups.MutuallyExclusiveCallbackGroup()
        kind, quality = ros_class(msg_type), _quality(subscription)
        theirs = self.ros.create_subscription(kind, topic, taker, callback_group=group, **quality)
        self._heard.append(subscription)
        if isinstance(subscription, bus.Listener) and subscription.keeps:
            group.beginning_execution(theirs)  # and never ends: no executor takes its messages
            subscription.fetch = fetch
        return subscription

    def _isolated(self, callback: Callable, *arguments) -> None:
        """Call it, and log what it raises, which would end rclpy's executor."""
        try:
            callback(*arguments)
        except Exception as error:
            self._report(callback, error)

    def create_service(self, srv_type, srv_name: str, callback):
        service = super().create_service(srv_type, srv_name, callback)

        def answer(request, response):
            ours = from_ros(srv_type.Request, request), srv_type.Response()
            return to_ros(self._ask(srv_type.Response, callback, *ours), response)

        self.ros.create_service(ros_class(srv_type), service.srv_name, answer)
        return service

    def _ask(self, refusal: Callable, callback, *arguments):
        """Return what the node's own thread answers, or why it does not."""
        try:
            return bus.result_of(self.ask(callback, *arguments), _SERVICE_WITHIN)
        except Exception as error:  # raised here it would end rclpy's executor
            self.get_logger().error("%r: %r", callback, error)
            return refusal(False, str(error) or repr(error))

    def declare_parameter(self, name: str, value, descriptor: About = bus.ANYTHING):
        """As a node of the bus does, and show it to `ros2 param`."""
        parameter = super().declare_parameter(name, value, descriptor)
        described = rcl.ParameterDescriptor(description=descriptor.description)
        described.read_only, described.dynamic_typing = not descriptor.live, descriptor.any_type
        low, high = descriptor.low, descriptor.high
        if low is not None and high is not None:
            number: type = float
            kind, bounds = rcl.FloatingPointRange, described.floating_point_range
            if isinstance(value, int):
                number, kind, bounds = int, rcl.IntegerRange, described.integer_range
            bounds.append(kind(from_value=number(low), to_value=number(high)))
        self.ros.declare_parameter(name, parameter.value, described, ignore_override=True)
        return parameter

    def _set_from_ros(self, parameters):
        """Whether parameters can be set, and why not; the node's own thread does it."""
        ours = [bus.Parameter(p.name, p.value) for p in parameters if p.name in self._parameters]
        done = bus.SetParametersResult(True)
        if ours:
            done = self._ask(bus.SetParametersResult, self.set_parameters_atomically, ours)
        return to_ros(done, rcl.SetParametersResult())

    def _look_at_graph(self) -> None:
        """Warn of others who use a topic of this node for another type, or publish it as well.

        DDS does not connect the former; whoever listens hears the latter in turns. And end the
        process if ROS keeps from it what a node that is there publishes from its start: after a
        kill -9, Fast DDS loses announcements of publishers for ever, about once in a hundred
        restarts: github.com/eProsima/Fast-DDS/issues/5469. Who joins again hears them.
        """
        there, lost = self.ros.get_node_names_and_namespaces(), ""
        for end in (*self._publishers, *self._heard):
            topic, ours = end.topic_name, bus.type_name(end.msg_type)
            publish = self.ros.get_publishers_info_by_topic(topic)
            own = self.context.count_publishers(topic)
            if 0 < own < len(publish) and topic not in self._shared:
                self._warn_once(
                    f"{topic}: another process publishes it as well, or was killed just now: "
                    "whoever listens hears both in turns. Give each skin a namespace of its own"
                )
            for other in (*publish, *self.ros.get_subscriptions_info_by_topic(topic)):
                if other.topic_type not in ("", ours):
                    velocities = {ours, other.topic_type} == {Twist.TYPE, TwistStamped.TYPE}
                    remedy = f": set stamped to {str(ours == Twist.TYPE).lower()}" * velocities
                    self._warn_once(
                        f"{topic}: {other.node_name} has {other.topic_type}, this node {ours}: "
                        f"they do not hear each other{remedy}"
                    )
            space, _, name = topic.rpartition("/skin/")  # this node's, or of a skin of its body
            source = SOURCES.get(f"skin/{name}")
            if not publish and (source, space or "/") in there:
                lost = f"{source} is there, and ROS does not show that it publishes {topic}: "
                lost += "this process ends, since only another start finds it"
        self._deaf = self._deaf + 1 if lost else 0
        if self._deaf == _DEAF:
            self._process.give_up(lost)


def _quality(end) -> dict:
    """Return the QoS of a publisher or subscription; parameters `qos_overrides` change it."""
    options = rclpy.qos_overriding_options.QoSOverridingOptions.with_default_policies()
    given = {name: value for name, value in vars(end.qos_profile).items() if value != math.inf}
    for name in {"deadline", "lifespan"} & given.keys():
        given[name] = rclpy.duration.Duration(seconds=given[name])
    profile = rclpy.qos.QoSProfile(**given)
    return {"qos_profile": profile, "qos_overriding_options": options}


class ToRos(logging.Handler):
    """What is logged goes to ROS, its console and /rosout, under the name of its node.

    Attributes:
        nodes: name of its logger -> rclpy's node; the first speaks for all others.
    """

    def __init__(self):
        super().__init__()
        self.nodes: dict = {}

    def emit(self, record: logging.LogRecord) -> None:
        try:
            node = self.nodes.get(record.name) or next(iter(self.nodes.values()), None)
            name = node.get_logger().name if node else record.name
            # a new logger: one takes one severity from each line that calls it
            rclpy.logging.get_logger(name).log(self.format(record), record.levelno)
        except Exception:  # a ROS that is gone
            self.handleError(record)
