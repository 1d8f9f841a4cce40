"""Which call comes next in a thread, and how it waits for one."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .node import Node


class Wake:
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
