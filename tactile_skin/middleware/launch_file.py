# SPDX-License-Identifier: Apache-2.0
"""The package's launch files in one process: what each of them starts.

`ros2 launch` reads the same files by itself. Here a file says which arguments it takes, with their
defaults and texts; which nodes they go to stands below.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import FileError, LaunchError, is_unknown
from ..files import shorten
from ..yaml_files import parse_yaml, read_yaml
from .bus import Parameter
from .package import BODY, COMPOSED, MONITOR, PACKAGE, RECORDER, VIEW, share_dir
from .parameter_file import CONFIG, ELSEWHERE, SKINS, ParameterFile
from .plan import Argument, NodeAction, Plan, own_nodes

RECORD = Argument("record", "", "MCAP file to record all topics to, or folder/ for such files")
_GATE = "cmd_vel_gate"
_SHARE = f"$(find-pkg-share {PACKAGE})"  # the only substitution in the default of an argument
_NAMESPACE = re.compile(r"/?([A-Za-z_]\w*/?)*", re.ASCII)
_OF_VIEW = {"view_host": "host", "view_port": "port", "view_controls": "controls"}
_NUMBERS = "duration", "wait_for_port", "view_port"  # refused before a board is started
# arguments of skin.launch.yaml that are for its namespace, or for others than the program `skin`
_NOT_OF_SKIN = {CONFIG, "namespace", "separate", VIEW, *_OF_VIEW}


def read_arguments(path) -> list[Argument]:
    """Return the arguments that a launch file takes; starts nothing, and needs none of them.

    Raises:
        LaunchError: as `read_plan`.
    """
    return [*_arguments_of(_shipped(path)), RECORD]


def read_plan(path, arguments: Mapping[str, object]) -> Plan:
    """Return what a launch file of the package starts with these arguments, texts or values.

    Raises:
        LaunchError: another file, an unknown argument, or a value that is missing or not allowed.
    """
    if none := [name for name, value in arguments.items() if value is None]:
        raise LaunchError(f"argument {none[0]} = None: give a value, or leave it out")
    name = _shipped(path)
    given = {name: str(value) for name, value in arguments.items()}
    plan = Plan(arguments={a.name: a for a in [*_arguments_of(name), RECORD]})
    if unknown := sorted(given.keys() - plan.arguments):
        what = is_unknown(unknown[0], plan.arguments)
        raise LaunchError(f"{path}: argument {unknown[0]!r} {what}")
    for argument in plan.arguments.values():
        if argument.default is None and argument.name not in given:
            wanted = f"{argument.name}: give {argument.name}:=value"
            raise LaunchError(f"{path}: {wanted}, {argument.description}")
        given.setdefault(argument.name, argument.default or "")
    record = given.pop(RECORD.name)
    started = _Started(Path(path), given, plan)
    _FILES[name](started)
    for node in own_nodes(started.config):
        plan.add(node)
    if record:  # it hears all nodes, and is given the files that they have
        to = Parameter("path", record)
        plan.add(NodeAction(RECORDER, RECORDER, "", [*plan.files(), to], file=Path(path)))
    return plan


class _Started:
    """What a launch file starts: its arguments filled in, and nodes that they are given to."""

    def __init__(self, path: Path, given: dict[str, str], plan: Plan):
        self.path, self.given, self.plan = path, given, plan
        self.config = ParameterFile(given[CONFIG], own=True)
        self._namespace = given.get("namespace", "")
        if not _NAMESPACE.fullmatch(self._namespace):
            where = f"{path}: namespace = {shorten(self._namespace)}"
            raise LaunchError(f"{where}: must be names between slashes")

    def wants(self, name: str) -> bool:
        """Whether an argument is true."""
        if (said := self.given[name].strip().lower()) not in ("true", "false", "1", "0"):
            value = shorten(self.given[name])
            raise LaunchError(f"{self.path}: {name} = {value}: must be true or false")
        return said in ("true", "1")

    def node(self, executable: str, *names: str, **renamed: str) -> None:
        """Start a node with the parameter file and, by their names, the arguments that are given.

        An empty text is that of an argument that was not given: what the file says holds.
        """
        parameters: list[ParameterFile | Parameter] = [self.config]
        for name, parameter in (*zip(names, names, strict=True), *renamed.items()):
            if text := self.given[name]:
                parameters.append(Parameter(parameter, self._value(name, text)))
        self.plan.add(
            NodeAction(executable, executable, self._namespace, parameters, file=self.path)
        )

    def _value(self, name: str, text: str):
        """Return the value of an argument: a text is read as YAML, as ROS 2 does."""
        where = f"{self.path}: {name} = {shorten(text)}"
        try:
            value = parse_yaml(text, where)
        except FileError as error:
            raise LaunchError(str(error)) from error
        if name in _NUMBERS and type(value) not in (int, float):
            raise LaunchError(f"{where}: must be a number")
        return value


def _skin(started: _Started) -> None:
    started.wants("separate")  # of processes, on ROS
    started.node(COMPOSED, *(a for a in started.given if a not in _NOT_OF_SKIN))
    if started.wants(VIEW):
        started.node(VIEW, "use_sim_time", **_OF_VIEW)


def _demo(started: _Started) -> None:
    link = f"{tempfile.gettempdir()}/skin_{os.getpid()}_{uuid.uuid4().hex[:8]}/board"
    sim = [sys.executable, "-m", PACKAGE, "sim", "--once", f"--link={link}"]
    plays = f"--scene={started.given.pop('scene')}", f"--{CONFIG}={started.given[CONFIG]}"
    started.plan.commands.append([*sim, *plays])
    started.given |= {"port": link, "wait_for_port": "15.0"}
    _skin(started)


def _body(started: _Started) -> None:
    if far := min(started.config.elsewhere, default=""):
        raise LaunchError(
            f"{started.config.path}: {SKINS}: {far}: {ELSEWHERE} = true: other computers are heard "
            "on ROS only: ros2 launch tactile_skin body.launch.yaml"
        )
    started.node(BODY, "wait_for_port", "method", "separate")
    if started.wants(_GATE):
        started.node(_GATE, "stamped")
    if started.wants(MONITOR):
        started.node(MONITOR, "stamped", "duration")
    if started.wants(VIEW):
        started.node(VIEW, **_OF_VIEW)


_FILES: dict[str, Callable[[_Started], None]] = {
    "skin.launch.yaml": _skin,
    "demo.launch.yaml": _demo,
    "body.launch.yaml": _body,
}


def _arguments_of(name: str) -> list[Argument]:
    """Return the arguments that a file of the package declares, and those of what it includes."""
    path = share_dir() / "launch" / name
    entities = read_yaml(path)["launch"]
    found = [
        Argument(a["name"], a.get("default"), a["description"])
        for a in (entity["arg"] for entity in entities if "arg" in entity)
    ]
    for argument in found:
        if argument.default is not None:
            argument.default = argument.default.replace(_SHARE, str(share_dir()))
    for include in (e["include"] for e in entities if name.startswith("demo") and "include" in e):
        said = {a.name for a in found} | {a["name"] for a in include["arg"]}
        found += [a for a in _arguments_of(Path(include["file"]).name) if a.name not in said]
    return found


def _shipped(path) -> str:
    """Return the name of a launch file that is the package's own."""
    name = Path(path).name
    if name not in _FILES or Path(path).resolve() != (share_dir() / "launch" / name).resolve():
        raise LaunchError(
            f"launch file {path}: must be {', '.join(_FILES)} of the package: ros2 launch starts "
            "others; nodes of your own stand under `nodes` of the config, or come by skin.add()"
        )
    return name
