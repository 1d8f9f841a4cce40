# SPDX-License-Identifier: Apache-2.0
"""Which topics, services and nodes see each other."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Any
from weakref import WeakValueDictionary

from ...errors import TopicTypeError
from .clock import Clock


def type_name(kind: type) -> str:
    """Return ROS 2's name of a message or service type."""
    return kind.TYPE  # type: ignore[attr-defined]


class Context:
    """One set of topics and services; nodes of different contexts do not see each other."""

    def __init__(self, clock=None):
        self.clock = clock or Clock()
        # full name -> the node that was made last in it, while somebody holds it
        self.nodes: WeakValueDictionary[str, Any] = WeakValueDictionary()
        self._lock = threading.RLock()
        self._topic_type: dict[str, type] = {}
        self._publishers: dict[str, list[Any]] = defaultdict(list)
        self._subscriptions: dict[str, tuple[Any, ...]] = defaultdict(tuple)
        self._services: dict[str, Any] = {}
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
