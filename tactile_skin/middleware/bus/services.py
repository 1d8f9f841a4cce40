# SPDX-License-Identifier: Apache-2.0
"""Services: who offers one answers in its own thread, and who asks waits as long as it likes."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any, NamedTuple

from .context import Context
from .inbox import Inbox, result_of


class Service(NamedTuple):
    inbox: Inbox
    srv_type: Any
    srv_name: str
    callback: Any


class Client:
    def __init__(self, context: Context, srv_type: type, name: str):
        self.srv_type, self.srv_name, self._context = srv_type, name, context

    def call_async(self, request) -> Future:
        """Ask; the Future gets the response, or the exception that the server raised.

        Who gives up waiting cancels it: a request that has not begun is then not carried out.

        Raises:
            RuntimeError: no node offers the service, or too many requests wait for its node.
        """
        with self._context._lock:  # so that the server is not destroyed in between
            offered = self._context._services.get(self.srv_name)
            if offered is None:
                raise RuntimeError(f"service {self.srv_name} is not offered by any node")
            try:
                return offered.inbox.ask(offered.callback, request, offered.srv_type.Response())
            except RuntimeError as error:
                raise RuntimeError(f"service {self.srv_name}: {error}") from None

    def call(self, request, timeout_sec: float):
        """Ask, and return the response, or raise what the server raised.

        Raises:
            RuntimeError: as `call_async`.
            TimeoutError: no answer in time; what has not begun by then does not happen later.
        """
        return result_of(self.call_async(request), timeout_sec)
