# SPDX-License-Identifier: Apache-2.0
"""A node: its names, what it is made of, and how its callbacks are called."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from ...errors import ParameterError
from ...fields import About
from .context import Context, default_context, type_name
from .inbox import Inbox, Timer
from .parameters import ANYTHING, Parameter, SetParametersResult, checked
from .services import Client, Service
from .topics import DurabilityPolicy, Listener, Publisher, QoSProfile, Subscription, as_qos

_Heard = TypeVar("_Heard", bound=Subscription)
_LATCHED = QoSProfile(durability=DurabilityPolicy.TRANSIENT_LOCAL)
_NEW = QoSProfile()  # nothing that was published before


class Node(Inbox):
    """A named set of callbacks, as rclpy's Node.

    Args:
        node_name: last part of its full name.
        context: the topics it sees; None: those of the process.
        remappings: (from, to) of topics and services; the first for a name counts, as in ROS.
        namespace: prefix of its relative names.
        parameter_overrides: values that win over the defaults its parameters are declared with.

    Attributes:
        waits: for a board that is absent at the start; else that is a mistake of who started it.
    """

    waits = False
    publisher_class: type[Publisher] = Publisher

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        remappings: Sequence[tuple[str, str]] = (),
        namespace: str = "",
        parameter_overrides: list[Parameter] | None = None,
    ):
        self._name = node_name
        self._namespace = "/" + namespace.strip("/") if namespace.strip("/") else "/"
        name = self.get_fully_qualified_name()
        # as ROS names it, below that of the package
        logger = logging.getLogger(f"tactile_skin{name.replace('/', '.')}")
        super().__init__(context or default_context, logger)
        self._overrides = {p.name: p.value for p in parameter_overrides or []}
        self._parameters: dict[str, Parameter] = {}
        self._described: dict[str, About] = {}
        self._on_set: Callable | None = None
        self._subscriptions: list[Subscription] = []
        self._services: list[Service] = []
        self._publishers: list[Publisher] = []
        self._remapped = {self._expand(a): self._expand(b) for a, b in reversed(remappings)}
        self.context.nodes[name] = self

    # names

    def get_name(self) -> str:
        return self._name

    def get_namespace(self) -> str:
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        return f"{self._namespace.rstrip('/')}/{self._name}"

    def resolve_topic_name(self, topic: str) -> str:
        """Full name of a topic, or a service: namespace, private "~/" and remappings applied."""
        name = self._expand(topic)
        return self._remapped.get(name, name)

    resolve_service_name = resolve_topic_name

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Full name of each topic, and ROS 2's name of its type."""
        with self.context._lock:
            return [(name, [type_name(kind)]) for name, kind in self.context._topic_type.items()]

    def undeclared(self) -> list[str]:
        """Names of overrides that no parameter of this node has: most likely misspelt."""
        return sorted(set(self._overrides) - set(self._parameters))

    def parameter_names(self) -> list[str]:
        return sorted(self._parameters)

    def _expand(self, name: str) -> str:
        if not name or name.endswith("/") or " " in name:
            raise ValueError(f"{name!r} is not a topic or service name")
        if name.startswith("/"):
            return name
        if name.startswith("~/"):
            return f"{self.get_fully_qualified_name()}/{name[2:]}"
        return f"{self._namespace.rstrip('/')}/{name}"

    # what a node is made of

    def create_publisher(self, msg_type, topic: str, qos_profile: QoSProfile | int) -> Publisher:
        name = self.resolve_topic_name(topic)
        publisher = self.publisher_class(self, msg_type, name, as_qos(qos_profile))
        self._publishers.append(publisher)
        return publisher

    def create_subscription(
        self, msg_type, topic: str, callback, qos_profile: QoSProfile | int
    ) -> Subscription:
        name = self.resolve_topic_name(topic)
        return self._added(Subscription(self, msg_type, name, callback, as_qos(qos_profile)))

    def _added(self, subscription: _Heard) -> _Heard:
        with self._lock:
            self._subscriptions.append(subscription)
        self._wake.set()
        return subscription

    def create_listener(
        self, msg_type, topic: str, callback=None, qos_profile: QoSProfile | int = _LATCHED
    ) -> Listener:
        """Subscribe in the publisher's thread, as `Listener` says; rclpy has no such thing."""
        name = self.resolve_topic_name(topic)
        return self._added(Listener(self, msg_type, name, callback, as_qos(qos_profile)))

    def create_timer(self, timer_period_sec: float, callback) -> Timer:
        if not timer_period_sec > 0:
            raise ValueError(f"timer_period_sec = {timer_period_sec!r}: must be above 0")
        return Timer(self, round(timer_period_sec * 1e9), callback)

    def create_service(self, srv_type, srv_name: str, callback) -> Service:
        service = Service(self, srv_type, self.resolve_service_name(srv_name), callback)
        offered = self.context._services
        with self.context._lock:
            if service.srv_name in offered:
                raise ValueError(f"service {service.srv_name} is offered already")
            offered[service.srv_name] = service
            self._services.append(service)
        return service

    def create_client(self, srv_type, srv_name: str) -> Client:
        return Client(self.context, srv_type, self.resolve_service_name(srv_name))

    def get_clock(self):
        return self.context.clock

    def get_logger(self) -> logging.Logger:
        return self._logger

    def declare_parameter(self, name: str, value, descriptor: About = ANYTHING) -> Parameter:
        """Announce a parameter; its value is the override, or the given default.

        Raises:
            ParameterError: the override has another type, or is not what the descriptor allows.
        """
        if name in self._parameters:
            raise ParameterError(f"parameter {name} of node {self._name} is declared twice")
        override = self._overrides.get(name, value)
        valid = checked(self._name, name, override, value, descriptor)
        self._parameters[name] = Parameter(name, valid)
        self._described[name] = descriptor
        return self._parameters[name]

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            raise ParameterError(f"parameter {name} of node {self._name} is not declared")
        return self._parameters[name]

    def on_set_parameters(self, callback: Callable[[dict[str, object]], None]) -> None:
        """Let parameters change while the node runs: those that are declared `live`.

        Args:
            callback: called in the node's thread with name -> new value of all parameters that may
                change; a ValueError refuses them, with its text as the reason.
        """
        self._on_set = callback

    def set_parameters_atomically(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Change all or none, as rclpy does: each is checked as when it was declared.

        To be called in the node's thread: `ask` does so from another one.
        """
        changed = {}
        try:
            for p in parameters:
                old = self.get_parameter(p.name)
                described = self._described[p.name]
                if not described.live or self._on_set is None:
                    raise ParameterError(
                        f"parameter {p.name} of node {self._name} is read at the start only"
                    )
                changed[p.name] = checked(self._name, p.name, p.value, old.value, described)
            free = [name for name, d in self._described.items() if d.live]
            if self._on_set:
                self._on_set({name: self._parameters[name].value for name in free} | changed)
        except ValueError as error:
            return SetParametersResult(False, str(error))
        self._parameters |= {name: Parameter(name, value) for name, value in changed.items()}
        return SetParametersResult(True)

    def stand_in(self, forward: Callable, call: Callable, change: Callable) -> list[Listener]:
        """Stand for the node of this name in another process: do nothing of itself any more.

        Args:
            forward: takes a topic and each message that others publish on it for this node, in
                their threads.
            call: answers a service, by its name and the request.
            change: takes parameters, name -> value; a ValueError refuses them.

        Returns:
            what listens for `forward`.
        """
        with self.context._lock, self._lock:
            heard = self._subscriptions
            self._stop_listening()
            self._timers.clear()
            self._plan()
            for service in self._services:
                self.context._services[service.srv_name] = service._replace(
                    callback=partial(call, service.srv_name)
                )
            self._on_set = change if self._on_set else None
        return [
            self.create_listener(s.msg_type, s.topic_name, partial(forward, s.topic_name), _NEW)
            for s in heard
        ]

    def _stop_listening(self) -> None:
        for s in self._subscriptions:
            others = self.context._subscriptions[s.topic_name]
            self.context._subscriptions[s.topic_name] = tuple(o for o in others if o is not s)
        self._subscriptions = []

    def destroy_node(self) -> None:
        """Leave all topics and services; callbacks under way finish."""
        with self.context._lock, self._lock:
            self._stop_listening()
            for p in self._publishers:
                self.context._publishers[p.topic_name].remove(p)
            for service in self._services:
                del self.context._services[service.srv_name]
            for kept in (self._publishers, self._services):
                kept.clear()
            self._leave()
        self._wake.set()

    @property
    def publishers(self) -> tuple[Publisher, ...]:
        """Its publishers, as rclpy's."""
        return tuple(self._publishers)

    @property
    def dropped(self) -> int:
        """Number of messages that the queues of its subscriptions have dropped."""
        with self._lock:
            return sum(subscription.dropped for subscription in self._subscriptions)
