"""Topics, services, timers and parameters within one process, with rclpy's signatures.

A node written against this module runs unchanged on rclpy's Node. What differs is chosen for a
robot's stop: queues are bounded and drop the oldest (counted), a callback that raises is logged,
counted and isolated, and `MultiThreadedExecutor` gives each node a thread of its own, so that a
slow subscriber delays nobody but itself.
"""

from __future__ import annotations

import contextlib
import enum
import logging
import math
import operator
import sys
import threading
import time
from collections import defaultdict, deque
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from . import msg

# --- time ---------------------------------------------------------------------------------------


@dataclass(frozen=True, order=True)
class Duration:
    nanoseconds: int = 0


@dataclass(frozen=True, order=True)
class Time:
    nanoseconds: int = 0

    def to_msg(self) -> msg.Time:
        return msg.Time(*divmod(self.nanoseconds, 10**9))

    @classmethod
    def from_msg(cls, stamp: msg.Time) -> Time:
        return cls(stamp.sec * 10**9 + stamp.nanosec)

    def __sub__(self, other: Time) -> Duration:
        return Duration(self.nanoseconds - other.nanoseconds)


class Clock:
    """Time of day that never jumps: wall clock at start, then the monotonic clock."""

    def __init__(self):
        self._offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> Time:
        return Time(self._offset + time.monotonic_ns())

    @staticmethod
    def monotonic() -> float:
        """Seconds that went by, since whenever."""
        return time.monotonic()


class ManualClock:
    """A clock that a test drives."""

    def __init__(self, seconds: float = 1000.0):
        self._now = round(seconds * 1e9)
        self._set = 0

    def now(self) -> Time:
        return Time(self._now)

    def monotonic(self) -> float:
        """Seconds that went by, since whenever."""
        return (self._now - self._set) * 1e-9

    def advance(self, seconds: float) -> None:
        self._now += round(seconds * 1e9)

    def set(self, seconds: float) -> None:
        """Show another time of day, by so much, although no time goes by."""
        self._now += round(seconds * 1e9)
        self._set += round(seconds * 1e9)


# --- quality of service -------------------------------------------------------------------------


class DurabilityPolicy(enum.Enum):
    VOLATILE = 2
    TRANSIENT_LOCAL = 1


@dataclass(frozen=True)
class QoSProfile:
    """depth: messages kept for a subscriber that lags. TRANSIENT_LOCAL: "latched" in ROS 1."""

    depth: int = 10
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE

    def __post_init__(self):
        if self.depth < 1:
            raise ValueError(f"depth = {self.depth}: must be 1 or more")


def as_qos(profile: QoSProfile | int) -> QoSProfile:
    """A depth alone is a profile, as in rclpy."""
    return profile if isinstance(profile, QoSProfile) else QoSProfile(depth=profile)


# --- context: the names that nodes share --------------------------------------------------------


class TopicTypeError(TypeError, ValueError):
    """A topic that carries another type already."""


class Context:
    """One set of topics and services; nodes of different contexts do not see each other."""

    def __init__(self, clock=None):
        self.clock = clock or Clock()
        self._lock = threading.RLock()
        self._topic_type: dict[str, type] = {}
        self._publishers: dict[str, list[Publisher]] = defaultdict(list)
        self._subscriptions: dict[str, tuple[Subscription, ...]] = defaultdict(tuple)
        self._services: dict[str, Service] = {}
        self._down = threading.Event()

    def ok(self) -> bool:
        return not self._down.is_set()

    def try_shutdown(self) -> None:
        """Ask everything that spins in this context to end."""
        self._down.set()

    def wait(self, timeout_sec: float | None = None) -> bool:
        """Wait for the shutdown; whether it came."""
        return self._down.wait(timeout_sec)

    def _claim(self, topic: str, msg_type: type) -> None:
        known = self._topic_type.setdefault(topic, msg_type)
        if known is not msg_type:
            raise TopicTypeError(f"topic {topic} carries {known.TYPE}, not {msg_type.TYPE}")


_default_context = Context()

# --- publishers, subscriptions, timers, services ------------------------------------------------


class Publisher:
    def __init__(self, node: Node, msg_type: type, topic: str, qos: QoSProfile):
        self.topic_name, self.msg_type, self.qos_profile = topic, msg_type, qos
        self._context = node.context
        latched = qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        self._kept = deque(maxlen=qos.depth if latched else 0)
        with self._context._lock:
            self._context._claim(topic, msg_type)
            self._context._publishers[topic].append(self)

    def publish(self, message) -> None:
        """Hand the message to every subscriber; never blocks on one."""
        if type(message) is not self.msg_type:
            raise TypeError(
                f"topic {self.topic_name} carries {self.msg_type.TYPE}, not {message!r}"
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
        """A message has arrived, in whatever thread."""
        node = self._node
        with node._lock:
            if node._gone:
                return
            if len(self._queue) >= self.qos_profile.depth:
                self._queue.popleft()
                node._inbox.remove(self)
                self.dropped += 1
            self._queue.append(message)
            node._inbox.append(self)
        node._wake.set()

    def _next(self):
        """The oldest message's call, as (callback, arguments, future)."""
        return self.callback, (self._queue.popleft(),), None


class Timer:
    def __init__(self, node: Node, period_ns: int, callback):
        self.callback, self._node, self._period = callback, node, period_ns
        self.reset()

    def reset(self) -> None:
        """Start anew: the next call comes one period from now."""
        with self._node._lock:
            self._due: float = self._node.context.clock.now().nanoseconds + self._period
        self._node._wake.set()

    def cancel(self) -> None:
        with self._node._lock:
            self._due = math.inf

    def _step(self, now: int) -> None:
        """Set the next call; ticks that were missed are skipped, the beat is kept."""
        self._due += self._period * max(1, -(-(now - self._due + 1) // self._period))


_DUE = operator.attrgetter("_due")  # of a timer [ns]; infinite once it is cancelled
_REQUESTS = 10  # that may wait for one service: a server that hangs must not collect them for ever


class Service:
    def __init__(self, node: Node, srv_type: type, name: str, callback):
        self.srv_type, self.srv_name, self.callback = srv_type, name, callback
        self._node = node
        self._queue: deque[tuple[Any, Future]] = deque()
        with node.context._lock:
            if name in node.context._services:
                raise ValueError(f"service {name} is offered already")
            node.context._services[name] = self

    def _next(self):
        """The oldest request's call, as (callback, arguments, future)."""
        request, future = self._queue.popleft()
        return self.callback, (request, self.srv_type.Response()), future

    def _put(self, request, future: Future) -> None:
        """A request has arrived, in whatever thread.

        Raises:
            RuntimeError: too many wait already.
        """
        with self._node._lock:
            if len(self._queue) >= _REQUESTS:
                for entry in [e for e in self._queue if e[1].cancelled()]:
                    self._queue.remove(entry)
                    self._node._inbox.remove(self)
            if len(self._queue) >= _REQUESTS:
                raise RuntimeError(
                    f"service {self.srv_name}: {_REQUESTS} requests wait for an answer already"
                )
            self._queue.append((request, future))
            self._node._inbox.append(self)
        self._node._wake.set()


class Client:
    def __init__(self, node: Node, srv_type: type, name: str):
        self.srv_type, self.srv_name, self._context = srv_type, name, node.context

    def service_is_ready(self) -> bool:
        return self.srv_name in self._context._services

    def call_async(self, request) -> Future:
        """Ask; the Future gets the response, or the exception that the server raised.

        Who gives up waiting cancels it: a request that is still in the queue is then not carried
        out.

        Raises:
            RuntimeError: no node offers the service, or too many requests wait for it.
        """
        future: Future = Future()
        with self._context._lock:  # so that the server is not destroyed in between
            service = self._context._services.get(self.srv_name)
            if service is None:
                raise RuntimeError(f"service {self.srv_name} is not offered by any node")
            service._put(request, future)
        return future


# --- parameters ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class FloatingPointRange:
    from_value: float
    to_value: float


@dataclass(frozen=True)
class IntegerRange:
    from_value: int
    to_value: int


@dataclass(frozen=True)
class ParameterDescriptor:
    description: str = ""
    additional_constraints: str = ""
    floating_point_range: list[FloatingPointRange] = field(default_factory=list)
    integer_range: list[IntegerRange] = field(default_factory=list)


@dataclass(frozen=True)
class Parameter:
    name: str
    value: Any = None


class ParameterError(ValueError):
    """A parameter with an unknown name, a wrong type or a value outside its range."""


def _checked(node: str, name: str, value, default, descriptor: ParameterDescriptor):
    """The value in its default's type, or ParameterError with what is allowed."""
    where = f"parameter {name} of node {node}"
    if isinstance(default, float) and type(value) is int:
        value = float(value)
    if isinstance(default, list) and isinstance(value, list):
        if default and isinstance(default[0], float):
            value = [float(v) if type(v) is int else v for v in value]
        if default and any(type(v) is not type(default[0]) for v in value):
            kind = type(default[0]).__name__
            raise ParameterError(f"{where} = {value!r}: must be a list of {kind}")
    elif type(value) is not type(default):
        kind = type(default).__name__
        raise ParameterError(f"{where} = {value!r}: must be of type {kind}, as {default!r} is")
    numbers = value if isinstance(value, list) else [value]
    if any(isinstance(v, float) and not math.isfinite(v) for v in numbers):
        raise ParameterError(f"{where} = {value!r}: must be finite")
    for bounds in (*descriptor.floating_point_range, *descriptor.integer_range):
        for v in value if isinstance(value, list) else [value]:
            if not bounds.from_value <= v <= bounds.to_value:
                raise ParameterError(
                    f"{where} = {v!r}: must be from {bounds.from_value} to {bounds.to_value}"
                )
    return value


# --- node ---------------------------------------------------------------------------------------


class Node:
    """A named set of callbacks, as rclpy's Node.

    Args:
        node_name: last part of its full name.
        context: the topics it sees; None: those of the process.
        cli_args: ``["--ros-args", "-r", "from:=to", ...]``; topic and service remappings.
        namespace: prefix of its relative names.
        parameter_overrides: values that win over the defaults its parameters are declared with.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str = "",
        parameter_overrides: list[Parameter] | None = None,
    ):
        self.context = context or _default_context
        self._name = node_name
        self._namespace = "/" + namespace.strip("/") if namespace.strip("/") else "/"
        self._overrides = {p.name: p.value for p in parameter_overrides or []}
        self._parameters: dict[str, Parameter] = {}
        self._lock = threading.RLock()
        self._wake = _Wake()
        # Whose message or request comes next, in the order of their arrival, one entry for each.
        self._inbox: deque[Subscription | Service] = deque()
        self._gone = False
        self._subscriptions: list[Subscription] = []
        self._timers: list[Timer] = []
        self._services: list[Service] = []
        self._publishers: list[Publisher] = []
        self._errors: dict[int, tuple[int, float]] = {}
        self._in_callback = False
        self._turns = _Turns((self,))
        self._remappings = dict(map(self._remapping, _remap_rules(cli_args or [])))

    # names

    def get_name(self) -> str:
        return self._name

    def get_namespace(self) -> str:
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        return f"{self._namespace.rstrip('/')}/{self._name}"

    def resolve_topic_name(self, topic: str) -> str:
        """Full name of a topic: namespace, private "~/" and remappings applied."""
        name = self._expand(topic)
        return self._remappings.get(name, name)

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

    def _remapping(self, rule: str) -> tuple[str, str]:
        source, _, target = rule.partition(":=")
        return self._expand(source), self._expand(target)

    # what a node is made of

    def create_publisher(self, msg_type, topic: str, qos_profile: QoSProfile | int) -> Publisher:
        publisher = Publisher(self, msg_type, self.resolve_topic_name(topic), as_qos(qos_profile))
        self._publishers.append(publisher)
        return publisher

    def create_subscription(
        self, msg_type, topic: str, callback, qos_profile: QoSProfile | int
    ) -> Subscription:
        name = self.resolve_topic_name(topic)
        subscription = Subscription(self, msg_type, name, callback, as_qos(qos_profile))
        with self._lock:
            self._subscriptions.append(subscription)
        self._wake.set()
        return subscription

    def create_timer(self, timer_period_sec: float, callback) -> Timer:
        if not timer_period_sec > 0:
            raise ValueError(f"timer_period_sec = {timer_period_sec!r}: must be above 0")
        timer = Timer(self, round(timer_period_sec * 1e9), callback)
        with self._lock:
            self._timers.append(timer)
        self._wake.set()
        return timer

    def create_service(self, srv_type, srv_name: str, callback) -> Service:
        service = Service(self, srv_type, self.resolve_topic_name(srv_name), callback)
        with self._lock:
            self._services.append(service)
        return service

    def create_client(self, srv_type, srv_name: str) -> Client:
        return Client(self, srv_type, self.resolve_topic_name(srv_name))

    def get_clock(self):
        return self.context.clock

    def get_logger(self) -> logging.Logger:
        return logging.getLogger(f"tactile_skin.{self._name}")

    def declare_parameter(
        self, name: str, value, descriptor: ParameterDescriptor | None = None
    ) -> Parameter:
        """Announce a parameter; its value is the override, or the given default.

        Raises:
            ParameterError: the override has another type, or lies outside the descriptor's range.
        """
        if name in self._parameters:
            raise ParameterError(f"parameter {name} of node {self._name} is declared twice")
        override = self._overrides.get(name, value)
        checked = _checked(self._name, name, override, value, descriptor or ParameterDescriptor())
        self._parameters[name] = Parameter(name, checked)
        return self._parameters[name]

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            raise ParameterError(f"parameter {name} of node {self._name} is not declared")
        return self._parameters[name]

    def destroy_node(self) -> None:
        """Leave all topics and services; callbacks under way finish."""
        with self.context._lock, self._lock:
            for s in self._subscriptions:
                others = self.context._subscriptions[s.topic_name]
                self.context._subscriptions[s.topic_name] = tuple(o for o in others if o is not s)
            for p in self._publishers:
                self.context._publishers[p.topic_name].remove(p)
            for service in self._services:
                del self.context._services[service.srv_name]
                for _, future in service._queue:
                    if future.set_running_or_notify_cancel():
                        future.set_exception(RuntimeError(f"{service.srv_name}: its node is gone"))
            for kept in (self._subscriptions, self._publishers, self._timers, self._services):
                kept.clear()
            self._inbox.clear()
            self._gone = True
        self._wake.set()

    # what an executor does with it

    def _until_due(self) -> float | None:
        """How long until the next timer is due [s], if there is one."""
        with self._lock:
            due = min(map(_DUE, self._timers), default=math.inf)
        if due == math.inf:
            return None
        return max(0.0, (due - self.context.clock.now().nanoseconds) / 1e9)

    def _take_timer(self, now: int):
        """The call of the timer that is due first, as (callback, arguments, future), or None."""
        with self._lock:
            timer = min(self._timers, key=_DUE, default=None)
            if timer is None or timer._due > now:
                return None
            timer._step(now)
            self._in_callback = True
            return timer.callback, (), None

    def _take_message(self):
        """The call of the oldest message or request, as (callback, arguments, future), or None."""
        with self._lock:
            if not self._inbox:
                return None
            self._in_callback = True
            return self._inbox.popleft()._next()

    def _run_ready(self, now: int) -> bool:
        """Call every message and every timer that is due at `now` [ns]; whether there was any."""
        ran = False
        while self._turns.run_one(now):
            ran = True
        return ran

    def _idle(self) -> bool:
        """Whether no message waits and no callback runs."""
        with self._lock:
            return not self._inbox and not self._in_callback

    def _call(self, callback, arguments, future: Future | None) -> None:
        try:
            if future is not None and not future.set_running_or_notify_cancel():
                return  # nobody waits for the response any more
            result = callback(*arguments)
        except (Exception, SystemExit) as error:  # a node's thread must not end silently
            self._report(callback, error)
            if future is not None:
                _settle(future.set_exception, error)
        else:
            if future is not None:
                _settle(future.set_result, result)
        finally:
            self._in_callback = False

    def _report(self, callback, error: BaseException) -> None:
        """Log an isolated callback's exception: the first in full, then one line in 5 s."""
        count, last = self._errors.get(id(callback), (0, -1e9))  # by id: it may not be hashable
        now = self.context.clock.now().nanoseconds / 1e9
        said = count == 0 or now - last >= 5.0
        self._errors[id(callback)] = count + 1, now if said else last
        if not said:
            return
        try:
            name = getattr(callback, "__qualname__", None) or repr(callback)
            if count == 0:
                self.get_logger().error("callback %s raised", name, exc_info=error)
            else:
                self.get_logger().error("callback %s raised %d times: %r", name, count + 1, error)
        except (Exception, SystemExit) as broken:  # of a log handler: it must not end the thread
            _complain(f"node {self._name}: {type(error).__name__}", broken)

    @property
    def callback_errors(self) -> int:
        """Number of exceptions that callbacks of this node have raised."""
        return sum(count for count, _ in self._errors.values())


def _settle(settle, value) -> None:
    """Give a Future its result, whatever a listener to it or a log handler raises."""
    try:
        settle(value)
    except (Exception, SystemExit) as broken:
        _complain("the answer of a service", broken)


def _complain(what: str, broken: BaseException) -> None:
    """What could not be logged goes to stderr, if there is one."""
    with contextlib.suppress(Exception):
        print(f"{what}, and {type(broken).__name__} while that was told", file=sys.stderr)


def _remap_rules(cli_args: list[str]) -> list[str]:
    rules, rest = [], list(cli_args)
    while rest:
        word = rest.pop(0)
        if word == "--ros-args":
            continue
        if word not in ("-r", "--remap") or not rest or ":=" not in rest[0]:
            raise ValueError(f"cli_args: {word!r}: only '-r from:=to' is understood")
        if rest[0].startswith("__"):
            raise ValueError(f"cli_args: {rest[0]!r}: only topics and services can be remapped")
        rules.append(rest.pop(0))
    return rules


# --- executors ----------------------------------------------------------------------------------


class _Wake:
    """An Event for the one thread that waits on it: a lock does, and costs less."""

    def __init__(self):
        self._unset = threading.Lock()
        self._unset.acquire()

    def set(self) -> None:
        if self._unset.locked():
            try:
                self._unset.release()
            except RuntimeError:
                return  # another thread was faster

    def clear(self) -> None:
        self._unset.acquire(blocking=False)

    def wait(self, timeout_sec: float | None) -> None:
        """Wait until set, and clear it."""
        self._unset.acquire(timeout=-1 if timeout_sec is None else timeout_sec)


class _Turns:
    """What is due of nodes that share a thread, one call after the other.

    Timers and messages take turns, so that neither keeps the other waiting for more than one call,
    however slow: a timer whose callback takes longer than its period is always due.
    """

    def __init__(self, nodes: tuple[Node, ...]):
        self._nodes, self._timer_was_last = nodes, False  # of one context: their clock is one

    def run_one(self, now: int | None = None) -> bool:
        """Call one thing that is due; whether there was one.

        Of timers that which has waited longest; of messages one of the latest stage that has any.

        Args:
            now: time until which timers count as due [ns]; None: until now.
        """
        if self._timer_was_last:
            found = self._message() or self._timer(now)
        else:
            found = self._timer(now) or self._message()
        if found is None:
            return False
        node, job = found
        node._call(*job)
        return True

    def _timer(self, now: int | None):
        first, node = math.inf, None
        for each in self._nodes:
            for timer in each._timers:
                if timer._due < first:
                    first, node = timer._due, each
        if node is None:
            return None
        now = node.context.clock.now().nanoseconds if now is None else now
        if first > now or (job := node._take_timer(now)) is None:
            return None
        self._timer_was_last = True
        return node, job

    def _message(self):
        for node in reversed(self._nodes):
            if node._inbox and (job := node._take_message()) is not None:
                self._timer_was_last = False
                return node, job
        return None


class SingleThreadedExecutor:
    """Runs the callbacks of its nodes in the calling thread."""

    def __init__(self):
        self._nodes: list[Node] = []
        self._wake = _Wake()
        self._stop = False

    def add_node(self, node: Node) -> None:
        node._wake = self._wake
        self._nodes.append(node)

    def spin_some(self) -> None:
        """Call everything that is due now, what that brings about included; never waits."""
        now = self._now()
        while any([node._run_ready(at) for node, at in now]):
            pass

    def _now(self) -> list[tuple[Node, int]]:
        """Each node and its time [ns]: what becomes due while others run is not waited for."""
        return [(node, node.context.clock.now().nanoseconds) for node in self._nodes]

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Call what is due; wait for it at most so long."""
        self._wake.clear()
        if not any([node._run_ready(at) for node, at in self._now()]):
            self._wake.wait(_soonest(self._nodes, timeout_sec))
            for node, at in self._now():
                node._run_ready(at)

    def spin(self) -> None:
        """Run until `shutdown`, or until the context of the nodes goes down."""
        while not self._stop and all(node.context.ok() for node in self._nodes):
            self.spin_once(timeout_sec=0.1)

    def shutdown(self) -> None:
        self._stop = True
        self._wake.set()


class MultiThreadedExecutor:
    """A thread per node: its callbacks never overlap, and nodes never wait for each other.

    Stages of one way may share a thread: waking another one for each frame costs more than some
    stages do. The later stage goes first, so that a frame on its way is not kept by the next.
    """

    def __init__(self):
        self._threads: dict[Node, threading.Thread] = {}
        self._stop = threading.Event()

    def add_node(self, node: Node, *later: Node) -> None:
        """Start to run the node's callbacks, and those of later stages in the same thread."""
        nodes = (node, *later)
        thread = threading.Thread(
            target=self._run, args=(nodes,), name=f"node {node.get_name()}", daemon=True
        )
        for each in nodes:
            each._wake = node._wake
            self._threads[each] = thread
        thread.start()

    def _run(self, nodes: tuple[Node, ...]) -> None:
        wake, turns = nodes[0]._wake, _Turns(nodes)
        while True:
            wake.clear()
            if self._stop.is_set():
                return
            if not turns.run_one():
                wake.wait(_soonest(nodes))

    def drain(self, timeout_sec: float = 0.5) -> None:
        """Wait until no message is on its way, at most so long."""
        deadline = time.monotonic() + timeout_sec
        while not all(node._idle() for node in self._threads) and time.monotonic() < deadline:
            time.sleep(0.002)

    def shutdown(self, timeout_sec: float = 1.0) -> bool:
        """End all threads; False when a callback still hangs after the timeout."""
        self._stop.set()
        for node in self._threads:
            node._wake.set()
        deadline = time.monotonic() + timeout_sec
        for thread in self._threads.values():
            thread.join(max(0.0, deadline - time.monotonic()))
        return not any(thread.is_alive() for thread in self._threads.values())


def _soonest(nodes, timeout: float | None = None) -> float | None:
    """How long until a timer of the nodes is due [s], at most `timeout`; None: there is none."""
    waits = [wait for node in nodes if (wait := node._until_due()) is not None]
    return min(waits if timeout is None else [*waits, timeout], default=None)
