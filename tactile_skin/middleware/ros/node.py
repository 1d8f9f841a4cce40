"""A node of the bus whose topics and services are those of ROS."""

from __future__ import annotations

import concurrent.futures
import importlib.util
import logging
import time
from collections.abc import Callable

from ...errors import RosError
from .. import bus
from .messages import from_ros, ros_class, to_ros
from .ros1 import Ros1
from .ros2 import Ros2

_SERVICE_WITHIN = 5.0  # s, for a node's answer
MODULES = {2: ("rclpy", Ros2), 1: ("rospy", Ros1)}


def installed() -> int | None:
    """Which ROS this Python has: 2, 1, or None; with both, 2."""
    return next((v for v, (name, _) in MODULES.items() if importlib.util.find_spec(name)), None)


def choose(version: int | None) -> int:
    """The wanted ROS, or the one that is there.

    Raises:
        RosError: it is not installed.
    """
    found = version or installed()
    if found is None:
        raise RosError("neither rclpy (ROS 2) nor rospy (ROS 1) is installed: see README.md")
    if not importlib.util.find_spec(MODULES[found][0]):
        raise RosError(f"ROS {found}: {MODULES[found][0]} is not installed: see README.md")
    return found


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
        self._not_taken = 0

    def get_clock(self):
        return self._wall_clock

    def create_publisher(self, msg_type, topic: str, qos_profile: bus.QoSProfile | int):
        name, qos = self.resolve_topic_name(topic), bus.as_qos(qos_profile)
        made = _Publisher(msg_type, name, *self._ros.advertise(ros_class(msg_type), name, qos))
        self._publishers.append(made)
        return made

    def create_subscription(self, msg_type, topic: str, callback, qos_profile):
        return self._hear(super().create_subscription(msg_type, topic, callback, qos_profile))

    def create_tap(self, msg_type, topic: str, callback):
        return self._hear(super().create_tap(msg_type, topic, callback))

    def _hear(self, subscription):
        """The subscription, of what arrives on ROS."""
        msg_type = subscription.msg_type

        def arrived(message) -> None:  # in ROS's thread: queue it, nothing else
            try:
                subscription.put(from_ros(msg_type, message))
            except Exception:  # logged by whoever called
                self._not_taken += 1
                raise

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

    @property
    def callback_errors(self) -> int:
        """As of a node of the bus, and the messages of ROS that could not be converted."""
        return super().callback_errors + self._not_taken

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


class ToRos(logging.Handler):
    """What is logged goes to ROS: its console and /rosout."""

    def __init__(self, ros: Ros1 | Ros2):
        super().__init__()
        self._ros = ros

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._ros.log(record.levelno, self.format(record))
        except Exception:  # a ROS that is gone
            self.handleError(record)
