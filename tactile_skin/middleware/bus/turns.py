# SPDX-License-Identifier: Apache-2.0
"""Which call comes next in a thread."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .node import Node


class Turns:
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
        node = min(self._nodes, key=lambda each: each._first_due())
        now = node.context.clock.now().nanoseconds if now is None else now
        if (job := node._take_timer(now)) is None:
            return None
        self._timer_was_last = True
        return node, job

    def _message(self):
        for node in reversed(self._nodes):
            if node._inbox and (job := node._take_message()) is not None:
                self._timer_was_last = False
                return node, job
        return None
