# SPDX-License-Identifier: Apache-2.0
"""The process of a skin's nodes: middleware/process.py starts it, and hears it."""

from __future__ import annotations

import contextlib
import math
import os
import socket
import sys
import time
from functools import partial
from logging import LogRecord, getLogger
from logging.handlers import QueueHandler
from typing import Any

from ..middleware import process
from ..middleware.bus import Context, Node, Parameter
from ..middleware.bus.inbox import result_of
from ..middleware.package import PACKAGE
from ..middleware.plan import NodeAction, Plan
from . import Skin

_WITHIN = 2.0  # s for an answer of a node: less than who asks waits


class Served(Skin):
    """A skin whose topics, services and parameters another process has the use of."""

    def __init__(self, line: process.Line, start: process.Start):
        super().__init__(Plan(start.nodes), Context(start.clock))
        self.line, self._again = line, start.again
        self._elsewhere.add(self.node)  # it says nothing of itself
        self._relays: dict[str, Node] = {}
        self.began = math.inf  # s of the day; what nodes log before, those that stand for them do
        logger = getLogger(PACKAGE)
        logger.setLevel(start.level)
        logger.propagate, logger.handlers = False, [_Log(self)]

    def build(self) -> list[Node]:
        super().build()
        for stop in self._of_kind("stop_on_push", self._nodes) if self._again else []:
            stop.resume(self._again)
        return self._handles

    def _make_node(self, action: NodeAction) -> Node:
        node = super()._make_node(action)
        node.waits = bool(self._again)  # for a board that was there
        return node

    def serve(self) -> None:
        """Do what the other process asks for, until it is gone or asks for the end."""
        self.began = time.time()
        said, asked_by = -math.inf, os.getppid()
        with contextlib.suppress(OSError):
            while os.getppid() == asked_by:  # a fork of it would keep the line open
                if time.monotonic() - said >= process.ALIVE:
                    said = time.monotonic()
                    self.line.say(process.Alive())
                match self.line.hear():
                    case process.Hear(topics):
                        self._hear(topics)
                    case process.Published(topic, message):
                        self._publish(topic, message)
                    case process.Call(number, service, request):
                        self._answer(number, self._call, service, request)
                    case process.Change(number, node, values):
                        self._answer(number, self._change, node, values)
                    case process.End():
                        return

    def _hear(self, topics: frozenset[str]) -> None:
        for topic in self._relays.keys() - topics:
            self._relays.pop(topic).destroy_node()
        for topic in topics - self._relays.keys():
            node = self._relays[topic] = Node("relay", context=self._context)
            kind = self._context._topic_type[topic]
            node.create_listener(kind, topic, partial(self._pass_on, topic))

    def _pass_on(self, topic: str, message: Any) -> None:
        self.line.say(process.Published(topic, message))

    def _publish(self, topic: str, message: Any) -> None:
        relay = self._relays.get(topic)  # it comes from where that would send it
        for subscription in self._context._subscriptions[topic]:
            if subscription._inbox is not relay:
                subscription.put(message)

    def _answer(self, number: int, function, *arguments) -> None:
        try:
            answer, error = function(*arguments), ""
        except Exception as raised:
            answer, error = None, str(raised) or repr(raised)
        self.line.say(process.Answer(number, answer, error))

    def _call(self, service: str, request: Any) -> Any:
        kind = self._context._services[service].srv_type
        return self.node.create_client(kind, service).call(request, _WITHIN)

    def _change(self, node: str, values: dict[str, Any]) -> Any:
        handle = self._context.nodes[node]
        given = [Parameter(name, value) for name, value in values.items()]
        return result_of(handle.ask(handle.set_parameters_atomically, given), _WITHIN)


class _Log(QueueHandler):
    """Sends what is logged to the process that started this one."""

    def __init__(self, skin: Served):
        super().__init__(skin)  # type: ignore[arg-type]
        self._skin = skin

    def enqueue(self, record: LogRecord) -> None:
        if record.created >= self._skin.began:
            self._skin.line.say(record)


def main(descriptor: str) -> None:
    """Run the skin that who started this process describes."""
    line = process.Line(socket.socket(fileno=int(descriptor)), process.ALIVE, process.ALIVE)
    if (start := line.hear()) is None:
        return
    skin = Served(line, start)
    with skin:
        skin.serve()


if __name__ == "__main__":
    main(sys.argv[1])
