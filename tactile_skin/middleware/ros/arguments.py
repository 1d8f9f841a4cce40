# SPDX-License-Identifier: Apache-2.0
"""What stands between --ros-args and -- on a ROS program's command line."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterator
from typing import Any

from ...files import shorten
from ...yaml_files import parse_yaml
from ..bus import Parameter
from ..package import NODES
from ..parameter_file import CONFIG, ParameterFile

PARAMS_FILE = "--params-file"
_LAUNCH_ROS = "launch_params_"  # how launch_ros names the files that it writes
_RULE = r"(?:([A-Za-z_]\w*):(?!//))?([^:\s]+):="  # node, name


@dataclasses.dataclass
class RosArguments:
    """What is given, each with the name of the node that it is for; None: for every node.

    Attributes:
        given: parameters, their files and rules (from, to), the first of which counts.
        others: ROS knows them, or refuses them.
    """

    given: list[tuple[str | None, Any]] = dataclasses.field(default_factory=list)
    others: list[str] = dataclasses.field(default_factory=list)

    def name_of(self, node: str, alone: bool = True) -> str:
        """Return the node's name; `alone`: a name for all nodes of the process is its own."""
        return self._renamed("__node", node, *[None] * alone) or node

    def namespace_of(self, *names: str) -> str:
        return self._renamed("__ns", *names, None)

    def _renamed(self, what: str, *names: str | None) -> str:
        rules = (rule for name in names for rule in self._of(tuple, name) if rule[0] == what)
        return next(rules, (what, ""))[1]

    def _of(self, kind, *names: str | None) -> list:
        return [item for node, item in self.given if node in names and isinstance(item, kind)]

    def parameters_of(self, *names: str | None) -> list[ParameterFile | Parameter]:
        """For the node of these names, as the program and as the command line have it."""
        return self._of((ParameterFile, Parameter), *names)

    def remappings_of(self, *names: str | None) -> list[tuple[str, str]]:
        """Return those of topics and services."""
        return [rule for rule in self._of(tuple, *names) if rule[0] not in ("__node", "__ns")]

    def addressed(self) -> set[str]:
        """Return the names of the nodes that arguments are for."""
        return {node for node, _ in self.given if node}


def split_arguments(words: list[str]) -> tuple[list[str], RosArguments]:
    """Split a command line into the program's own words and ROS's; ValueError names a wrong one."""
    own, args, rest = [], RosArguments(), iter(words)
    for word in rest:
        if word != "--ros-args":
            own.append(word)
            continue
        for theirs in itertools.takewhile("--".__ne__, rest):
            if theirs != "--ros-args":
                _take(theirs, rest, args)
    return own, args


def _read(path: str) -> list[ParameterFile | Parameter]:
    """Return a parameter file, or what is in one that `ros2 launch` has written for one program.

    That is of what a launch file gives the program; an empty value is that of an argument that was
    not given, and says nothing.
    """
    file = ParameterFile(path)
    ours = [s for s in file.sections if file.path.name.startswith(_LAUNCH_ROS)]
    if len(ours) != 1 or ours[0].node in NODES:
        return [file]  # a user's, also where launch_ros has carried out its substitutions
    values, source = ours[0].values, ours[0].name
    named = [ParameterFile(values.pop(CONFIG), own=True)] if CONFIG in values else []
    return [*named, *(Parameter(k, v, source) for k, v in values.items() if v != "")]


def _take(word: str, rest: Iterator[str], args: RosArguments) -> None:
    if word == PARAMS_FILE:
        args.given += [(None, item) for item in _read(next(rest, ""))]
    elif word in ("-p", "--param"):
        node, name, to = _rule(word, rest, ".*", "name:=value")
        value = parse_yaml(to, f"--ros-args: {word} {shorten(f'{name}:={to}')}")
        given = ParameterFile(value, own=True) if name == CONFIG else Parameter(name, value)
        args.given.append((node, given))
    elif word in ("-r", "--remap"):
        node, name, to = _rule(word, rest, r"\S+", "from:=to")
        args.given.append((node, ("__node" if name == "__name" else name, to)))
    else:
        args.others.append(word)


def _rule(word: str, rest: Iterator[str], to: str, form: str) -> tuple:
    """Take the next word, as (node or None, name, to); `to`: what that may be."""
    value = next(rest, "")
    if not (found := re.fullmatch(f"{_RULE}({to})", value, re.DOTALL)):
        raise ValueError(f"--ros-args: {word} {value!r}: must be [node:]{form}")
    return found.groups()
