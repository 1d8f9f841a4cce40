"""Hooks: a robot's own functions, called when the skin says stop, and when somebody touches it.

Each has a thread of its own: one that raises or hangs delays neither the others nor the stop.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable

from .stop import Word

_SILENCE = 0.25  # s without a word from the stop node, which speaks every 0.02 s, that mean stop
_RETRY = 0.1  # s before a hook that raised is called again
_LOOK = 0.05  # s between two looks at the clock, at most
_WAITING = 32  # events kept for a hook that is busy
_LAST_WORD = "the skin shuts down"


class StopWords:
    """What the stop nodes last said, and what it is worth: pure, all times are of one clock [s].

    Args:
        topics: names of the stop nodes that must all be free.
        t: when they could speak first.
    """

    def __init__(self, topics: list[str], t: float):
        self._words = {topic: (t, Word(True, "no word from the stop node yet")) for topic in topics}

    def hear(self, t: float, topic: str, word: Word) -> bool:
        """The stop node behind `topic` said this; whether it is another word than before."""
        before, self._words[topic] = self._words[topic][1], (t, word)
        return before[:2] != word[:2]

    def at(self, t: float) -> tuple[bool, str]:
        """Stop, and why: any of them stops, one that is silent, and a free that has run out."""
        words = [
            word.at(t) if 0.0 <= t - heard <= _SILENCE else Word(True, "the stop node is silent")
            for heard, word in self._words.values()
        ]
        return any(w.stop for w in words), " + ".join(w.reason for w in words if w.reason)

    def next(self, t: float) -> float:
        """When the words change by themselves, if nobody speaks; inf: not after t."""
        times = [
            time for heard, word in self._words.values() for time in (heard + _SILENCE, word.until)
        ]
        return min((time for time in times if time >= t), default=math.inf)


class StopHook:
    """Calls hook(stop, reason) at each change, in a thread of its own.

    A stop that came and went while the hook was busy is still told. A hook that raises is called
    again until it returns. When the stop node falls silent, or its last free rests on an old
    reading, the hook hears of a stop. Its last word is stop.

    Args:
        topics: names of the stop nodes that must all be free.
        clock: that the readings are stamped by; `now().nanoseconds`.
        heartbeat: the hook is called at least this often, also without a change [s]; None: only
            at changes.
    """

    def __init__(
        self,
        hook: Callable[[bool, str], None],
        topics: list[str],
        clock,
        heartbeat: float | None = None,
    ):
        if heartbeat is not None and not 0.0 < heartbeat < math.inf:
            raise ValueError(f"heartbeat = {heartbeat!r} s: must be above 0, and finite")
        self._hook, self._clock = hook, clock
        self._heartbeat = math.inf if heartbeat is None else heartbeat
        self._changed = threading.Condition()
        self._words = StopWords(topics, self._now())
        self._missed: str | None = None  # reason of a stop since the last call
        self._closed = False
        self._give_up = math.inf  # monotonic time at which a hook that raises is called no more [s]
        self._log, self._thread = _named(hook, self._run)
        self._thread.start()

    def hear(self, topic: str, word: Word) -> None:
        """The stop node behind `topic` decided; returns at once."""
        with self._changed:
            new = self._words.hear(self._now(), topic, word)
            if word.stop and self._missed is None:
                self._missed = word.reason
            if new:
                self._changed.notify()

    def end(self) -> None:
        """From here on it is stop, whatever anybody says; returns at once."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def close(self, timeout: float = 1.0) -> None:
        """End, and wait until the hook has heard of the stop, at most `timeout` [s]."""
        self._give_up = time.monotonic() + timeout
        self.end()
        self._thread.join(timeout)

    def _now(self) -> float:
        return self._clock.now().nanoseconds / 1e9

    def _state(self, t: float) -> tuple[bool, str]:
        stop, reason = self._words.at(t)
        return (
            (True, " + ".join(filter(None, [reason, _LAST_WORD])))
            if self._closed
            else (stop, reason)
        )

    def _run(self) -> None:
        told: tuple[bool, str] | None = None
        due = math.inf  # when the hook is called also without a change
        while True:
            with self._changed:
                t = self._now()
                now = self._state(t)
                if not now[0] and self._missed is not None and (told is None or not told[0]):
                    now = (True, self._missed)  # it came and went since the last call
                if now == told and (self._closed or t < due):
                    if self._closed:
                        return
                    self._missed = None if now[0] else self._missed
                    soon = min(self._words.next(t), due) - t
                    self._changed.wait(min(max(soon, 0.001), _LOOK))
                    continue
                self._missed = None
            try:
                self._hook(*now)
                told, due = now, t + self._heartbeat
            except BaseException:  # the hook is the robot's last resort: tell it again
                if time.monotonic() >= self._give_up:
                    return
                self._log.exception("raised on (%s, %r); called again in %g s", *now, _RETRY)
                with self._changed:
                    self._missed = now[1] if now[0] else self._missed
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

    def close(self, timeout: float = 1.0) -> None:
        """End; what was told before is still passed on, for at most `timeout` [s]."""
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
                self._hook(*arguments)
            except BaseException:  # its thread must live on
                self._log.exception("raised")


def _named(hook: Callable, run: Callable[[], None]) -> tuple[logging.Logger, threading.Thread]:
    """Log and thread of a hook, both named after it."""
    name = getattr(hook, "__qualname__", repr(hook))
    thread = threading.Thread(target=run, name=f"hook {name}", daemon=True)
    return logging.getLogger(f"tactile_skin.hook.{name}"), thread
