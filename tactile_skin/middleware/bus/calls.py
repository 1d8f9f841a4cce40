# SPDX-License-Identifier: Apache-2.0
"""What calls a node besides messages: timers, and services that others ask."""

from __future__ import annotations

import concurrent.futures
import math
import operator
from collections import deque
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .node import Node


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


DUE = operator.attrgetter("_due")  # of a timer [ns]; infinite once it is cancelled
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
        """Return the oldest request's call, as (callback, arguments, future)."""
        request, future = self._queue.popleft()
        return self.callback, (request, self.srv_type.Response()), future

    def _put(self, request, future: Future) -> None:
        """Take a request that has arrived, in whatever thread; RuntimeError: too many wait."""
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

    def call(self, request, timeout_sec: float):
        """Ask, and return the response, or raise what the server raised.

        Raises:
            RuntimeError: as `call_async`.
            TimeoutError: no answer in time; what has not begun by then does not happen later.
        """
        future = self.call_async(request)
        try:
            return future.result(timeout_sec)
        except concurrent.futures.TimeoutError:
            if future.done():  # the server's own
                raise
            begun = "" if future.cancel() else ", but is at work on it"
            why = f"the node did not answer within {timeout_sec:g} s{begun}"
            raise TimeoutError(why) from None
