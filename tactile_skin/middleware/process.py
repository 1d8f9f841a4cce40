# SPDX-License-Identifier: Apache-2.0
"""The nodes of a skin in a process of its own, as who started it sees them.

Python runs one thread of a process at a time: what calculates for milliseconds keeps all others
waiting, those that stop the robot among them.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import itertools
import logging
import os
import pickle
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from .bus import Node, Parameter
from .parameter_file import ParameterFile
from .plan import NodeAction

_PROGRAM = "-m", "tactile_skin.launch.served"
_PACKAGES = str(Path(__file__).parents[2])
ALIVE = 0.5  # s between two words of the process, where it has nothing else to say
# s of silence after which the process hangs; and from one start to the next at least
_PATIENCE = 3.0
_STARTS = 10.0  # s that it may take for its first word: it imports NumPy and SciPy
_TURN = 0.05  # s between two looks at what is heard here, and at whether it has ended
_ENDS = 0.2  # s for its final messages
_LARGEST = 1 << 18  # bytes of a word: a picture of 64 x 64 cells has 32768


# --- what the two say to each other --------------------------------------------------------------


class Start(NamedTuple):
    """Run these nodes; the clock is that of who asks, and what is logged below the level is not."""

    nodes: list[NodeAction]
    clock: Any
    level: int


class Hear(NamedTuple):
    """Send what is published on these topics, and on no others."""

    topics: frozenset[str]


class Published(NamedTuple):
    """A message of a topic, either way."""

    topic: str
    message: Any


class Call(NamedTuple):
    """Call a service."""

    number: int
    service: str
    request: Any


class Change(NamedTuple):
    """Change parameters of a node."""

    number: int
    node: str
    values: dict[str, Any]


class Answer(NamedTuple):
    """What came of a Call or a Change."""

    number: int
    answer: Any
    error: str  # why there is no answer; empty: there is one


class Alive(NamedTuple):
    """The nodes run."""


class End(NamedTuple):
    """Close the nodes."""


class Line:
    """One end of what the two say to each other; any thread may say a word."""

    def __init__(self, end: socket.socket, patience: float):
        """Take an end of a pair; `patience` is how long to wait for a word, or for room [s]."""
        end.settimeout(patience)
        self._socket, self._lock = end, threading.Lock()
        self._room = memoryview(bytearray(_LARGEST))

    def say(self, word: Any) -> None:
        """Say a word; it is lost where nobody is there, or takes none."""
        with self._lock, contextlib.suppress(OSError):
            self._socket.send(pickle.dumps(word, pickle.HIGHEST_PROTOCOL))

    def hear(self) -> Any:
        """Return the next word; None: none comes.

        Raises:
            OSError: the other end is gone.
        """
        try:
            size = self._socket.recv_into(self._room)
        except TimeoutError:
            return None
        if not size:
            raise ConnectionResetError
        return pickle.loads(self._room[:size])

    def close(self) -> None:
        self._socket.close()


# -------------------------------------------------------------------------------------------------


class SkinProcess:
    """Runs nodes in a process of their own, for which the same nodes stand here.

    Those have the names, parameters, topics and services, and do nothing of themselves: messages of
    the process that somebody here hears are published by them, and what others publish here reaches
    the process. One that ends or hangs is started again.

    Attributes:
        why: why its nodes do not run; empty: they do.
    """

    def __init__(
        self, actions: list[NodeAction], handles: list[Node], absent: Callable[[str, bool], None]
    ):
        """Start the process; nobody waits for it.

        Args:
            handles: the nodes of `actions` that stand for them.
            absent: called with `why`, and whether they have not run yet, again and again, in a
                thread of this.
        """
        self._actions, self._handles, self._absent = actions, handles, absent
        self._context = handles[0].context
        self._publishers = {p.topic_name: p for handle in handles for p in handle.publishers}
        self._numbers, self._asked = itertools.count(), dict[int, Future]()
        self._over, self._began, self.why = threading.Event(), threading.Event(), "starts"
        change = {handle: partial(self._change, handle) for handle in handles}
        self._forwards = frozenset(
            forward
            for handle in handles
            for forward in handle.stand_in(self._forward, self._call, change[handle])
        )
        self._start()
        self._thread = threading.Thread(
            target=self._run, name=f"process {handles[0].get_namespace()}", daemon=True
        )
        self._thread.start()

    def wait(self) -> None:
        """Wait until its nodes run, but not for long."""
        self._began.wait(_STARTS)

    def ask_to_end(self) -> None:
        """Let the nodes publish their last words; the process is not started again."""
        self._over.set()
        self._line.say(End())

    def end(self) -> None:
        """End the process, which had its time for last words."""
        self.ask_to_end()
        self._thread.join(_ENDS)
        self._process.kill()
        self._process.wait()
        self._thread.join(_ENDS)
        self._line.close()

    # --- its life, in a thread of its own ---

    def _start(self) -> None:
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with there:
            self._process = started(_PROGRAM, [there])
        self._line, self._hears = Line(here, _TURN), frozenset[str]()
        self._started = self._heard_at = time.monotonic()
        nodes = [
            dataclasses.replace(action, parameters=_values_of(handle))
            for action, handle in zip(self._actions, self._handles, strict=True)
        ]
        level = self._handles[0].get_logger().getEffectiveLevel()
        self._line.say(Start(nodes, self._context.clock, level))

    def _run(self) -> None:
        looked = 0.0
        while True:
            try:
                now = time.monotonic()
                if now - looked >= _TURN:
                    looked = now
                    self._look(now)
                if (word := self._line.hear()) is not None:
                    self._take(word)
            except OSError:
                if self._ended():
                    return

    def _look(self, now: float) -> None:
        """Say what is heard here, and that nothing runs; a process that hangs is killed."""
        if self.why:
            self._absent(self.why, not self._began.is_set())
        else:
            heard = frozenset(topic for topic in self._publishers if self._is_heard(topic))
            if heard != self._hears:
                self._line.say(Hear(heard))
                self._hears = heard
        if now - self._heard_at > (_STARTS if self.why else _PATIENCE):
            self._process.kill()

    def _is_heard(self, topic: str) -> bool:
        return not self._forwards.issuperset(self._context._subscriptions.get(topic, ()))

    def _take(self, word: Any) -> None:
        self._heard_at = time.monotonic()
        match word:
            case Published(topic, message):
                self._publishers[topic].publish(message)
            case Alive():
                self.why = ""
                self._began.set()
            case Answer(number, answer, error):
                future = self._asked.pop(number)
                if error:
                    future.set_exception(RuntimeError(error))
                else:
                    future.set_result(answer)
            case logging.LogRecord():
                logging.getLogger(word.name).handle(word)

    def _ended(self) -> bool:
        """Start again a process that is gone; whether that is over."""
        self._process.kill()
        code = self._process.wait()
        self.why = f"ended ({code}) and is started again"
        for number in list(self._asked):
            self._asked.pop(number).set_exception(RuntimeError(self.why))
        while not self._over.is_set():
            self._absent(self.why, not self._began.is_set())
            if time.monotonic() - self._started >= _PATIENCE:
                self._line.close()
                self._start()
                return False
            self._over.wait(_TURN)
        return True

    # --- what the nodes here do ---

    def _forward(self, topic: str, message: Any) -> None:
        if (
            threading.current_thread() is not self._thread and not self.why
        ):  # not one of the process
            self._line.say(Published(topic, message))

    def _ask(self, kind: type, *what: Any) -> Any:
        if self.why:
            raise RuntimeError(f"its process {self.why}")
        number, future = next(self._numbers), Future[Any]()
        self._asked[number] = future
        self._line.say(kind(number, *what))
        try:
            return future.result(_PATIENCE)
        except concurrent.futures.TimeoutError:
            raise RuntimeError("its process does not answer") from None

    def _call(self, service: str, request: Any, response: Any) -> Any:
        try:
            return self._ask(Call, service, request)
        except RuntimeError as error:
            response.success, response.message = False, str(error)
            return response

    def _change(self, handle: Node, values: dict[str, Any]) -> None:
        try:
            answer = self._ask(Change, handle.get_fully_qualified_name(), values)
        except RuntimeError as error:
            raise ValueError(str(error)) from None
        if not answer.successful:
            raise ValueError(answer.reason)


def _values_of(handle: Node) -> list[ParameterFile | Parameter]:
    """Return the parameters of a node as they are now."""
    return [handle.get_parameter(name) for name in handle.parameter_names()]


def started(words: Sequence[str], sockets: Sequence[socket.socket]) -> subprocess.Popen:
    """Start Python with these words and the descriptors of sockets, which it inherits."""
    numbers = [each.fileno() for each in sockets]
    path = os.pathsep.join([_PACKAGES, *filter(None, sys.path)])
    return subprocess.Popen(
        [sys.executable, *words, *map(str, numbers)],
        stdin=subprocess.DEVNULL,
        pass_fds=numbers,
        env=os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,  # Ctrl-C ends this process, and that ends it
    )
