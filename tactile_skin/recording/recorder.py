# SPDX-License-Identifier: Apache-2.0
"""Messages to files by a thread of its own: a slow disk drops and counts, and delays nobody."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from ..errors import FileError
from ..msg import Message
from . import cdr
from .writer import Writer

_WAITING = 20_000  # messages that may wait for the disk: 10 s of a skin at 100 frames/s
_TURN = 0.1  # s between two looks at what waits: nobody wakes the thread for each message
_FLUSH = 0.5  # s between two ends of a chunk: what a kill loses
_AFTER = 2.0  # s that a recording of what led to a stop goes on after it
_SLICE = 2000  # messages of it that a turn writes: 10 ms of Python, then other threads get theirs


@dataclass(frozen=True)
class Limits:
    """When a recording ends, and what of it is kept."""

    duration: float = float("inf")  # [s]
    size: float = float("inf")  # of all its files together [bytes]
    last: float = 0.0  # s before each stop that are kept, and 2 s after it; 0: everything is


class _LimitError(Exception):
    """A recording is as long or as large as it may become."""


class Recorder:
    """Writes messages to a file, in a thread of its own.

    Args:
        path: file to make, .mcap is added where it has no suffix; or folder for files named after
            their time: one that is there, or a name that ends in /, which is made.
        attachments: name -> bytes.
        now: the time [ns since 1970].

    Attributes:
        trouble: why it has ended; empty while it records.
        broken: whether that was an error, a full disk say, and no limit that was asked for.
        dropped: messages that found the queue full.
        store: the files that were made, the messages in them, and their size as of the last flush.

    Raises:
        FileError, OSError: the file cannot be made.
        ModuleNotFoundError: mcap or rosbags is not installed.
    """

    def __init__(self, path, limits: Limits, attachments: dict[str, bytes], now: Callable[[], int]):
        cdr.check()
        path = _target(str(path))
        self.trouble, self.broken, self.dropped = "", False, 0
        self._now, self._closing = now, threading.Event()
        self._waiting: deque[tuple[str, int, Message]] = deque()
        store = Ring if limits.last else Whole
        self.store = store(path, limits, attachments, now())
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def put(self, topic: str, t: int, message: Message) -> None:
        """Take a message received at t [ns since 1970]; never block. For any thread."""
        if self.trouble:
            return
        if len(self._waiting) >= _WAITING:
            self.dropped += 1
        else:
            self._waiting.append((topic, t, message))

    def stop(self, t: int) -> None:
        """Keep what led to a stop at t [ns since 1970], with `limits.last`."""
        self.store.stop(t)

    def close(self, timeout: float | None = None) -> None:
        """Write what waits and end the files; wait at most `timeout` for the disk [s]."""
        self._closing.set()
        self._thread.join(timeout)

    def finish(self, stalled: float) -> None:
        """After `close`, wait for the files' end while the disk takes some; give up `stalled` [s].

        A recording of what led to a stop is written then, and that of two minutes takes seconds.
        """
        before = None
        while self._thread.is_alive() and (now := self._progress) != before:
            before = now
            self._thread.join(stalled)

    @property
    def _progress(self) -> tuple[int, int]:
        return len(self._waiting), self.store.written

    def turn(self, closing: bool = False) -> None:
        """Write what waits; on an error end, with the reason in `trouble`."""
        if self.trouble:
            return
        try:
            while self._waiting:
                topic, t, message = self._waiting.popleft()
                self.store.write(topic, type(message), t, cdr.encode(message))
                time.sleep(0)  # hands the interpreter to who waits for it: the stop, say
            self.store.turn(self._now(), closing)
        except _LimitError as reached:
            self._end(str(reached))
            with contextlib.suppress(OSError):
                self.store.close()
        except Exception as error:  # a full disk, say: whatever it is, it is said, and ends here
            self.store.abandon()
            self.broken = True
            self._end(getattr(error, "strerror", None) or repr(error))

    def _end(self, why: str) -> None:
        self.trouble = f"recording has ended: {why}"
        self._waiting.clear()

    def _run(self) -> None:
        closing = False
        while not (closing or self.trouble):
            closing = self._closing.wait(_TURN)
            self.turn(closing)


class Whole:
    """One file of everything."""

    def __init__(self, path: Path, limits: Limits, attachments: dict[str, bytes], now: int):
        path = path / _name("skin", ".mcap", now) if path.is_dir() else path
        self._writer = Writer(path, attachments, now)
        self._limits, self._flushed = limits, now
        self.files, self.written, self.size = [path], 0, self._writer.size

    def stop(self, t: int) -> None:
        pass

    def write(self, topic: str, kind: type[Message], t: int, data: bytes) -> None:
        self._writer.write(topic, kind, t, data)
        self.written += 1

    def turn(self, now: int, closing: bool) -> None:
        if now - self._flushed >= _FLUSH * 1e9:
            self._writer.flush()
            self._flushed, self.size = now, self._writer.size
        if self._writer.seconds >= self._limits.duration:
            raise _LimitError(f"after max_duration = {self._limits.duration:g} s")
        _check_size(self.size, self._limits)
        if closing:
            self.close()

    def close(self) -> None:
        self._writer.close()

    def abandon(self) -> None:
        self._writer.abandon()


class Ring:
    """The last seconds in memory; a file of them for each stop."""

    def __init__(self, path: Path, limits: Limits, attachments: dict[str, bytes], now: int):
        self._path, self._limits, self._attachments = path, limits, attachments
        folder = path if path.is_dir() else path.parent
        if not os.access(folder, os.W_OK | os.X_OK):  # the first stop may come after days
            raise FileError(f"{folder}: no file can be made in this folder")
        # No objects but text, numbers and bytes: the garbage collector passes over them, and so
        # takes no longer for minutes of messages.
        self._kept: deque[tuple[str, str, int, bytes]] = deque()
        self._stopped: int | None = None  # when, if it is not written yet [ns]
        self._saving: tuple[Writer, deque[tuple[str, str, int, bytes]]] | None = None
        self.files: list[Path] = []
        self.written = self.size = 0

    def stop(self, t: int) -> None:
        self._stopped = t if self._stopped is None else self._stopped

    def write(self, topic: str, kind: type[Message], t: int, data: bytes) -> None:
        self._kept.append((topic, kind.TYPE, t, data))
        oldest = (t if self._stopped is None else self._stopped) - self._limits.last * 1e9
        while self._kept[0][2] < oldest:
            self._kept.popleft()

    def turn(self, now: int, closing: bool) -> None:
        stopped = self._stopped
        over = stopped is not None and (closing or now >= stopped + _AFTER * 1e9)
        if stopped is not None and over and self._saving is None:
            self._saving = self._begin(stopped), self._kept
            self._kept, self._stopped = deque(), None
        if self._saving:
            writer, entries = self._saving
            self._save(writer, entries, len(entries) if closing else _SLICE)
        if closing and self._stopped is not None:  # one more, while the last was written
            self.turn(now, closing)

    def _begin(self, stopped: int) -> Writer:
        path = self._path
        if path.is_dir():
            path = path / _name("stop", ".mcap", stopped)
        else:
            path = path.with_name(_name(path.stem, path.suffix, stopped))
        self.files.append(path)
        return Writer(path, self._attachments, stopped)

    def _save(self, writer: Writer, entries: deque, most: int) -> None:
        before = writer.size
        for _ in range(min(most, len(entries))):
            topic, kind, t, data = entries.popleft()
            writer.write(topic, cdr.KINDS[kind], t, data)
            self.written += 1
        self.size += writer.size - before
        _check_size(self.size, self._limits)
        if not entries:
            self.close()

    def close(self) -> None:
        if self._saving:
            (writer, _), self._saving = self._saving, None
            before = writer.size
            writer.close()
            self.size += writer.size - before

    def abandon(self) -> None:
        if self._saving:
            self._saving[0].abandon()


def _target(name: str) -> Path:
    """Return the file, or the folder, which is made."""
    path = Path(name)
    if path.is_dir():
        return path
    if not path.parent.is_dir():
        raise FileError(f"{name}: there is no folder {path.parent}")
    if name.endswith("/"):
        path.mkdir()
    elif not path.suffix:
        path = path.with_suffix(".mcap")
    elif path.suffix != ".mcap":
        raise FileError(f"{name}: must be a .mcap file, or a folder")
    return path


def _name(stem: str, suffix: str, t: int) -> str:
    return f"{stem}_{datetime.fromtimestamp(t * 1e-9):%Y-%m-%dT%H-%M-%S}{suffix}"


def _check_size(size: int, limits: Limits) -> None:
    if size >= limits.size:
        raise _LimitError(f"at max_size = {limits.size / 1e6:g} MB")
