# SPDX-License-Identifier: Apache-2.0
"""What the skin logs, written by a thread of its own: a terminal that takes nothing stops nobody.

A full pipe and a terminal after Ctrl-S keep whoever writes to them waiting: a stop hook's thread,
for one, before its next try. While a skin runs, its logger only queues; what does not fit is lost.
"""

from __future__ import annotations

import contextlib
import logging
import math
import queue
import select
import time
from logging.handlers import QueueHandler, QueueListener

_KEPT = 1000  # records that wait: minutes of a hook that raises ten times a second
_POLL = 0.05  # s of one wait for a stream to take a line
_REST_WITHIN = 0.1  # s that the records still waiting have at the end


def takes(stream, timeout: float = 0.0) -> bool:
    """Whether the stream takes a line without waiting for more than `timeout` [s].

    True also where there is no telling: no file behind it, or a system without poll.
    """
    try:
        poller = select.poll()
        poller.register(stream.fileno(), select.POLLOUT)
    except (AttributeError, OSError, ValueError):
        return True
    return bool(poller.poll(timeout * 1e3))


class QueuedLog(QueueHandler):
    """Stands before the handlers of a logger, its parents' included, until it is closed."""

    def __init__(self, logger: logging.Logger):
        room: queue.Queue = queue.Queue(_KEPT)
        super().__init__(room)
        self._logger, self._own, self._propagate = logger, logger.handlers, logger.propagate
        self._skins = 1  # that log by it
        found = [*logger.handlers]
        above = logger
        while above.propagate and above.parent:
            above = above.parent
            found += above.handlers
        last = [logging.lastResort] if logging.lastResort else []
        self._writer = _Writer(room, *(found or last))
        self._writer.start()
        logger.handlers, logger.propagate = [self], False

    @classmethod
    def before(cls, logger: logging.Logger) -> QueuedLog:
        """Return what stands before the logger's handlers, one for all skins."""
        for there in logger.handlers:
            if isinstance(there, cls):
                there._skins += 1
                return there
        return cls(logger)

    def enqueue(self, record: logging.LogRecord) -> None:
        with contextlib.suppress(queue.Full):
            self.queue.put_nowait(record)

    def close(self) -> None:
        """End a skin; after the last one the logger is as it was.

        What waits then is still written, unless nothing takes it.
        """
        self._skins -= 1
        if self._skins > 0:
            return
        added = [handler for handler in self._logger.handlers if handler is not self]
        self._logger.handlers, self._logger.propagate = self._own + added, self._propagate
        self._writer.stop()
        super().close()


class _Writer(QueueListener):
    """Waits for a stream outside of its handler, whose lock logging.shutdown() asks for."""

    _until = math.inf  # monotonic time after which nothing is waited for [s]

    def __init__(self, room: queue.Queue, *handlers: logging.Handler):
        super().__init__(room, *handlers)
        self._room = room

    def handle(self, record: logging.LogRecord) -> None:
        for handler in self.handlers:
            while not takes(getattr(handler, "stream", None), min(_POLL, self._left())):
                if not self._left():
                    return
            if record.levelno >= handler.level:
                with contextlib.suppress(Exception):  # the next handler, and the next record
                    handler.handle(record)

    def _left(self) -> float:
        return max(0.0, self._until - time.monotonic())

    def stop(self) -> None:
        self._until = time.monotonic() + _REST_WITHIN
        with contextlib.suppress(queue.Full):
            self._room.put(None, timeout=_REST_WITHIN + _POLL)
        if self._thread:  # a stream may take less than a line, and hold it
            self._thread.join(_REST_WITHIN + _POLL)
