"""Executors: which threads run the callbacks."""

from __future__ import annotations

import threading
import time

from .node import Node
from .turns import Turns, Wake


class SingleThreadedExecutor:
    """Runs the callbacks of its nodes in the calling thread."""

    def __init__(self):
        self._nodes: list[Node] = []
        self._wake = Wake()
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


def _soonest(nodes, timeout: float | None = None) -> float | None:
    """How long until a timer of the nodes is due [s], at most `timeout`; None: there is none."""
    waits = [wait for node in nodes if (wait := node._until_due()) is not None]
    return min(waits if timeout is None else [*waits, timeout], default=None)
