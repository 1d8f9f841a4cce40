# SPDX-License-Identifier: Apache-2.0
"""An object in a process of its own, called as if it were here.

Python runs one thread of a process at a time: what calculates for milliseconds keeps all others
waiting, those that stop the robot among them.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

_SERVE = "-c", "import sys; from tactile_skin.middleware import process; process.serve(sys.argv[1])"
_PACKAGES = str(Path(__file__).parents[2])
# s for an answer, after which the process hangs; and from one start to the next at least
_PATIENCE = 3.0


class ProcessEnded(RuntimeError):
    """The process does not answer; it is started again when `OwnProcess.ready` is asked."""


class OwnProcess:
    """Calls an object that another process has made; methods and attributes are the object's.

    The process is started at once and nobody waits for it: ask `ready` first. All is for one
    thread. The process ends with this one.
    """

    def __init__(self, make: Callable, arguments: tuple, like: Any, kept: tuple[str, ...]):
        """Start the process.

        Args:
            make: function of a module that makes the object.
            arguments: of it, which can be pickled.
            like: an object made so, which says what the attributes are until the first answer.
            kept: names of attributes that come with each answer; others are asked for.
        """
        self._make, self._names, self.arguments = make, kept, arguments
        self._methods = {n for n in dir(type(like)) if callable(getattr(type(like), n))}
        self._kept = {name: getattr(like, name) for name in kept}
        self._why, self._over = "its process starts", False
        self._start()

    def _start(self) -> None:
        here, there = socket.socketpair()
        with there:
            self._process = started(_SERVE, [there])
        self._connection, self._answers = Connection(here.detach()), False
        self._started = time.monotonic()
        with contextlib.suppress(OSError):  # it has ended already
            self._connection.send((self._make, self.arguments, self._names))

    @property
    def ready(self) -> bool:
        """Whether it answers; one that has ended is started again.

        Raises:
            Exception: what `make` raised.
        """
        if self._process.poll() is not None:
            self._ended()
            if not self._over and time.monotonic() - self._started >= _PATIENCE:
                self._connection.close()
                self._start()
        elif not self._answers and self._connection.poll():
            with contextlib.suppress(ProcessEnded):
                self._answer()
                self._answers = True
        return self._answers

    def wait(self) -> bool:
        """Wait for its first answer, but not for long; whether it came."""
        if not self._answers:
            self._connection.poll(2.0 * _PATIENCE)  # it imports NumPy and SciPy
        return self.ready

    @property
    def why(self) -> str:
        """Why it does not answer."""
        return self._why

    def _ended(self) -> ProcessEnded:
        code = self._process.wait()
        self._answers, self._why = False, f"its process ended ({code}) and is started again"
        return ProcessEnded(self._why)

    def __getattr__(self, name: str) -> Any:
        if name in self._kept:
            return self._kept[name]
        return partial(self._ask, name) if name in self._methods else self._ask(name)

    def _ask(self, name: str, *arguments, **named):
        if not self._answers:
            raise ProcessEnded(self._why)
        try:
            self._connection.send((name, arguments, named))
        except OSError:
            raise self._ended() from None
        return self._answer()

    def _answer(self):
        try:
            if not self._connection.poll(_PATIENCE):
                self._process.kill()
                raise EOFError
            done, found, kept = self._connection.recv()
        except (EOFError, OSError):
            raise self._ended() from None
        self._kept = kept or self._kept
        if not done:
            self._why = str(found)
            raise found
        return found

    def end(self) -> None:
        """End the process for good."""
        self._over = True
        self._process.kill()
        self._process.wait()
        self._connection.close()


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


def serve(descriptor: str) -> None:
    """Make what is asked for, and carry out the calls, until the other end is gone."""
    with Connection(int(descriptor)) as connection, contextlib.suppress(EOFError, OSError):
        make, given, names = connection.recv()
        done, thing = _tried(make, *given)
        connection.send((done, None if done else thing, _named(thing, names) if done else {}))
        while True:
            name, arguments, named = connection.recv()
            connection.send((*_tried(_call, thing, name, arguments, named), _named(thing, names)))


def _tried(function: Callable, *arguments) -> tuple[bool, Any]:
    """Return whether a function returns, and what; or the error that it raises."""
    try:
        return True, function(*arguments)
    except Exception as error:
        return False, error


def _call(thing, name: str, arguments: tuple, named: dict):
    found = getattr(thing, name)
    return found(*arguments, **named) if callable(found) else found


def _named(thing, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in names}
