# SPDX-License-Identifier: Apache-2.0
"""Waiting for what must happen; how fast it does is not tested."""

import threading
import time

PATIENCE = 60.0  # s


def until(happened, what="", between=lambda: time.sleep(0.01)) -> None:
    """Look until it happened, and do something between two looks.

    Args:
        what: what did not happen, for the failure; text, or a function that gives one.
    """
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, what() if callable(what) else f"not: {what}"
        between()


def spin_until(skin, happened, what="") -> None:
    """Spin a skin until it happened."""
    until(happened, what, lambda: skin.spin(0.02))


class Hang:
    """A callback that hangs until it is released."""

    def __init__(self):
        self._begun, self._over = threading.Semaphore(0), threading.Event()

    def __call__(self, *_) -> None:
        self._begun.release()
        self._over.wait(PATIENCE)

    def has_begun(self, times: int = 1) -> None:
        """Wait until so many calls hang."""
        for _ in range(times):
            assert self._begun.acquire(timeout=PATIENCE)

    def release(self) -> None:
        self._over.set()
