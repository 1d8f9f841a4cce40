# SPDX-License-Identifier: Apache-2.0
"""Topics: who publishes, who listens, and how many messages wait."""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass

from .context import type_name
from .inbox import Inbox, Queue


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


def as_qos(profile: QoSProfile | int) -> QoSProfile:
    """Return a profile; a depth alone is one, as in rclpy."""
    return profile if isinstance(profile, QoSProfile) else QoSProfile(depth=profile)


class Publisher:
    def __init__(self, inbox: Inbox, msg_type: type, topic: str, qos: QoSProfile):
        self.topic_name, self.msg_type, self.qos_profile = topic, msg_type, qos
        self._context = inbox.context
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

    def forget(self) -> None:
        """Forget what is latched: who subscribes next hears nothing that was published before."""
        with self._context._lock:
            self._kept.clear()

    def get_subscription_count(self) -> int:
        return len(self._context._subscriptions[self.topic_name])


class Subscription(Queue):
    """Messages of a topic that wait for a node."""

    def __init__(self, inbox: Inbox, msg_type: type, topic: str, callback, qos: QoSProfile):
        super().__init__(inbox, callback, qos.depth)
        self.topic_name, self.msg_type, self.qos_profile = topic, msg_type, qos
        context = inbox.context
        with context._lock:
            context._claim(topic, msg_type)
            if qos.durability is DurabilityPolicy.TRANSIENT_LOCAL:
                for publisher in context._publishers[topic]:
                    for message in publisher._kept:
                        self.put(message)
            context._subscriptions[topic] += (self,)


class Listener(Subscription):
    """Hears messages in the publisher's thread, and wakes nobody: for what only looks on.

    A callback is called at once. Without one the newest are kept, as many as its depth, until they
    are taken.

    Attributes:
        keeps: whether it has no callback.
        fetch: what puts in what has come from another process, before what is kept is taken.
    """

    def __init__(self, inbox: Inbox, msg_type: type, topic: str, callback, qos: QoSProfile):
        self._kept: deque = deque(maxlen=qos.depth)
        self.keeps, self.fetch = callback is None, _nothing
        super().__init__(inbox, msg_type, topic, callback or self._kept.append, qos)

    def put(self, *arguments) -> None:
        try:
            self.callback(*arguments)
        except Exception as error:  # it must not reach the publisher
            self._inbox._report(self.callback, error)

    def take(self) -> list:
        """Return what has come since the last time, oldest first."""
        self.fetch()
        return [self._kept.popleft() for _ in range(len(self._kept))]


def _nothing() -> None:
    """Fetch nothing: all is in this process."""
