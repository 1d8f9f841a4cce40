# SPDX-License-Identifier: Apache-2.0
"""A stop hook that notes what it is told."""

import threading

from support.patience import PATIENCE


class Told:
    """Attributes: `calls`, (stop, reason) of each call."""

    def __init__(self):
        self.calls, self._news = [], threading.Condition()

    def __call__(self, stop, reason):
        with self._news:
            self.calls.append((stop, reason))
            self._news.notify_all()

    def wait_for(self, call, times=1) -> None:
        self._until(lambda: self.calls.count(call) >= times)

    def wait_for_reason(self, reason) -> None:
        self._until(lambda: any(reason in said for _, said in self.calls))

    def wait_for_start(self, reason) -> None:
        self._until(lambda: any(said.startswith(reason) for _, said in self.calls))

    def _until(self, happened) -> None:
        with self._news:
            assert self._news.wait_for(happened, PATIENCE), self.calls
