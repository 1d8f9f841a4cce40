"""Hooks: a robot's own functions, called when the skin says stop, and when somebody touches it.

Each has a thread of its own: one that raises or hangs delays neither the others nor the stop.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable

_SILENCE = 0.25  # s without a word from the stop node, which speaks every 0.02 s, that mean stop
_RETRY = 0.1  # s before a hook that raised is called again
_WAITING = 32  # events kept for a hook that is busy


class StopHook:
    """Calls hook(stop, reason) at each change, in a thread of its own.

    A stop that came and went while the hook was busy is still told. A hook that raises is called
    again until it returns. When the stop node falls silent the hook hears of a stop.

    Args:
        topics: names of the stop nodes that must all be free.
    """

    def __init__(self, hook: Callable[[bool, str], None], topics: list[str]):
        self._hook = hook
        self._changed = threading.Condition()
        self._words = {topic: (True, "no word from the stop node yet") for topic in topics}
        self._heard = dict.fromkeys(topics, time.monotonic())
        self._missed: str | None = None  # reason of a stop since the last call
        self._closed = False
        self._log, self._thread = _named(hook, self._run)
        self._thread.start()

    def hear(self, topic: str, stop: bool, reason: str) -> None:
        """The stop node behind `topic` decided; returns at once."""
        with self._changed:
            self._heard[topic] = time.monotonic()
            new = self._words[topic] != (stop, reason)
            self._words[topic] = (stop, reason)
            if stop and self._missed is None:
                self._missed = reason
            if new:
                self._changed.notify()

    def close(self) -> None:
        """End; what was heard before is still told, unless the hook hangs."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(1.0)

    def _now(self) -> tuple[bool, str]:
        quiet = time.monotonic() - _SILENCE
        words = [
            (True, "the stop node is silent") if self._heard[topic] < quiet else word
            for topic, word in self._words.items()
        ]
        return any(stop for stop, _ in words), " + ".join(reason for _, reason in words if reason)

    def _run(self) -> None:
        told: tuple[bool, str] | None = None
        while True:
            with self._changed:
                now = self._now()
                if not now[0] and self._missed is not None and (told is None or not told[0]):
                    now = (True, self._missed)  # it came and went since the last call
                if now == told:
                    self._missed = None if now[0] or self._closed else self._missed
                    if self._closed:
                        return
                    self._changed.wait(_SILENCE / 4)
                    continue
                self._missed = None
            try:
                self._hook(*now)
                told = now
            except BaseException:  # the hook is the robot's last resort: tell it again
                self._log.exception("raised on (%s, %r); called again in %g s", *now, _RETRY)
                with self._changed:
                    self._missed = now[1] if now[0] else self._missed
                    if self._closed:
                        return
                    self._changed.wait(_RETRY)


class EventHook:
    """Calls hook(*arguments) for each event, in their order, in a thread of its own.

    An exception is logged, and the next event told: an event, unlike a stop, is soon of the past.
    While the hook is busy the oldest events that wait are dropped, counted in `dropped`.
    """

    def __init__(self, hook: Callable):
        self._hook = hook
        self._events: deque[tuple] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self.dropped = 0
        self._log, self._thread = _named(hook, self._run)
        self._thread.start()

    def tell(self, *arguments) -> None:
        """An event happened; returns at once."""
        with self._changed:
            if len(self._events) >= _WAITING:
                self._events.popleft()
                self.dropped += 1
            self._events.append(arguments)
            self._changed.notify()

    def close(self) -> None:
        """End; what was told before is still passed on, unless the hook hangs."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(1.0)

    def _run(self) -> None:
        reported = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._events or self._closed)
                if not self._events:
                    return
                arguments, dropped = self._events.popleft(), self.dropped
            if dropped > reported:
                self._log.warning("was busy and missed %d events", dropped - reported)
                reported = dropped
            try:
                self._hook(*arguments)
            except BaseException:  # its thread must live on
                self._log.exception("raised")


def _named(hook: Callable, run: Callable[[], None]) -> tuple[logging.Logger, threading.Thread]:
    """Log and thread of a hook, both named after it."""
    name = getattr(hook, "__qualname__", repr(hook))
    thread = threading.Thread(target=run, name=f"hook {name}", daemon=True)
    return logging.getLogger(f"tactile_skin.hook.{name}"), thread
