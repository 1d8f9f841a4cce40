# SPDX-License-Identifier: Apache-2.0
"""Topics: who publishes, who listens, and how many messages wait."""

from __future__ import annotations

import enum
import math
import threading
from collections import defaultdict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from ...errors import TopicTypeError
from .clock import Clock

if TYPE_CHECKING:
    from .calls import Service
    from .node import Node


class DurabilityPolicy(enum.IntEnum):
    VOLATILE = 2
    TRANSIENT_LOCAL = 1


class ReliabilityPolicy(enum.IntEnum):
    RELIABLE = 1
    BEST_EFFORT = 2


@dataclass(frozen=True)
class QoSProfile:
    """Quality of service."""

    depth: int = 10  # messages kept for a subscriber that lags
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE  # TRANSIENT_LOCAL is "latched"
    # on ROS; who subscribes with BEST_EFFORT hears publishers of both kinds
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    # on ROS: s between two messages at most, and after which one says nothing; infinite: never
    deadline: float = math.inf
    lifespan: float = math.inf

    def __post_init__(self):
        if self.depth < 1:
            raise ValueError(f"depth = {self.depth}: must be 1 or more")


def type_name(kind: type) -> str:
    """Return ROS 2's name of a message or service type."""
    return kind.TYPE  # type: ignore[attr-defined]


def as_qos(profile: QoSProfile | int) -> QoSProfile:
    """Return a profile; a depth alone is one, as in rclpy."""
    return profile if isinstance(profile, QoSProfile) else QoSProfile(depth=profile)


class Context:
    """One set of topics and services; nodes of different contexts do not see each other."""

    def __init__(self, clock=None):
        self.clock = clock or Clock()
        # full name -> the node that was made last in it, while somebody holds it
        self.nodes: WeakValueDictionary[str, Node] = WeakValueDictionary()
        self.node_names: set[str] = set()  # full names of the nodes that were made in it
        self._lock = threading.RLock()
        self._topic_type: dict[str, type] = {}
        self._publishers: dict[str, list[Publisher]] = defaultdict(list)
        self._subscriptions: dict[str, tuple[Subscription, ...]] = defaultdict(tuple)
        self._services: dict[str, Service] = {}
        self._down = threading.Event()

    def ok(self) -> bool:
        return not self._down.is_set()

    def count_publishers(self, topic: str) -> int:
        """Return how many publish the topic of this full name."""
        with self._lock:
            return len(self._publishers.get(topic, ()))

    def try_shutdown(self) -> None:
        """Ask everything that spins in this context to end."""
        self._down.set()

    def _claim(self, topic: str, msg_type: type) -> None:
        known = self._topic_type.setdefault(topic, msg_type)
        if known is not msg_type:
            raise TopicTypeError(
                f"topic {topic} carries {type_name(known)}, not {type_name(msg_type)}"
            )


default_context = Context()


class Publisher:
    def __init__(self, node: Node, msg_type: type, topic: str, qos: QoSProfile):
        self.topic_name, self.msg_type, self.qos_profile = topic, msg_type, qos
        self._context = node.context
        latched = qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        self._kept: deque = deque(maxlen=qos.depth if latched else 0)
        with self._context._lock:
            self._context._claim(topic, msg_type)
            self._context._publishers[topic].append(self)

    def publish(self, message) -> None:
        """Hand the message to every subscriber; never blocks on one."""
        if type(message) is not self.msg_type:
            raise TypeError(
                f"topic {self.topic_name} carries {type_name(self.msg_type)}, not {message!r}"
            )
        with self._context._lock:
            self._kept.append(message)
            subscriptions = self._context._subscriptions[self.topic_name]
        for subscription in subscriptions:
            subscription.put(message)

    def get_subscription_count(self) -> int:
        return len(self._context._subscriptions[self.topic_name])


class Subscription:
    """Attributes: `dropped`, messages that a slow callback made the queue lose."""

    def __init__(self, node: Node, msg_type: type, topic: str, callback, qos: QoSProfile):
        self.topic_name, self.msg_type, self.qos_profile = topic, msg_type, qos
        self.callback, self.dropped = callback, 0
        self._node = node
        self._queue: deque = deque()
        context = node.context
        with context._lock:
            context._claim(topic, msg_type)
            if qos.durability is DurabilityPolicy.TRANSIENT_LOCAL:
                for publisher in context._publishers[topic]:
                    for message in publisher._kept:
                        self.put(message)
            context._subscriptions[topic] += (self,)

    def put(self, message) -> None:
        """Take a message that has arrived, in whatever thread."""
        node = self._node
        with node._lock:
            if node._gone:
                return
            if len(self._queue) < self.qos_profile.depth:
                node._inbox.append(self)
            else:  # it keeps its turn: else who publishes fast enough is never heard
                self._queue.popleft()
                self.dropped += 1
            self._queue.append(message)
        node._wake.set()

    def _next(self):
        """Return the oldest message's call, as (callback, arguments, future)."""
        return self.callback, (self._queue.popleft(),), None


class Listener(Subscription):
    """Hears messages in the publisher's thread, and wakes nobody: for what only looks on.

    A callback is called at once. Without one the newest are kept, as many as its depth, until they
    are taken.

    Attributes:
        keeps: whether it has no callback.
        fetch: what puts in what has come from another process, before what is kept is taken.
    """

    def __init__(self, node: Node, msg_type: type, topic: str, callback, qos: QoSProfile):
        self._kept: deque = deque(maxlen=qos.depth)
        self.keeps, self.fetch = callback is None, _nothing
        super().__init__(node, msg_type, topic, callback or self._kept.append, qos)

    def put(self, message) -> None:
        try:
            self.callback(message)
        except Exception as error:  # it must not reach the publisher
            self._node._report(self.callback, error)

    def take(self) -> list:
        """Return what has come since the last time, oldest first."""
        self.fetch()
        return [self._kept.popleft() for _ in range(len(self._kept))]


def _nothing() -> None:
    """Fetch nothing: all is in this process."""
