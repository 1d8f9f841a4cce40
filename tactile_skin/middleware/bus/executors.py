# SPDX-License-Identifier: Apache-2.0
"""Executors: which threads run the callbacks, and which comes next in a thread."""

from __future__ import annotations

import math
import operator
import threading
import time

from .node import Node

_FIRST_DUE = operator.attrgetter("first_due")  # of a node [ns]


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
        node = min(self._nodes, key=_FIRST_DUE)
        if node.first_due == math.inf:
            return None
        now = node.context.clock.now().nanoseconds if now is None else now
        if (job := node._take_timer(now)) is None:
            return None
        self._timer_was_last = True
        return node, job

    def _message(self):
        for node in reversed(self._nodes):
            if node._turns and (job := node._take_message()) is not None:
                self._timer_was_last = False
                return node, job
        return None


class SingleThreadedExecutor:
    """Runs the callbacks of its nodes in the calling thread."""

    def __init__(self):
        self._nodes: list[tuple[Node, Turns]] = []

    def add_node(self, node: Node) -> None:
        self._nodes.append((node, Turns((node,))))

    def spin_some(self) -> None:
        """Call everything that is due now, what that brings about included; never waits.

        What becomes due while others run is not waited for.
        """
        now = [(turns, node.context.clock.now().nanoseconds) for node, turns in self._nodes]
        ran = True
        while ran:
            ran = False
            for turns, at in now:
                while turns.run_one(at):
                    ran = True


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
        wake, turns = nodes[0]._wake, Turns(nodes)
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


def _soonest(nodes: tuple[Node, ...]) -> float | None:
    """How long until a timer of the nodes is due [s]; None: there is none."""
    due = min(map(_FIRST_DUE, nodes))
    if due == math.inf:
        return None
    return max(0.0, (due - nodes[0].context.clock.now().nanoseconds) / 1e9)
