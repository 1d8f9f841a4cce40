"""A node of the bus whose topics and services are those of ROS."""

from __future__ import annotations

import concurrent.futures
import logging
import time
from collections.abc import Callable

from ... import msg
from .. import bus
from ..parameter_file import THEIRS
from .messages import from_ros, ros_class, to_ros
from .ros2 import Ros2, Ros2Node

_SERVICE_WITHIN = 5.0  # s, for a node's answer
_STILL = 0.25  # s without news from /clock: ten messages of `ros2 bag play --clock`


class _RosClock:
    """The time of day, which processes and machines share, or a simulation's. Timers run on the
    bus's own clock, which neither jumps nor stands still."""

    def __init__(self, theirs):
        self._theirs, self._last, self._since = theirs, 0, time.monotonic()

    def now(self) -> bus.Time:
        return bus.Time(self._theirs.now() if self._theirs.simulated else time.time_ns())

    @property
    def stands_still(self) -> bool:
        """Whether it has shown the same for a while: who waits for it would wait for ever."""
        if not self._theirs.simulated:
            return False
        shown, t = self._theirs.now(), time.monotonic()
        if shown != self._last:
            self._last, self._since = shown, t
        return t - self._since > _STILL


class _Publisher:
    """Hands messages to the nodes of this process, and to ROS if anybody is there to hear them."""

    def __init__(self, inside: bus.Publisher, send: Callable, count: Callable):
        self.msg_type, self.topic_name = inside.msg_type, inside.topic_name
        self._inside, self._send, self._count = inside, send, count
        self._kept = inside.qos_profile.durability is bus.DurabilityPolicy.TRANSIENT_LOCAL

    def publish(self, message) -> None:
        self._inside.publish(message)
        if self._kept or self._count():
            self._send(to_ros(message))

    def get_subscription_count(self) -> int:
        return self._inside.get_subscription_count() + self._count()


class RosNode(bus.Node):
    """A node of the bus whose topics, services and parameters are on ROS as well.

    Nodes of one process share a context: what one of them publishes does not take the way over ROS
    to another. `connect` opens the rest to ROS, once all are there.

    Attributes:
        ros: what `Ros2` made for it.
    """

    def __init__(
        self,
        ros: Ros2,
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
        self.ros = ros.node(node_name, self.get_namespace(), theirs)
        self._clock = _RosClock(self.ros)
        self._connected = False
        self._not_taken = 0

    def get_clock(self):
        return self._clock

    def create_publisher(self, msg_type, topic: str, qos_profile: bus.QoSProfile | int):
        inside = super().create_publisher(msg_type, topic, qos_profile)
        theirs = ros_class(msg_type)
        return _Publisher(
            inside, *self.ros.advertise(theirs, inside.topic_name, inside.qos_profile)
        )

    def create_subscription(self, msg_type, topic: str, callback, qos_profile):
        return self._hear(super().create_subscription(msg_type, topic, callback, qos_profile))

    def create_tap(self, msg_type, topic: str, callback):
        return self._hear(super().create_tap(msg_type, topic, callback))

    def connect(self, *shared: str) -> None:
        """Take from ROS what no node of this process publishes.

        Args:
            shared: topics on which nodes of this process and others have a word.
        """
        self._connected, self._shared = True, set(map(self.resolve_topic_name, shared))
        for subscription in tuple(self._subscriptions):
            self._hear(subscription)
        self.ros.on_set(self._set_from_ros)  # not before: rclpy asks it for what is declared, too

    def _hear(self, subscription):
        """The subscription, of what arrives on ROS."""
        msg_type, topic = subscription.msg_type, subscription.topic_name
        if not self._connected or (topic not in self._shared and self.context.publishes(topic)):
            return subscription

        def arrived(message) -> None:  # in ROS's thread: queue it, nothing else
            try:
                taken = from_ros(msg_type, message)
                if topic not in self._shared or not self._is_of_this_process(taken):
                    subscription.put(taken)
            except Exception:  # logged by whoever called
                self._not_taken += 1
                raise

        self.ros.subscribe(ros_class(msg_type), topic, arrived, subscription.qos_profile)
        return subscription

    def _is_of_this_process(self, message) -> bool:
        """Whether it is a report that has arrived already, within the process. Transforms do not
        say whose they are, and may arrive twice."""
        return isinstance(message, msg.DiagnosticArray) and all(
            f"/{status.name}" in self.context.node_names for status in message.status
        )

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

        self.ros.serve(ros_class(srv_type), service.srv_name, answer)
        return service

    def create_client(self, srv_type, srv_name: str):
        raise NotImplementedError(f"{srv_name}: on ROS no node of the skin calls services")

    @property
    def callback_errors(self) -> int:
        """As of a node of the bus, and the messages of ROS that could not be converted."""
        return super().callback_errors + self._not_taken

    def declare_parameter(self, name: str, value, descriptor=None) -> bus.Parameter:
        parameter = super().declare_parameter(name, value, descriptor)
        self.ros.declare(name, parameter.value, descriptor or bus.ParameterDescriptor())
        return parameter

    def _set_from_ros(self, parameters: list[bus.Parameter]) -> str:
        """Why parameters cannot be set, or nothing; in ROS's thread: the node's own does it."""
        ours = [p for p in parameters if p.name in self._parameters]
        if not ours:
            return ""
        client = super().create_client(bus.SetParameters, bus.SET_PARAMETERS)
        try:
            return _ask(client, bus.SetParameters.Request(ours)).reason
        except Exception as error:
            return str(error) or repr(error)


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


class ToRos(logging.Handler):
    """What is logged goes to ROS, its console and /rosout, under the name of its node.

    Attributes:
        nodes: name -> what `Ros2` made for it; the first speaks for all others.
    """

    def __init__(self):
        super().__init__()
        self.nodes: dict[str, Ros2Node] = {}

    def emit(self, record: logging.LogRecord) -> None:
        name = record.name.rsplit(".", 1)[-1]
        node = self.nodes.get(name) or next(iter(self.nodes.values()), None)
        try:
            if node is not None:
                node.log(record.levelno, self.format(record))
            elif logging.lastResort is not None:
                logging.lastResort.handle(record)
        except Exception:  # a ROS that is gone
            self.handleError(record)
