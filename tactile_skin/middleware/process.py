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
STARTS = 10.0  # s that it may take for its first word: it imports NumPy and SciPy
_TURN = 0.05  # s between two looks at what is heard here, and at whether it has ended
ENDS = 0.2  # s for its final messages
_LARGEST = 1 << 18  # bytes of a word: a picture of 64 x 64 cells has 32768


# --- what the two say to each other --------------------------------------------------------------


class Start(NamedTuple):
    """Run these nodes; the clock is that of who asks, and what is logged below the level is not."""

    nodes: list[NodeAction]
    clock: Any
    level: int
    again: str  # why those before them have ended; empty: there were none


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

    def __init__(self, end: socket.socket, patience: float, room_within: float):
        """Take an end of a pair; how long to wait for a word, and for room to say one [s]."""
        self._socket, self._out, self._lock = end, end.dup(), threading.Lock()
        self._socket.settimeout(patience)
        self._out.settimeout(room_within)
        self._room = memoryview(bytearray(_LARGEST))

    def say(self, word: Any) -> bool:
        """Say a word; False: it is lost, since nobody is there, or takes none."""
        with self._lock, contextlib.suppress(OSError):
            return bool(self._out.send(pickle.dumps(word, pickle.HIGHEST_PROTOCOL)))
        return False

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
        self._out.close()


# -------------------------------------------------------------------------------------------------


class SkinProcess:
    """Runs nodes in a process of their own, for which the same nodes stand here.

    Those have the names, parameters, topics and services, and do nothing of themselves: messages of
    the process that somebody here hears are published by them, and what others publish here reaches
    the process. One that ends or hangs is started again.

    Attributes:
        why: why its nodes do not run; empty: they do.
        ended: whether an earlier process has.
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
        self._over, self._began, self._closed = threading.Event(), threading.Event(), False
        self.why, self.ended, self._looked = "starts", False, 0.0  # s, of the monotonic clock
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

    def wait(self, seconds: float) -> bool:
        """Wait for so long, at most, until its nodes run; whether they do."""
        return self._began.wait(seconds)

    def ask_to_end(self) -> None:
        """Let the nodes publish their last words; the process is not started again."""
        self._over.set()
        self._line.say(End())

    def end(self, until: float) -> None:
        """End the process; until then, of the monotonic clock [s], it has time for last words."""
        self.ask_to_end()
        self._thread.join(max(0.0, until - time.monotonic()))
        self._closed = True  # what it says from here on comes too late
        self._process.kill()
        self._thread.join(ENDS)

    # --- its life, in a thread of its own ---

    def _start(self) -> None:
        self._started = self._heard_at = time.monotonic()
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        line = Line(here, _TURN, 0.0)
        with there:
            try:
                self._process = started(_PROGRAM, [there])
            except OSError:
                line.close()
                raise
        nodes = [
            dataclasses.replace(action, parameters=_values_of(handle))
            for action, handle in zip(self._actions, self._handles, strict=True)
        ]
        level = self._handles[0].get_logger().getEffectiveLevel()
        line.say(Start(nodes, self._context.clock, level, self.why if self.ended else ""))
        self._line, self._hears = line, frozenset[str]()

    def _run(self) -> None:
        over = False
        while not over:
            try:
                over = self._turn()
            except Exception as error:  # of a log's filter, say: this thread must not end silently
                with contextlib.suppress(Exception):
                    self._handles[0].get_logger().error("what its process says: %r", error)

    def _turn(self) -> bool:
        """Take a word, and look after the process; whether all is over."""
        try:
            if (now := time.monotonic()) - self._looked >= _TURN:
                self._looked = now
                self._look()
            if (word := self._line.hear()) is not None:
                self._take(word)
            else:
                self._is_silent(time.monotonic() - self._heard_at)
        except OSError:
            return self._is_over()
        return False

    def _look(self) -> None:
        """Say what is heard here, and that nothing runs."""
        if self.why:
            self._absent(self.why, not self.ended)
            return
        heard = frozenset(topic for topic in self._publishers if self._is_heard(topic))
        for topic in self._hears - heard:
            self._publishers[topic].forget()  # what is latched grows old
        if heard != self._hears and self._line.say(Hear(heard)):
            self._hears = heard

    def _is_silent(self, seconds: float) -> None:
        if not self.why and seconds > 2.0 * ALIVE:
            self._absent("does not answer", False)
        if seconds > (STARTS if self.why else _PATIENCE):
            self._process.kill()

    def _is_heard(self, topic: str) -> bool:
        return not self._forwards.issuperset(self._context._subscriptions.get(topic, ()))

    def _take(self, word: Any) -> None:
        self._heard_at = time.monotonic()
        match word:
            case Published(topic, message):
                if not self._closed:
                    self._publishers[topic].publish(message)
            case Alive():
                self.why = ""
                self._began.set()
            case Answer(number, answer, error):
                if (future := self._asked.pop(number, None)) is None:
                    return  # nobody waits for it any more
                if error:
                    future.set_exception(RuntimeError(error))
                else:
                    future.set_result(answer)
            case logging.LogRecord():
                logging.getLogger(word.name).handle(word)

    def _is_over(self) -> bool:
        """Start again a process that is gone; whether that is over."""
        self._process.kill()
        code, self.ended = self._process.wait(), True
        self.why = f"ended ({code}) and is started again"
        self._line.close()
        for number in list(self._asked):
            if future := self._asked.pop(number, None):
                future.set_exception(RuntimeError(f"its process {self.why}"))
        while not self._over.is_set():
            self._absent(self.why, False)
            if time.monotonic() - self._started >= _PATIENCE:
                with contextlib.suppress(OSError):  # no process, or no descriptor, can be had now
                    self._start()
                    break
            self._over.wait(_TURN)
        if over := self._over.is_set():  # a process that has just been started as well
            self._process.kill()
            self._process.wait()
            self._line.close()
        return over

    # --- what the nodes here do ---

    def _forward(self, topic: str, message: Any) -> None:
        # not what is published here for the process
        if not self.why and threading.current_thread() is not self._thread:
            self._line.say(Published(topic, message))

    def _ask(self, kind: type, *what: Any) -> Any:
        number, future = next(self._numbers), Future[Any]()
        self._asked[number] = future
        try:
            if self.why:
                raise RuntimeError(f"its process {self.why}")
            self._line.say(kind(number, *what))
            return future.result(_PATIENCE)
        except concurrent.futures.TimeoutError:
            raise RuntimeError("its process does not answer") from None
        finally:
            self._asked.pop(number, None)

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
