# SPDX-License-Identifier: Apache-2.0
"""SIGINT, SIGTERM and SIGHUP end a skin in order, so that its final message is a stop.

Handlers are installed from the skin's start to its final message, in the main thread, and only
where the user has not installed one. The first signal makes `spin` return; in a user's own loop it
raises KeyboardInterrupt (SIGINT) or SystemExit(128 + number), which unwinds the `with` block. More
signals within a second do nothing: an exception during the shutdown would skip the final stop.
"""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any

_NUMBERS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
# s: a signal so soon after another is of the same wish (two Ctrl-C, a service manager's pair): as
# long as a skin may take to end. A later one counts again, for a program that went on.
_SAME_WISH = 1.0


class Signals:
    """What the process does at a signal; there is one of these, `SIGNALS`, as there is one handler.

    A handler runs between two instructions of the main thread. It only sets attributes or raises:
    an Event's lock, for one, may be held by the very code that it interrupts.

    Attributes:
        asked: the signal that ended a `spin`, until the last skin has ended.
    """

    def __init__(self):
        self.asked: int | None = None
        self._skins = 0
        self._before: dict[int, Any] = {}
        self._spinning = False
        self._deferred: set[CodeType] = {Signals.enter.__code__, Signals.leave.__code__}
        self._pending: int | None = None  # came where none may raise
        self._acted = -math.inf  # monotonic time of the last signal that was acted on [s]

    def deferred(self, function: Callable) -> Callable:
        """Decorate a function in which no signal raises, from its very first instruction.

        `raise_pending` acts on what came meanwhile.
        """
        self._deferred.add(function.__code__)
        return function

    @property
    def acted(self) -> bool:
        """Whether a signal has asked for the end since the first skin began."""
        return self._acted > -math.inf or self._pending is not None

    def enter(self) -> None:
        """Begin a skin: install handlers where Python's or the system's default ones stand."""
        if not self._skins:
            self.asked = self._pending = None
            self._acted = -math.inf
        self._skins += 1
        if threading.current_thread() is not threading.main_thread():
            return
        for number in _NUMBERS:
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                self._before[number] = signal.signal(number, self._on_signal)

    def leave(self) -> None:
        """End a skin: after the last one the previous handlers are restored."""
        self._skins -= 1
        if self._skins or threading.current_thread() is not threading.main_thread():
            return
        for number, handler in self._before.items():
            if signal.getsignal(number) == self._on_signal:  # else the user has taken it over
                signal.signal(number, handler)
        self._before.clear()
        self.asked = None

    @contextlib.contextmanager
    def spinning(self):
        """While the main thread waits in `spin`, a signal sets `asked`, and raises nothing."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before, self._spinning = self._spinning, True
        try:
            yield
        finally:
            self._spinning = before

    def raise_pending(self) -> None:
        """Act on a signal that came in a deferred function."""
        number, self._pending = self._pending, None
        if number is not None:
            self._acted = time.monotonic()
            raise unwinding(number)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if now - self._acted < _SAME_WISH:
            return
        while frame is not None:
            if frame.f_code in self._deferred:
                self._pending = number
                return
            frame = frame.f_back
        self._acted = now
        if self._spinning:
            self.asked = number
        else:
            raise unwinding(number)


def unwinding(number: int) -> BaseException:
    """Return the exception that ends a program in the way of this signal."""
    return KeyboardInterrupt() if number == signal.SIGINT else SystemExit(128 + number)


SIGNALS = Signals()
