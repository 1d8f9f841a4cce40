# SPDX-License-Identifier: Apache-2.0
"""What the caller of launch.Skin hears of its nodes: hooks, and the newest reading."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

from ...behaviours.hooks import EventHook, StopHook
from ...errors import LaunchError
from ...middleware.bus import Context, MultiThreadedExecutor, Node
from ...middleware.package import BODY
from ...middleware.plan import Plan
from ...msg import DiagnosticArray
from ...touch.events import Event, Gestured, Pushed, Released, Stroked

if TYPE_CHECKING:  # else where they are used: they need SciPy, half of a skin's start
    from .latest import Latest, Snapshot

NOT_YET = "not running yet: call this within `with`, which starts the nodes"


class Listening:
    """The nodes of a plan, as who started them hears them."""

    def __init__(self, plan: Plan, context: Context):
        self._plan, self._context = plan, context
        self._executor = MultiThreadedExecutor()
        self._handles: list[Node] = []
        self._hooks: list[StopHook | EventHook] = []
        self._latest: dict[str, Latest] = {}
        self._began = False

    def on_stop(self, hook: Callable[[bool, str], None], heartbeat: float | None = None) -> None:
        """Call hook(stop, reason) now and at each change, in a thread of its own: see hooks.py.

        With several stop nodes, any of them stops; of a body it is the body's.

        Args:
            heartbeat: call it at least this often, also while nothing changes [s], so that what
                drives the motors can stop them when this process is killed or hangs.

        Raises:
            LaunchError: the launch file starts no stop_on_push.
            ValueError: `hook` cannot take these, or `heartbeat` is not above 0, or not finite.
        """
        from ..stop_on_push import STATUS, stop_message_of

        topics = self._stop_topics()

        def now() -> float:
            return self._context.clock.now().nanoseconds / 1e9

        stop_hook = StopHook(hook, topics, now, heartbeat)
        self._hooks.append(stop_hook)
        node = Node(f"stop_hook_{len(self._hooks)}", context=self._context)

        def on_status(topic: str, message: DiagnosticArray) -> None:
            stop_hook.hear(topic, stop_message_of(message, now()))

        for topic in topics:
            take = functools.partial(on_status, topic)
            node.create_subscription(DiagnosticArray, topic, take, STATUS)
        self._executor.add_node(node)

    def on_push(self, hook: Callable) -> None:
        """Call hook(force, centre) when a push begins, in a thread of its own: see events.py.

        force: (3,) [N], on the robot; centre: (3,) [m]; both in the base frame.
        With several stop nodes, each has its pushes; of a body they are the body's.

        Raises:
            LaunchError: the launch file starts no stop_on_push.
        """
        self._on_event(hook, Pushed, "stop_on_push")

    def on_release(self, hook: Callable) -> None:
        """Call hook(seconds) when a push is over, with how long it lasted; else as `on_push`."""
        self._on_event(hook, Released, "stop_on_push")

    def on_stroke(self, hook: Callable) -> None:
        """Call hook(velocity, confidence) when a stroke along the skin begins; else as `on_push`.

        velocity: (3,) [m/s], in the base frame; confidence: 0 to 1.
        """
        self._on_event(hook, Stroked, "gesture_feature")

    def on_gesture(self, hook: Callable) -> None:
        """Call hook(gesture), a `touch.events.Gesture`, when one is named; needs gestures:=true."""
        self._on_event(hook, Gestured, "gestures")

    def _on_event(self, hook: Callable, kind: type[Event], executable: str) -> None:
        from .touch_events import LISTENERS

        bodies = self._of_kind(BODY, self._handles) if executable == "stop_on_push" else []
        nodes, listener = bodies or self._started(executable), LISTENERS[kind]
        event_hook = EventHook(hook, kind._fields)
        self._hooks.append(event_hook)

        def tell(event):
            if isinstance(event, kind):
                event_hook.tell(*event)

        for handle in nodes:
            node = self._next_to(handle, f"{kind.__name__.lower()}_hook_{len(self._hooks)}")
            listener(node, tell)
            self._executor.add_node(node)

    def _next_to(self, handle: Node, name: str) -> Node:
        """Return a node for subscriptions in a node's namespace, with its remappings."""
        here = handle.get_namespace().strip("/")
        actions = [a for a in self._plan.nodes if a.namespace.strip("/") == here]
        pairs = [pair for action in actions for pair in action.remappings]
        return Node(name, context=self._context, namespace=here, remappings=pairs)

    def latest(self, name: str = "") -> Snapshot | None:
        """Return what a skin feels by one reading, and the stop of now; None: no reading yet.

        The first call begins to listen.

        Args:
            name: namespace of the skin: in a body its name.

        Raises:
            LaunchError: no skin of this name runs.
        """
        from .latest import Latest

        if name not in self._latest:
            skins = {h.get_namespace().strip("/"): h for h in self._started("compensation")}
            if name not in skins:
                raise LaunchError(f"latest: {name!r}: must be one of {', '.join(map(repr, skins))}")
            node = self._next_to(skins[name], f"latest_{len(self._latest)}")
            self._latest[name] = Latest(node, self._stop_topics())
            self._executor.add_node(node)
        return self._latest[name].snapshot()

    def _stop_topics(self) -> list[str]:
        """Return the statuses that stop the robot: the body's, or of each skin."""
        from ..stop_on_push import STATUS_TOPIC

        stops = self._of_kind(BODY, self._handles) or self._started("stop_on_push")
        return [handle.resolve_topic_name(STATUS_TOPIC) for handle in stops]

    def _started(self, executable: str) -> list[Node]:
        """Return the nodes of a kind, of which there must be one."""
        if found := self._of_kind(executable, self._handles):
            return found
        raise LaunchError(f"the launch file starts no {executable}" if self._began else NOT_YET)

    def _of_kind(self, executable: str, of: list) -> list:
        """Of the handles, or the nodes, those of a kind."""
        return [x for x, a in zip(of, self._plan.nodes, strict=False) if a.executable == executable]
