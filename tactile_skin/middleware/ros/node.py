# SPDX-License-Identifier: Apache-2.0
"""A node of the bus whose topics, services and parameters are those of ROS."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from ... import msg
from ...fields import About
from .. import bus
from ..package import SOURCES
from ..parameter_file import THEIRS
from .messages import from_ros, ros_class, to_ros
from .process import Process

_SERVICE_WITHIN = 5.0  # s, for a node's answer
_STILL = 0.25  # s without news from /clock: ten messages of `ros2 bag play --clock`
_COMPARE = 2.0  # s, between two looks at what others publish and subscribe to
# Looks in a row, 10 s: discovery takes up to 6 s on a busy computer (benchmarks/ros/kill.py).
_DEAF = 5
_logger = logging.getLogger("tactile_skin")


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
        if not self._theirs.ros_time_is_active:
            return False
        shown, t = self._theirs.now().nanoseconds, time.monotonic()
        if shown != self._last:
            self._last, self._since = shown, t
        return t - self._since > _STILL


class _Publisher:
    """Hands messages to the nodes of this process, and to ROS if anybody is there to hear them."""

    def __init__(self, inside: bus.Publisher, theirs):
        self.msg_type, self.topic_name = inside.msg_type, inside.topic_name
        self._inside, self._theirs = inside, theirs
        self._kept = inside.qos_profile.durability is bus.DurabilityPolicy.TRANSIENT_LOCAL

    def publish(self, message) -> None:
        self._inside.publish(message)
        if self._kept or self._theirs.get_subscription_count():
            self._theirs.publish(to_ros(message))

    def get_subscription_count(self) -> int:
        return self._inside.get_subscription_count() + self._theirs.get_subscription_count()


class RosNode(bus.Node):
    """A node of the bus whose topics, services and parameters are on ROS as well.

    Nodes of one process share a context: what one of them publishes does not take the way over ROS
    to another. `connect` opens the rest to ROS, once all are there.

    Attributes:
        ros: rclpy's node.
    """

    waits = True

    def __init__(
        self,
        process: Process,
        node_name: str,
        *,
        namespace: str = "",
        parameter_overrides: list[bus.Parameter] | None = None,
        **kwargs,
    ):
        given = parameter_overrides or []
        theirs = [p for p in given if p.name.startswith(THEIRS)]
        super().__init__(
            node_name,
            namespace=namespace,
            parameter_overrides=[p for p in given if p not in theirs],
            **kwargs,
        )
        self.ros, clock = process.node(node_name, self.get_namespace(), theirs)
        self._clock = _RosClock(clock)
        self._process, self._acknowledged = process, process.publishers
        self._connected, self._shared = False, set[str]()
        self._not_taken = 0
        self._kinds: dict[str, type] = {}  # topic -> what this node takes it to be
        self._told: set[tuple[str, str]] = set()
        # topic -> node that publishes it, in this namespace, and rclpy's subscription
        self._sources: dict[str, tuple] = {}
        self._deaf = 0  # looks in a row
        for look in (self._look_at_graph, self._look_for_sources):
            self.ros.create_timer(_COMPARE, _isolated("the graph", look), clock=process.steady())

    def get_clock(self):
        return self._clock

    def create_publisher(self, msg_type, topic: str, qos_profile: bus.QoSProfile | int):
        inside = super().create_publisher(msg_type, topic, qos_profile)
        kind, name = ros_class(msg_type), inside.topic_name
        qos = _qos(inside.qos_profile)
        theirs = self.ros.create_publisher(kind, name, qos, qos_overriding_options=_overridable())
        self._acknowledged.append(theirs)
        self._kinds[name] = kind
        return _Publisher(inside, theirs)

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
        if not self._connected or (
            topic not in self._shared and self.context.count_publishers(topic)
        ):
            return subscription

        def arrived(message) -> None:  # in ROS's thread: queue it, nothing else
            try:
                taken = from_ros(msg_type, message)
                if topic not in self._shared or not self._is_of_this_process(taken):
                    subscription.put(taken)
            except Exception:
                self._not_taken += 1
                raise

        self._kinds[topic] = kind = ros_class(msg_type)
        taker = _isolated(f"a message on {topic}", arrived)
        qos = _qos(subscription.qos_profile)
        keeps = isinstance(subscription, bus.Listener) and subscription.keeps
        theirs = self.ros.create_subscription(
            kind,
            topic,
            taker,
            qos,
            callback_group=_no_callbacks() if keeps else None,
            qos_overriding_options=_overridable(),
        )
        if keeps:
            subscription.fetch = lambda: _take_all(theirs, taker)
        unmapped = topic.removeprefix(f"{self.get_namespace().rstrip('/')}/")
        if unmapped in SOURCES:
            self._sources[topic] = SOURCES[unmapped], theirs
        return subscription

    def _is_of_this_process(self, message) -> bool:
        """Return whether it is a report that has arrived already, within the process.

        Transforms do not say whose they are, and may arrive twice.
        """
        return isinstance(message, msg.DiagnosticArray) and all(
            f"/{status.name}" in self.context.node_names for status in message.status
        )

    def create_service(self, srv_type, srv_name: str, callback):
        service = super().create_service(srv_type, srv_name, callback)
        client = super().create_client(srv_type, srv_name)

        def answer(request, response):  # in ROS's thread: the node's own does the work
            try:
                found = client.call(from_ros(srv_type.Request, request), _SERVICE_WITHIN)
            except Exception as error:  # raised here it would end rclpy's executor
                self.get_logger().error("service %s: %r", service.srv_name, error)
                found = srv_type.Response(success=False, message=str(error) or repr(error))
            return to_ros(found, response)

        self.ros.create_service(ros_class(srv_type), service.srv_name, answer)
        return service

    def create_client(self, srv_type, srv_name: str):
        raise NotImplementedError(f"{srv_name}: on ROS no node of the skin calls services")

    @property
    def callback_errors(self) -> int:
        """As of a node of the bus, and the messages of ROS that could not be converted."""
        return super().callback_errors + self._not_taken

    def declare_parameter(
        self, name: str, value, descriptor: About = bus.ANYTHING
    ) -> bus.Parameter:
        """As a node of the bus does, and show it to `ros2 param`."""
        from rcl_interfaces import msg as rcl

        parameter = super().declare_parameter(name, value, descriptor)
        described = rcl.ParameterDescriptor(
            description=descriptor.description,
            read_only=not descriptor.live,
            dynamic_typing=descriptor.any_type,
        )
        low, high = descriptor.low, descriptor.high
        if low is not None and high is not None:
            if isinstance(value, int):
                bounds = rcl.IntegerRange(from_value=int(low), to_value=int(high))
                described.integer_range.append(bounds)
            else:
                floats = rcl.FloatingPointRange(from_value=float(low), to_value=float(high))
                described.floating_point_range.append(floats)
        self.ros.declare_parameter(name, parameter.value, described, ignore_override=True)
        return parameter

    def _set_from_ros(self, parameters):
        """Whether parameters can be set, and why not; the node's own thread does it."""
        from rcl_interfaces import msg as rcl

        ours = [bus.Parameter(p.name, p.value) for p in parameters if p.name in self._parameters]
        reason = ""
        if ours:
            client = super().create_client(bus.SetParameters, bus.SET_PARAMETERS)
            try:
                reason = client.call(bus.SetParameters.Request(ours), _SERVICE_WITHIN).reason
            except Exception as error:  # raised here it would end rclpy's executor
                reason = str(error) or repr(error)
        return rcl.SetParametersResult(successful=not reason, reason=reason)

    def _look_for_sources(self) -> None:
        """End the process if ROS keeps from it what a node that is there publishes from its start.

        After a kill -9, Fast DDS loses announcements of publishers for ever, about once in a
        hundred restarts: github.com/eProsima/Fast-DDS/issues/5469. Who joins again hears them.
        """
        there = self.ros.get_node_names_and_namespaces()
        lost = [
            (source, topic)
            for topic, (source, heard) in self._sources.items()
            if (source, self.get_namespace()) in there and not heard.get_publisher_count()
        ]
        self._deaf = self._deaf + 1 if lost else 0
        if self._deaf == _DEAF:
            source, topic = lost[0]
            self._process.give_up(
                f"{source} is there, and ROS does not show that it publishes {topic}: "
                "this process ends, since only another start finds it"
            )

    def _look_at_graph(self) -> None:
        """Warn of others who use a topic of this node for another type, or publish it as well.

        DDS does not connect the former; whoever listens hears the latter in turns.
        """
        for publisher in self._publishers:
            topic = publisher.topic_name
            if topic in self._shared or (topic, "") in self._told:
                continue
            count = self.ros.count_publishers(topic)
            if count > self.context.count_publishers(topic):
                self._told.add((topic, ""))
                self.get_logger().warning(
                    f"{topic}: another process publishes it as well, or was killed just now: "
                    "whoever listens hears both in turns. Give each skin a namespace of its own"
                )
        for topic, kind in tuple(self._kinds.items()):
            ours = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            for end in (
                *self.ros.get_publishers_info_by_topic(topic),
                *self.ros.get_subscriptions_info_by_topic(topic),
            ):
                other = topic, end.node_name
                if end.topic_type not in ("", ours) and other not in self._told:
                    self._told.add(other)
                    self.get_logger().warning(
                        f"{topic}: {end.node_name} has {end.topic_type}, this node {ours}: "
                        f"they do not hear each other{_remedy(ours, end.topic_type)}"
                    )


def _qos(qos: bus.QoSProfile):
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=qos.depth,
        durability=DurabilityPolicy[qos.durability.name],
        reliability=ReliabilityPolicy[qos.reliability.name],
    )


def _overridable():
    """Let parameters `qos_overrides` change history, depth and reliability."""
    from rclpy.qos_overriding_options import QoSOverridingOptions

    return QoSOverridingOptions.with_default_policies()


def _no_callbacks():
    """Return a callback group of what no executor waits for."""
    from rclpy.callback_groups import CallbackGroup

    class Never(CallbackGroup):
        def can_execute(self, entity) -> bool:
            return False

        def beginning_execution(self, entity) -> bool:
            return False

        def ending_execution(self, entity) -> None:
            pass

    return Never()


def _take_all(theirs, taker: Callable) -> None:
    """Hand over all that has come for rclpy's subscription."""
    with theirs.handle:
        while taken := theirs.handle.take_message(theirs.msg_type, theirs.raw):
            taker(taken[0])


def _remedy(ours: str, theirs: str) -> str:
    if {ours, theirs} == {"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"}:
        return f": set stamped to {str(theirs.endswith('Stamped')).lower()}"
    return ""


def _isolated(what: str, callback: Callable) -> Callable:
    """Return a callback whose exceptions are logged: one would end rclpy's executor."""

    def call(*arguments) -> None:
        try:
            callback(*arguments)
        except Exception:
            _logger.exception("%s was not taken", what)

    return call


class ToRos(logging.Handler):
    """What is logged goes to ROS, its console and /rosout, under the name of its node.

    Attributes:
        nodes: name of its logger -> rclpy's node; the first speaks for all others.
    """

    def __init__(self):
        super().__init__()
        self.nodes: dict = {}

    def emit(self, record: logging.LogRecord) -> None:
        node = self.nodes.get(record.name) or next(iter(self.nodes.values()), None)
        try:
            if node is not None:
                _log(node.get_logger(), record.levelno, self.format(record))
            elif logging.lastResort is not None:
                logging.lastResort.handle(record)
        except Exception:  # a ROS that is gone
            self.handleError(record)


def _log(logger, level: int, text: str) -> None:
    """Say it; a line for each severity: rclpy wants no other on the same."""
    if level >= logging.ERROR:
        logger.error(text)
    elif level >= logging.WARNING:
        logger.warning(text)
    elif level >= logging.INFO:
        logger.info(text)
    else:
        logger.debug(text)
