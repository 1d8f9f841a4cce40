# SPDX-License-Identifier: Apache-2.0
"""Services: who offers one answers in its own thread, and who asks waits as long as it likes."""

from __future__ import annotations

import concurrent.futures
import functools
from concurrent.futures import Future
from typing import Any

from .context import Context
from .inbox import Inbox, Queue

_REQUESTS = 10  # that may wait for one service: a server that hangs must not collect them for ever


class Service(Queue):
    """Requests that wait for a node, each with the Future of its answer."""

    def __init__(self, inbox: Inbox, srv_type: Any, name: str, callback):
        @functools.wraps(callback)
        def answer(request, future: Future) -> None:
            if future.set_running_or_notify_cancel():  # else nobody waits for it any more
                try:
                    future.set_result(callback(request, srv_type.Response()))
                except (Exception, SystemExit) as error:
                    future.set_exception(error)
                    raise

        super().__init__(inbox, answer, _REQUESTS)
        self.srv_type, self.srv_name = srv_type, name
        with inbox.context._lock:
            if name in inbox.context._services:
                raise ValueError(f"service {name} is offered already")
            inbox.context._services[name] = self

    def ask(self, request, future: Future) -> None:
        """Take a request, in whatever thread; RuntimeError: too many wait."""
        with self._inbox._lock:
            if len(self._waiting) >= _REQUESTS:
                for entry in [e for e in self._waiting if e[1].cancelled()]:
                    self._waiting.remove(entry)
                    self._inbox._turns.remove(self)
            if len(self._waiting) >= _REQUESTS:
                raise RuntimeError(
                    f"service {self.srv_name}: {_REQUESTS} requests wait for an answer already"
                )
            self.put(request, future)

    def end(self) -> None:
        """Tell who still waits that nobody answers."""
        for _, future in self._waiting:
            if future.set_running_or_notify_cancel():
                future.set_exception(RuntimeError(f"{self.srv_name}: its node is gone"))


class Client:
    def __init__(self, context: Context, srv_type: type, name: str):
        self.srv_type, self.srv_name, self._context = srv_type, name, context

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
            service.ask(request, future)
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
