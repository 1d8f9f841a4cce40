# SPDX-License-Identifier: Apache-2.0
"""A plain node of rclpy, in the test's own process: what it heard last, and what it says."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import defaultdict

PATIENCE = 60.0  # s, for what must happen


class Plain:
    """Use it with `with`.

    Attributes:
        heard: topic -> its messages, in the order of their arrival.
    """

    def __init__(self, env: dict[str, str], name: str = "plain"):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self._context = rclpy.Context()
        rclpy.init(
            context=self._context,
            domain_id=int(env["ROS_DOMAIN_ID"]),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.node = rclpy.create_node(name, context=self._context)
        self.heard = defaultdict(list)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def __enter__(self) -> Plain:
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self._context.try_shutdown()
        self._thread.join()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            try:
                self._executor.spin()
            except Exception:  # Jazzy's raises one of its own if it is closed as it begins to wait
                if self._context.ok():
                    raise

    def hear(self, kind: type, *topics: str) -> None:
        for topic in topics:
            self.node.create_subscription(kind, topic, self.heard[topic].append, 200)

    def last(self, topic: str):
        return self.heard[topic][-1] if self.heard[topic] else None

    def until(self, happened, what: str, graph=None) -> None:
        deadline = time.monotonic() + PATIENCE
        while not happened():
            if time.monotonic() > deadline:
                said = {n: graph.said(n)[-2000:] for n in graph.processes} if graph else ""
                raise AssertionError(f"not: {what}: {said}")
            time.sleep(0.01)
