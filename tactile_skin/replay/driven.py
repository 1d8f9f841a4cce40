# SPDX-License-Identifier: Apache-2.0
"""The nodes of a launch file in one thread, on a clock that is driven: the same every time."""

from __future__ import annotations

from ..launch import Skin
from ..middleware.bus import Context, ManualClock, Node, SingleThreadedExecutor
from ..middleware.plan import Plan, parameters_of

_STEP = 10**14  # ns of which a float holds each


class Driven:
    """Nothing of the launch file's commands is started, and no time limit is kept by itself.

    Args:
        plan: of the nodes.
        start: what the clock shows at first [ns since 1970].

    Attributes:
        nodes: executable -> node.
        observer: for subscriptions and publishers of your own.

    Raises:
        ValueError: as Skin.build.
    """

    def __init__(self, plan: Plan, start: int):
        self._clock = ManualClock(0.0)
        context = Context(self._clock)
        self._set(start)
        self._skin = Skin(plan, context)
        self._skin.build()
        kinds = [action.executable for action in plan.nodes]
        self.nodes = dict(zip(kinds, self._skin._nodes, strict=True))
        self.observer = Node("observer", context=context)
        self._executor = SingleThreadedExecutor()
        for handle in (*self._skin._handles, self.observer):
            self._executor.add_node(handle)

    def _set(self, t: int) -> None:
        while (ahead := t - self.now()) > 0:
            self._clock.advance(min(ahead, _STEP) / 1e9)

    def now(self) -> int:
        """Return what the clock shows [ns since 1970]."""
        return self._clock.now().nanoseconds

    def until(self, t: int) -> None:
        """Let the time go by until t [ns since 1970], if it is not over; timers run."""
        self._set(t)
        self.run()

    def run(self) -> None:
        """Carry out what is due now."""
        self._executor.spin_some()

    @property
    def parameters(self) -> dict[str, dict]:
        """Full name of each node -> {parameter: value}."""
        return parameters_of(self._skin._handles)

    @property
    def errors(self) -> int:
        """Callbacks that raised."""
        return sum(handle.callback_errors for handle in self._skin._handles)

    def close(self) -> None:
        for handle in (*self._skin._handles, self.observer, self._skin.node):
            handle.destroy_node()
