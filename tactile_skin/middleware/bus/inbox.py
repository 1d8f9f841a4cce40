# SPDX-License-Identifier: Apache-2.0
"""What waits for a node: its timers, and calls that others put into its queues in their threads."""

from __future__ import annotations

import concurrent.futures
import logging
import math
import operator
import threading
from collections import deque
from concurrent.futures import Future

from .context import Context

_IS_GONE = "its node is gone"
_REQUESTS = 10  # that may wait for a node: one that hangs must not collect them for ever


class Timer:
    def __init__(self, inbox: Inbox, period_ns: int, callback):
        self.callback, self._inbox, self._period = callback, inbox, period_ns
        self._due = math.inf  # ns
        with inbox._lock:
            inbox._timers.append(self)
        self.reset()

    def reset(self) -> None:
        """Count the period from now on."""
        with self._inbox._lock:
            self._due = self._inbox.context.clock.now().nanoseconds + self._period
            sooner = self._inbox._plan()
        if sooner:
            self._inbox._wake.set()

    def cancel(self) -> None:
        with self._inbox._lock:
            self._due = math.inf
            self._inbox._plan()

    def _step(self, now: int) -> None:
        """Set the next call; ticks that were missed are skipped, the beat is kept."""
        self._due += self._period * max(1, -(-(now - self._due + 1) // self._period))


_DUE = operator.attrgetter("_due")  # of a timer [ns]; infinite once it is cancelled


class Queue:
    """Calls of one callback that wait for a node's thread.

    Attributes:
        dropped: how many it has lost, since as many as its depth waited.
    """

    def __init__(self, inbox: Inbox, callback, depth: int):
        self.callback, self.dropped = callback, 0
        self._inbox, self._depth = inbox, depth
        self._waiting: deque[tuple] = deque()  # arguments, the oldest first

    def put(self, *arguments) -> None:
        """Let a call wait, in whatever thread."""
        inbox = self._inbox
        with inbox._lock:
            if inbox._gone:
                return
            if len(self._waiting) < self._depth:
                inbox._turns.append(self)
            else:  # it keeps its turn: else who publishes fast enough is never heard
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(arguments)
        inbox._wake.set()


class Inbox:
    """Whose call comes next in a node's thread, and how it is called."""

    def __init__(self, context: Context, logger: logging.Logger):
        self.context, self._logger = context, logger
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._turns: deque[Queue] = deque()  # in the order of arrival, one entry for each call
        self._timers: list[Timer] = []
        self.first_due = math.inf  # ns, when the next timer is due; infinite: there is none
        self._gone = self._in_callback = False
        self._errors: dict[int, tuple[int, float]] = {}
        self._asked = Queue(self, self._answer, _REQUESTS)

    def ask(self, callback, *arguments) -> Future:
        """Let a call wait, in whatever thread; the Future gets what it returns, or raises.

        Who gives up waiting cancels it: what has not begun by then is not carried out.

        Raises:
            RuntimeError: too many wait, or the node is gone.
        """
        future: Future = Future()
        with self._lock:
            if self._gone:
                raise RuntimeError(_IS_GONE)
            waiting = self._asked._waiting
            if len(waiting) >= _REQUESTS:
                for call in [call for call in waiting if call[-1].cancelled()]:
                    waiting.remove(call)
                    self._turns.remove(self._asked)
            if len(waiting) >= _REQUESTS:
                raise RuntimeError(f"{_REQUESTS} requests wait for an answer already")
            self._asked.put(callback, arguments, future)
        return future

    def _answer(self, callback, arguments: tuple, future: Future) -> None:
        if not future.set_running_or_notify_cancel():
            return  # nobody waits for it any more
        try:
            future.set_result(callback(*arguments))
        except (Exception, SystemExit) as error:
            self._report(callback, error)
            future.set_exception(error)

    def _leave(self) -> None:
        """Call nothing any more; who waits for an answer hears of it."""
        for *_, future in self._asked._waiting:
            if future.set_running_or_notify_cancel():
                future.set_exception(RuntimeError(_IS_GONE))
        for kept in (self._asked._waiting, self._timers, self._turns):
            kept.clear()
        self._plan()
        self._gone = True

    def _plan(self) -> bool:
        """Note when the next timer is due, and return whether that is sooner than it was."""
        before, self.first_due = self.first_due, min(map(_DUE, self._timers), default=math.inf)
        return self.first_due < before

    def _take_timer(self, now: int):
        """Return the call of the timer due first, (callback, arguments), or None."""
        with self._lock:
            if self.first_due > now:
                return None
            timer = min(self._timers, key=_DUE)
            timer._step(now)
            self._plan()
            self._in_callback = True
            return timer.callback, ()

    def _take_message(self):
        """Return the oldest message's or request's call, (callback, arguments), or None."""
        with self._lock:
            if not self._turns:
                return None
            self._in_callback = True
            queue = self._turns.popleft()
            return queue.callback, queue._waiting.popleft()

    def _idle(self) -> bool:
        """Whether no message waits and no callback runs."""
        with self._lock:
            return not self._turns and not self._in_callback

    def _call(self, callback, arguments) -> None:
        try:
            callback(*arguments)
        except (Exception, SystemExit) as error:  # a node's thread must not end silently
            self._report(callback, error)
        finally:
            self._in_callback = False

    def _report(self, callback, error: BaseException) -> None:
        """Log an isolated callback's exception: the first in full, then one line in 5 s."""
        count, last = self._errors.get(id(callback), (0, -1e9))  # by id: it may not be hashable
        now = self.context.clock.now().nanoseconds / 1e9
        said = count == 0 or now - last >= 5.0
        self._errors[id(callback)] = count + 1, now if said else last
        if not said:
            return
        name = getattr(callback, "__qualname__", None) or repr(callback)
        if count == 0:
            self._logger.error("callback %s raised", name, exc_info=error)
        else:
            self._logger.error("callback %s raised %d times: %r", name, count + 1, error)

    @property
    def callback_errors(self) -> int:
        """Number of exceptions that callbacks of this node have raised."""
        return sum(count for count, _ in tuple(self._errors.values()))


def result_of(future: Future, timeout_sec: float):
    """Return what a node was asked for, or raise what it raised.

    Raises:
        TimeoutError: no answer in time; what has not begun by then does not happen later.
    """
    try:
        return future.result(timeout_sec)
    except concurrent.futures.TimeoutError:
        if future.done():  # the node's own
            raise
        begun = "" if future.cancel() else ", but is at work on it"
        why = f"the node did not answer within {timeout_sec:g} s{begun}"
        raise TimeoutError(why) from None
