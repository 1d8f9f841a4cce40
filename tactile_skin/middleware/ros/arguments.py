# SPDX-License-Identifier: Apache-2.0
"""What stands between --ros-args and -- on a ROS program's command line."""

from __future__ import annotations

import dataclasses
import re

from ...files import shorten
from ...yaml_files import parse_yaml
from ..bus import Parameter
from ..package import NODES
from ..parameter_file import CONFIG, ParameterFile

PARAMS_FILE = "--params-file"
_LAUNCH_ROS = "launch_params_"  # how launch_ros names the files that it writes
_NODE = r"(?:(?P<node>[A-Za-z_]\w*):(?!//))?"
_RULE = re.compile(_NODE + r"(?P<name>[^:\s]+):=(?P<to>\S+)")
_VALUE = re.compile(_NODE + r"(?P<name>[^:\s]+):=(?P<to>.*)", re.DOTALL)


@dataclasses.dataclass
class RosArguments:
    """Each with the name of the node that it is for; None: for every node of the process."""

    parameters: list[tuple[str | None, ParameterFile | Parameter]] = dataclasses.field(
        default_factory=list
    )
    remappings: list[tuple[str | None, tuple[str, str]]] = dataclasses.field(default_factory=list)
    names: dict[str | None, str] = dataclasses.field(default_factory=dict)
    namespaces: dict[str | None, str] = dataclasses.field(default_factory=dict)
    others: list[str] = dataclasses.field(default_factory=list)  # ROS knows them, or refuses them

    def name_of(self, node: str, alone: bool = True) -> str:
        """Return the node's name; `alone`: a name for all nodes of the process is its own."""
        return self.names.get(node) or (self.names.get(None) if alone else None) or node

    def namespace_of(self, *names: str) -> str:
        return next((self.namespaces[n] for n in (*names, None) if n in self.namespaces), "")

    def parameters_of(self, *names: str | None) -> list[ParameterFile | Parameter]:
        """For the node of these names, as the program and as the command line have it."""
        return [item for node, item in self.parameters if node in names]

    def addressed(self) -> set[str]:
        """Return the names of the nodes that arguments are for."""
        every = (*self.parameters, *self.remappings)
        return {node for node in (*(n for n, _ in every), *self.names, *self.namespaces) if node}

    def remappings_of(self, *names: str | None) -> list[tuple[str, str]]:
        """(from, to), the first of which counts."""
        return [rule for node, rule in self.remappings if node in names]


def split_arguments(words: list[str]) -> tuple[list[str], RosArguments]:
    """Split a command line into the program's own words and ROS's; ValueError names a wrong one."""
    own, args, rest = [], RosArguments(), list(words)
    while rest:
        word = rest.pop(0)
        if word != "--ros-args":
            own.append(word)
            continue
        while rest and (word := rest.pop(0)) != "--":
            if word != "--ros-args":
                _take(word, rest, args)
    return own, args


def _read(path: str) -> list[ParameterFile | Parameter]:
    """Return a parameter file, or what is in one that `ros2 launch` has written for one program.

    That is of what a launch file gives the program; an empty value is that of an argument that was
    not given, and says nothing.
    """
    file = ParameterFile(path)
    if len(file.sections) != 1 or not file.path.name.startswith(_LAUNCH_ROS):
        return [file]
    (section,) = file.sections
    if section.node in NODES:
        return [file]  # a user's, also where launch_ros has carried out its substitutions
    values = section.values
    named = [ParameterFile(values.pop(CONFIG), own=True)] if CONFIG in values else []
    return [*named, *(Parameter(k, v, section.name) for k, v in values.items() if v != "")]


def _take(word: str, rest: list[str], args: RosArguments) -> None:
    if word == PARAMS_FILE:
        args.parameters += [(None, item) for item in _read(rest.pop(0) if rest else "")]
    elif word in ("-p", "--param"):
        value = rest.pop(0) if rest else ""
        found = _VALUE.fullmatch(value)
        if not found:
            raise ValueError(f"--ros-args: {word} {value!r}: must be [node:]name:=value")
        text = parse_yaml(found["to"], f"--ros-args: {word} {shorten(value)}")
        own = found["name"] == CONFIG
        given = ParameterFile(text, own=True) if own else Parameter(found["name"], text)
        args.parameters.append((found["node"], given))
    elif word in ("-r", "--remap"):
        value = rest.pop(0) if rest else ""
        found = _RULE.fullmatch(value)
        if not found:
            raise ValueError(f"--ros-args: {word} {value!r}: must be [node:]from:=to")
        name, to = found["name"], found["to"]
        if name in ("__node", "__name"):
            args.names.setdefault(found["node"], to)
        elif name == "__ns":
            args.namespaces.setdefault(found["node"], to)
        else:
            args.remappings.append((found["node"], (name, to)))
    else:
        args.others.append(word)
