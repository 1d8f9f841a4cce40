# SPDX-License-Identifier: Apache-2.0
"""A stop hook that notes what it is told, and a wait for what happens while a skin is spun."""

import threading
import time

PATIENCE = 30.0  # s, for what must happen


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

    def _until(self, happened) -> None:
        with self._news:
            assert self._news.wait_for(happened, PATIENCE), self.calls


def spin_until(skin, happened, seen=lambda: "") -> None:
    """Spin the skin until it happened; `seen` gives what a failure shows."""
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, seen()
        skin.spin(0.02)
