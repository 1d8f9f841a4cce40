# SPDX-License-Identifier: Apache-2.0
"""Hooks: a robot's own functions, called when the skin says stop, and when somebody touches it.

Each has a thread of its own: one that raises or hangs delays neither the others nor the stop.
"""

from __future__ import annotations

import contextlib
import inspect
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from .stop import StopMessage

_SILENCE = 0.25  # s without a message of the stop node, which publishes every 0.02 s: stop
_RETRY = 0.1  # s before a hook that raised is called again
_CHECK_PERIOD = 0.05  # s, at most, between two checks of the clock
_WAITING = 32  # events kept for a hook that is busy
_FINAL_REASON = "the skin shuts down"


class StopMessages:
    """The last message of each stop node, all of which must be free; times are of one clock [s]."""

    def __init__(self, topics: list[str], t: float):
        self._messages = {
            topic: (t, StopMessage(True, "no message from the stop node yet")) for topic in topics
        }

    def hear(self, t: float, topic: str, message: StopMessage) -> bool:
        """Take what the stop node behind `topic` said; return whether that is new."""
        before, self._messages[topic] = self._messages[topic][1], (t, message)
        return before[:2] != message[:2]

    def at(self, t: float) -> tuple[bool, str]:
        """Stop, and why: any of them stops, one that is silent, and a free that has run out."""
        messages = [
            message.at(t)
            if 0.0 <= t - heard <= _SILENCE
            else StopMessage(True, "no message from the stop node")
            for heard, message in self._messages.values()
        ]
        return any(m.stop for m in messages), " + ".join(m.reason for m in messages if m.reason)

    def next(self, t: float) -> float:
        """When `at` changes without a message; inf: not after t."""
        times = [
            time
            for heard, message in self._messages.values()
            for time in (heard + _SILENCE, message.until)
        ]
        return min((time for time in times if time >= t), default=math.inf)


class StopHook:
    """Calls hook(stop, reason) at each change, in a thread of its own.

    A stop that came and went while the hook was busy is still reported. A hook that raises is
    called again until it returns. When the stop node falls silent, or its last "free" is based on
    an old reading, the hook is called with a stop. Its last call is a stop.

    Args:
        topics: names of the stop nodes that must all be free.
        now: the time by which the readings are stamped [s].
        heartbeat: the hook is called at least this often [s]; None: only at changes.
    """

    def __init__(
        self,
        hook: Callable[[bool, str], None],
        topics: list[str],
        now: Callable[[], float],
        heartbeat: float | None = None,
    ):
        check_callable(hook, ("stop", "reason"))
        number = isinstance(heartbeat, (int, float))
        if heartbeat is not None and not (number and 0.0 < heartbeat < math.inf):
            raise ValueError(f"heartbeat = {heartbeat!r} s: must be above 0, and finite")
        self._hook, self._now = hook, now
        self._heartbeat = math.inf if heartbeat is None else heartbeat
        self._changed = threading.Condition()
        self._messages = StopMessages(topics, self._now())
        self._missed: str | None = None  # reason of a stop since the last call
        self._closed = False
        self._give_up = math.inf  # monotonic time at which a hook that raises is called no more [s]
        self._log, self._thread = _named(hook, self._run)
        self._thread.start()

    def hear(self, topic: str, message: StopMessage) -> None:
        """Take a decision of the stop node behind `topic`; return at once."""
        with self._changed:
            new = self._messages.hear(self._now(), topic, message)
            if message.stop and self._missed is None:
                self._missed = message.reason
            if new:
                self._changed.notify()

    def end(self) -> None:
        """From here on it is a stop, whatever the messages say; returns at once."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def close(self, timeout: float = 1.0) -> None:
        """End, and wait until the hook has heard of the stop, at most `timeout` [s]."""
        self._give_up = time.monotonic() + timeout
        self.end()
        self._thread.join(timeout)

    def _state(self, t: float) -> tuple[bool, str]:
        stop, reason = self._messages.at(t)
        if self._closed:
            return True, " + ".join(filter(None, [reason, _FINAL_REASON]))
        return stop, reason

    def _run(self) -> None:
        last_call: tuple[bool, str] | None = None
        due = math.inf  # when the hook is called also without a change
        while True:
            with self._changed:
                t = self._now()
                now = self._state(t)
                said = last_call is not None and last_call[0]
                if not now[0] and not said and self._missed is not None:
                    now = (True, self._missed)  # it came and went since the last call
                if now == last_call and (self._closed or t < due):
                    if self._closed:
                        return
                    self._missed = None if now[0] else self._missed
                    soon = min(self._messages.next(t), due) - t
                    self._changed.wait(min(max(soon, 0.001), _CHECK_PERIOD))
                    continue
                self._missed = None
            try:
                _call(self._hook, now)
                last_call, due = now, t + self._heartbeat
            except BaseException:  # the hook is the robot's last resort: call it again
                if time.monotonic() >= self._give_up:
                    return
                last_call = None  # it may have done half of this one
                with contextlib.suppress(Exception):  # of a handler of the log
                    self._log.exception("raised on (%s, %r); called again in %g s", *now, _RETRY)
                with self._changed:
                    self._missed = now[1] if now[0] else self._missed
                    self._changed.wait(_RETRY)


class EventHook:
    """Calls hook(*arguments) for each event, in their order, in a thread of its own.

    An exception is logged, and the next event passed on. While the hook is busy the oldest events
    that wait are dropped, counted in `dropped`.

    Args:
        arguments: their names, that the hook must be able to take.
    """

    def __init__(self, hook: Callable[..., object], arguments: Sequence[str]):
        check_callable(hook, arguments)
        self._hook = hook
        self._events: deque[tuple[object, ...]] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self.dropped = 0
        self._log, self._thread = _named(hook, self._run)
        self._thread.start()

    def tell(self, *arguments: object) -> None:
        """Take an event that happened; return at once."""
        with self._changed:
            if len(self._events) >= _WAITING:
                self._events.popleft()
                self.dropped += 1
            self._events.append(arguments)
            self._changed.notify()

    def close(self, timeout: float = 1.0) -> None:
        """End; earlier events are still passed on, for at most `timeout` [s]."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(timeout)

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
                _call(self._hook, arguments)
            except BaseException:  # its thread must live on
                self._log.exception("raised")


def check_callable(hook: object, arguments: Sequence[str]) -> None:
    """Refuse a hook that cannot be called with these arguments: it would fail when it is needed.

    Raises:
        ValueError: it is no function, one of other arguments, or `async`, which nothing awaits.
    """
    wanted = f"hook {hook!r}: must be a function of ({', '.join(arguments)})"
    if not callable(hook):
        raise ValueError(f"{wanted}: give it by its name, do not call it")
    if inspect.iscoroutinefunction(hook):
        raise ValueError(f"{wanted} that is not async: nothing awaits it")
    try:
        signature = inspect.signature(hook)
    except ValueError:  # of some that are written in C
        return
    try:
        signature.bind(*arguments)
    except TypeError as error:
        raise ValueError(f"{wanted}: {error}") from None


def _call(hook: Callable[..., object], arguments: tuple[object, ...]) -> None:
    if inspect.iscoroutine(returned := hook(*arguments)):
        returned.close()
        raise TypeError("returned a coroutine, which nothing awaits: nothing was done")


def _named(
    hook: Callable[..., object], run: Callable[[], None]
) -> tuple[logging.Logger, threading.Thread]:
    """Log and thread of a hook, both named after it."""
    name = getattr(hook, "__qualname__", repr(hook))
    thread = threading.Thread(target=run, name=f"hook {name}", daemon=True)
    return logging.getLogger(f"tactile_skin.hook.{name}"), thread
