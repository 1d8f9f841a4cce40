# SPDX-License-Identifier: Apache-2.0
"""foxglove: all topics, live, for the Foxglove app."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque

from ...errors import LaunchError
from ...middleware.config import declared
from ...parameters.nodes import Foxglove as Parameters
from ...recording import cdr
from .. import diagnostics

_TURN = 1.0 / 30.0  # s between two messages of a topic: fast enough to look at
_NODES = 50  # messages of `diagnostics`, one from each node, that may wait together


class Foxglove:
    """Serves the topics of its process to the Foxglove app.

    Serves every topic of its process, also those that appear later, by foxglove-sdk's WebSocket
    server, with the schemas that a recording has: the newest message of each, 30 times a second,
    and all of `diagnostics`. What no app has subscribed to costs nothing; the rest is encoded by a
    thread of this node's own, as much of it at 390 readings a second as at 30.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        host, port = given.host, given.port
        try:
            import foxglove
        except ModuleNotFoundError as error:
            raise LaunchError(
                "foxglove needs foxglove-sdk: pip install 'tactile_skin[foxglove]'"
            ) from error
        logging.getLogger("foxglove").setLevel(logging.WARNING)  # who comes and goes is no news
        cdr.check()
        self._sdk, self._context = foxglove, foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="tactile_skin", host=host, port=port, context=self._context
            )
        except RuntimeError as error:
            raise LaunchError(
                f"foxglove on {host}, port {port}: {error}: set host and port of the node foxglove"
            ) from error
        self.address = f"ws://{host}:{self._server.port}"
        self._heard: set[str] = set()
        self._refused: set[str] = set()
        self._newest: dict[str, deque] = {}  # topic -> (channel, when [ns], message)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="foxglove", daemon=True)
        self._thread.start()
        self._listen()
        node.create_timer(1.0, self._listen)
        node.get_logger().info("open a connection in Foxglove: %s", self.address)

    def _listen(self) -> None:
        """Make a channel for each topic that is new."""
        for topic, kind in cdr.new_topics(self.node, self._heard):
            schema = self._sdk.Schema(
                name=kind.TYPE, encoding=cdr.SCHEMAS, data=cdr.definition(kind).encode()
            )
            channel = self._sdk.Channel(
                topic, schema=schema, message_encoding=cdr.MESSAGES, context=self._context
            )
            self._tap(kind, topic, channel)

    def _tap(self, kind: type, topic: str, channel) -> None:
        count = _NODES if topic.endswith(diagnostics.ALL) else 1
        waiting = self._newest[topic] = deque(maxlen=count)

        def take(message) -> None:
            if channel.has_sinks():  # somebody has subscribed
                waiting.append((channel, self.node.get_clock().now().nanoseconds, message))

        self.node.create_tap(kind, topic, take)

    def _run(self) -> None:
        while not self._closing.wait(_TURN):
            self._send()

    def _send(self) -> None:
        for topic, waiting in tuple(self._newest.items()):
            while waiting:
                channel, t, message = waiting.popleft()
                try:
                    channel.log(cdr.encode(message), log_time=t)
                except Exception as error:  # of a field of a wrong type: the other topics go on
                    if topic not in self._refused:
                        self._refused.add(topic)
                        self.node.get_logger().warning("%s is not shown: %r", topic, error)
                time.sleep(0)  # hands the interpreter to who waits for it: the stop, say

    def close(self) -> None:
        self._closing.set()
        self._server.stop()
