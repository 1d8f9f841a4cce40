# SPDX-License-Identifier: Apache-2.0
"""What the skin logs, written by a thread of its own: a terminal that takes nothing stops nobody.

A full pipe and a terminal after Ctrl-S keep whoever writes to them waiting: a stop hook's thread,
for one, before its next try. While a skin runs, its logger only queues; what does not fit is
dropped and counted.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import select
import threading

_KEPT = 1000  # records that wait: minutes of a hook that raises ten times a second
_POLL = 0.05  # s between two checks whether the log shall end
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


class QueuedLog(logging.Handler):
    """Stands before the handlers of a logger, its parents' included.

    Attributes:
        dropped: records that did not fit.
    """

    def __init__(self, logger: logging.Logger):
        super().__init__()
        self.dropped = 0
        self._logger, self._own, self._propagate = logger, logger.handlers, logger.propagate
        self._queue: queue.Queue[logging.LogRecord | None] = queue.Queue(_KEPT)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()
        logger.handlers, logger.propagate = [self], False

    @classmethod
    def before(cls, logger: logging.Logger) -> QueuedLog | None:
        """Stand before the logger's handlers; None: another skin's does already."""
        return None if any(isinstance(h, cls) for h in logger.handlers) else cls(logger)

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Put the logger back as it was; what waits is still written, unless nothing takes it."""
        added = [handler for handler in self._logger.handlers if handler is not self]
        self._logger.handlers, self._logger.propagate = self._own + added, self._propagate
        with contextlib.suppress(queue.Full):  # then the thread is not waiting for a record
            self._queue.put_nowait(None)
        self._thread.join(_REST_WITHIN)
        self._over.set()
        self._thread.join(2 * _POLL)
        super().close()

    def _run(self) -> None:
        reported = 0
        while not self._over.is_set() and (record := self._queue.get()) is not None:
            self._write(record)
            if self.dropped > reported:
                lost, reported = self.dropped - reported, self.dropped
                text = f"{lost} messages were dropped: the log was not written in time"
                name = self._logger.name
                self._write(logging.LogRecord(name, logging.WARNING, "", 0, text, None, None))

    def _write(self, record: logging.LogRecord) -> None:
        handlers: list[logging.Handler | None] = [*self._own]
        handlers += _above(self._logger) if self._propagate else []
        for handler in handlers or [logging.lastResort]:
            if handler is None or record.levelno < handler.level:
                continue
            # Wait here, not in the handler: it would wait with its lock held, which
            # logging.shutdown() asks for when the process ends.
            while not takes(getattr(handler, "stream", None), _POLL):
                if self._over.is_set():
                    return
            with contextlib.suppress(Exception):  # the next handler, and the next record
                handler.handle(record)


def _above(logger: logging.Logger) -> list[logging.Handler]:
    """Return the handlers that a logger's records go up to."""
    found, above = [], logger.parent
    while above is not None:
        found += above.handlers
        above = above.parent if above.propagate else None
    return found
