# SPDX-License-Identifier: Apache-2.0
"""The errors of this package, in one tree.

    TactileSkinError
    |-- FileError          a file, or a text read as YAML, is refused
    |-- LaunchError        a launch file or argument cannot be carried out
    |-- ParameterError     an unknown parameter, a wrong type, a value outside its range
    |-- TopicTypeError     a topic carries another type already (a TypeError, too)
    |-- RosError           ROS, or a part of it, is not installed
    |-- FirmwareError      the firmware cannot be built, simulated or flashed
    `-- TrainingDied       a run of training cannot recover

All are ValueErrors: a value that the caller gave, or its file holds, is refused. Plain ValueErrors
are raised for the arguments of pure functions.
"""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable, Iterator

_ALIKE = 0.6  # ratio of difflib from which on a name is taken for a misspelt one: its own default
_FEW = 6  # names that a message lists; of more, `--show-args` and config/skin.yaml tell


class TactileSkinError(ValueError):
    """What this package refuses; the message names the thing, its value and what is allowed."""


class FileError(TactileSkinError):
    """A file, or a text read as YAML, that is refused; the message names it, and the line."""


class LaunchError(TactileSkinError):
    """A launch file or argument that cannot be carried out; the message names file and key."""


class ParameterError(TactileSkinError):
    """A parameter with an unknown name, a wrong type or a value outside its range.

    Attributes:
        parameters: names of those, or of groups of those, that are refused, where that is known.
    """

    def __init__(self, message: str, *parameters: str):
        super().__init__(message)
        self.parameters = parameters


@contextlib.contextmanager
def concerning(*parameters: str) -> Iterator[None]:
    """Say which parameters, or groups of them, a plain ValueError refuses: a ParameterError."""
    try:
        yield
    except TactileSkinError:
        raise
    except ValueError as error:
        raise ParameterError(str(error), *parameters) from error


class TopicTypeError(TactileSkinError, TypeError):
    """A topic that carries another type already."""


class RosError(TactileSkinError):
    """ROS, or a part of it, is not there; the message says what to install."""


class FirmwareError(TactileSkinError):
    """The firmware cannot be built, simulated or flashed; the message says what to do."""


class TrainingDied(TactileSkinError, RuntimeError):
    """The run cannot recover: outputs all equal, no better than a constant, or not finite."""


SUCCESSORS = {  # node or argument of an earlier version -> what there is instead
    "foxglove": "is gone: the app opens a recording, and foxglove_bridge shows a skin on ROS",
    "tactile_state": "is gone: no ROS distribution has tactile_msgs; subscribe to skin/pressure",
    "board": "is gone: the board is simulated; only the firmware's tests simulate its chip",
}


def is_unknown(name: str, known: Iterable[str]) -> str:
    """Return the end of a message that refuses an argument: what there is instead."""
    return SUCCESSORS.get(name) or f"is unknown{did_you_mean(name, known)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the end of a message that refuses an unknown name.

    It is the known name that it resembles, or all of them where they are few, or nothing.
    """
    known = sorted(known)
    last = name.rsplit(".", 1)[-1]
    moved = [other for other in known if other.rsplit(".", 1)[-1] == last]  # rows, circuit.rows
    near = difflib.get_close_matches(name, known, n=1, cutoff=_ALIKE)
    if moved or near:
        return f"; did you mean {(moved or near)[0]!r}?"
    return f"; there are: {', '.join(known) or 'none'}" if len(known) <= _FEW else ""
