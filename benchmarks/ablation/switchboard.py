# SPDX-License-Identifier: Apache-2.0
"""Switches mechanisms of the package off, and records which of them said anything.

A mechanism is off where its result is replaced by its null result: what it returns where nothing is
wrong. The package's code stays as it is; its names are patched, and a name that is no longer there
is an error.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

PACKAGE = "tactile_skin"


def find(where: str) -> tuple[Any, str]:
    """Return the owner of a name, and the name: "solvers.score:by_score", "m:Class.method".

    Raises:
        AttributeError: there is no such name (an attribute that instances set is not looked for).
    """
    module, _, path = where.partition(":")
    owner = importlib.import_module(f"{PACKAGE}.{module}")
    *outer, name = path.split(".")
    for part in outer:
        owner = getattr(owner, part)
    return owner, name


@dataclass(frozen=True)
class Result:
    """A function, or a property, whose result is filtered where the mechanism is off.

    Attributes:
        where: see `find`.
        null: (result, *arguments of the call) -> what is returned where the mechanism is off. Where
            it is on, the mechanism has spoken if that is another value.
        skip: whether the function is not called where the mechanism is off; `null` gets None then.
        probe: whether the result stays as it is, and only shows whether the mechanism spoke.
    """

    where: str
    null: Callable
    skip: bool = False
    probe: bool = False

    def patch(self, board: Switchboard, name: str) -> None:
        owner, attribute = find(self.where)
        original = getattr(owner, attribute)
        function = original.fget if isinstance(original, property) else original

        def call(*args, **kwargs):
            off = name in board.off and not self.probe
            if off and self.skip:
                return self.null(None, *args)
            found = function(*args, **kwargs)
            if self.probe and name in board.off:
                return found
            null = self.null(found, *args)
            if off:
                return null
            if _differ(found, null):
                board.spoke.add(name)
            return found

        board.replace(owner, attribute, property(call) if function is not original else call)


@dataclass(frozen=True)
class Field:
    """An attribute that instances of a class set; it reads as `null` of its value where off."""

    where: str
    null: Callable

    def patch(self, board: Switchboard, name: str) -> None:
        owner, attribute = find(self.where)
        key, null = f"_{name} {attribute}", self.null

        def read(instance):
            found = instance.__dict__[key]
            without = null(found)
            if name in board.off:
                return without
            if _differ(found, without):
                board.spoke.add(name)
            return found

        def write(instance, value):
            instance.__dict__[key] = value

        board.replace(owner, attribute, property(read, write))


@dataclass(frozen=True)
class Limit:
    """A module's constant that is moved out of reach where the mechanism is off."""

    where: str
    value: Any

    def patch(self, board: Switchboard, name: str) -> None:
        owner, attribute = find(self.where)
        board.limits.append((name, owner, attribute, getattr(owner, attribute), self.value))


class Switchboard:
    """All mechanisms, of which some are off.

    Attributes:
        off: names of those that are.
        spoke: names of those whose result was not null since this was cleared.
        limits: (name, module, constant, value on, value off).
    """

    def __init__(self):
        self.off: frozenset[str] = frozenset()
        self.spoke: set[str] = set()
        self.limits: list[tuple] = []
        self._originals = contextlib.ExitStack()

    def replace(self, owner, name: str, value) -> None:
        """Set an attribute until the board is closed."""
        if name in vars(owner):
            self._originals.callback(setattr, owner, name, vars(owner)[name])
        else:
            self._originals.callback(delattr, owner, name)
        setattr(owner, name, value)

    def switch_off(self, names=()) -> None:
        """Only these are off from here on, and nothing has spoken yet."""
        self.off, self.spoke = frozenset(names), set()
        for name, owner, attribute, on, off in self.limits:
            setattr(owner, attribute, off if name in self.off else on)

    def close(self) -> None:
        """Everything is as it was."""
        self.switch_off()
        self._originals.close()


@contextlib.contextmanager
def installed(mechanisms):
    """A switchboard of these mechanisms (each with a name and parts), all of them on."""
    board = Switchboard()
    try:
        for mechanism in mechanisms:
            for part in mechanism.parts:
                part.patch(board, mechanism.name)
        yield board
    finally:
        board.close()


_VALUES = bool, int, float, str, tuple, list, type(None)  # which are compared by value


def _differ(found, null) -> bool:
    if isinstance(found, np.ndarray) or isinstance(null, np.ndarray):
        return found is not null and not np.array_equal(found, null)
    return bool(found != null) if isinstance(found, _VALUES) else found is not null


class Memo:
    """`compensate` of a frame that was solved before, with other mechanisms off: the same result,
    unless one of those that are off now spoke then, or one that was off then is on now.

    Attributes:
        counts: status -> number of frames since `forget_counts`.
    """

    def __init__(self, board: Switchboard, function):
        self._board, self._function = board, function
        self._entries: dict = {}
        self.counts: dict[str, int] = {}

    def forget_counts(self) -> None:
        """Nothing was solved yet, and nothing has spoken."""
        self.counts = {}
        self._board.spoke.clear()

    def __call__(self, adc, circuit, curve, method, *, start=None, **given):
        values = tuple((k, _plain(v)) for k, v in sorted(given.items()))
        key = adc.tobytes(), circuit, curve, method, id(start), values
        entries, off = self._entries.setdefault(key, []), self._board.off
        for were_off, spoke, before, _ in entries:
            if were_off <= off and not spoke & off:
                self._board.spoke |= spoke
                found = before
                break
        else:
            earlier, self._board.spoke = self._board.spoke, set()
            found = self._function(adc, circuit, curve, method, start=start, **given)
            # `start` is kept, so that no other estimate gets its id
            entries.append((off, frozenset(self._board.spoke), found, start))
            self._board.spoke |= earlier
        self.counts[found.status] = self.counts.get(found.status, 0) + 1
        return found


def _plain(value):
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    return value if isinstance(value, (bool, int, float, str, type(None))) else id(value)
