"""Topics and services of one node by rospy."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable

from ...errors import RosError
from .. import bus
from .ros2 import LAST_WORD

_QUEUE = 40  # messages for each subscriber: as many as the bus keeps for a frame
_LEVELS = {"debug": 1, "info": 2, "warn": 4, "error": 8, "fatal": 16}  # of rosgraph_msgs/Log


class Ros1:
    """A process on ROS 1, which is one node of rospy whatever the skin's nodes in it; waits for a
    master. Their topics and services have full names, so that the graph looks as with rclpy.

    rospy registers once: a master that was restarted would know nobody. So each node looks once a
    second whether the master knows it, and registers anew what it does not.
    """

    def __init__(self, name: str, namespace: str, words: list[str]):
        """
        Args:
            words: of the command line, for ROS itself.

        Raises:
            RosError: one of them is not for ROS 1.
        """
        options = _options(words)
        os.environ["ROS_NAMESPACE"] = namespace  # rospy reads it when it is imported
        import rospy

        self.failed = False  # rospy isolates what its threads call
        rospy.init_node(name, argv=[], disable_signals=True, **options)
        self._rospy, self._closed = rospy, threading.Event()

    def node(self, name: str, namespace: str, parameters: list[bus.Parameter]) -> Ros1:
        given = {p.name: p.value for p in parameters}
        if given.pop("use_sim_time", False) and not self.simulated:
            raise RosError(
                "use_sim_time: ROS 1 has one for all nodes: rosparam set use_sim_time true, before "
                "they start"
            )
        if given:
            raise RosError(f"parameter {min(given)!r}: is for ROS 2 only")
        return self

    def start(self, ended: Callable) -> None:
        """Let messages arrive; `ended` is called when none does any more."""

        def on_shutdown() -> None:
            ended()
            self._closed.wait(2 * LAST_WORD)  # the final messages are published first

        self._rospy.on_shutdown(on_shutdown)
        threading.Thread(target=self._stay_registered, name="rospy", daemon=True).start()

    @property
    def simulated(self) -> bool:
        """Whether /clock tells the time."""
        return not self._rospy.rostime.is_wallclock()

    def now(self) -> int:
        """Time of day, or what /clock says [ns]."""
        return self._rospy.get_rostime().to_nsec()

    def ok(self) -> bool:
        """False once another node has taken this one's name."""
        return not self._rospy.core.is_shutdown_requested()

    def advertise(self, kind: type, topic: str, qos: bus.QoSProfile) -> tuple[Callable, Callable]:
        """What sends a message, and what counts the subscribers."""
        latch = qos.durability is bus.DurabilityPolicy.TRANSIENT_LOCAL
        # A queue, and so a thread, for each subscriber: a slow one delays nobody. Latched topics
        # have a depth of 1, which is what is kept, not how many may be on their way. And no Nagle:
        # he would hold a message back until the last one is acknowledged, up to 40 ms.
        size = max(qos.depth, _QUEUE)
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

    def on_set(self, take: Callable) -> None:
        """Nor is a node asked when they change."""

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
        time.sleep(LAST_WORD / 2)  # for the subscribers' queues; rospy cannot be asked
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


def _options(words: list[str]) -> dict:
    """What rospy.init_node takes of ROS 2's words for its logs.

    Raises:
        RosError: naming one that ROS 1 has nothing for.
    """
    options, rest = {}, list(words)
    while rest:
        word = rest.pop(0)
        if word == "--log-level" and (level := rest.pop(0)).lower() in _LEVELS:
            options["log_level"] = _LEVELS[level.lower()]
        elif word == "--disable-rosout-logs":
            options["disable_rosout"] = True
        else:
            raise RosError(
                f"--ros-args {' '.join(words)}: on ROS 1 must be --disable-rosout-logs or "
                f"--log-level with one of {', '.join(_LEVELS)}"
            )
    return options
