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
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import FileError, LaunchError, is_unknown
from ..files import shorten
from ..yaml_files import parse_yaml, read_yaml
from .bus import Parameter
from .package import BODY, COMPOSED, MONITOR, PACKAGE, PARTS, RECORDER, VIEW, share_dir
from .parameter_file import CONFIG, ELSEWHERE, SKINS, ParameterFile
from .plan import NodeAction, Plan, user_node, which_run


@dataclass
class Argument:
    name: str
    default: str | None
    description: str


RECORD = Argument("record", "", "MCAP file to record all topics to, or folder/ for such files")
_SHARE = f"$(find-pkg-share {PACKAGE})"  # the only substitution in the default of an argument
_NAMESPACE = re.compile(r"/?([A-Za-z_]\w*/?)*", re.ASCII)
_OF_BOARD = "port", "wait_for_port"  # arguments of a skin that the demo has of its own


def _alike(*names: str) -> dict[str, str]:
    return {name: name for name in names}


_NUMBERS = "duration", "wait_for_port", "view_port"  # refused before a board is started
_OF_VIEW = {"view_host": "host", "view_port": "port", "view_controls": "controls"}
_OF_SKIN: dict[str, dict[str, str]] = {  # node -> argument that it takes -> parameter
    **{part: _alike("use_sim_time") for part in PARTS},
    "serial_driver": _alike("use_sim_time", *_OF_BOARD),
    "compensation": _alike("use_sim_time", "method"),
    "cmd_vel_gate": _alike("use_sim_time", "stamped"),
    "push_to_move": _alike("use_sim_time", "stamped"),
    MONITOR: _alike("use_sim_time", "stamped", "duration"),
    VIEW: _alike("use_sim_time") | _OF_VIEW,
}
_OF_BODY = {
    BODY: _alike("wait_for_port", "method", "separate"),
    "cmd_vel_gate": _alike("stamped"),
    MONITOR: _alike("stamped", "duration"),
    VIEW: _OF_VIEW,
}
_SKIN, _DEMO, _BODY = (f"{name}.launch.yaml" for name in ("skin", "demo", "body"))
_FILES = {_SKIN: _OF_SKIN, _DEMO: _OF_SKIN, _BODY: _OF_BODY}


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
    plan, given = Plan(), _filled_in(path, arguments)
    config, name = ParameterFile(given[CONFIG], own=True), Path(path).name
    namespace = given.get("namespace", "")
    if not _NAMESPACE.fullmatch(namespace):
        where = f"{path}: namespace = {shorten(namespace)}"
        raise LaunchError(f"{where}: must be names between slashes")
    if name == _BODY and config.elsewhere:
        raise LaunchError(
            f"{config.path}: {SKINS}: {min(config.elsewhere)}: {ELSEWHERE} = true: other computers "
            "are heard on ROS only: ros2 launch tactile_skin body.launch.yaml"
        )
    if name == _DEMO:
        plan.commands.append(_board(given))
    _is_true(path, "separate", given)  # of processes; of a skin on ROS alone
    asked = {node: _is_true(path, node, given) for node in _FILES[name] if node in given}
    program = () if name == _BODY else ("/" + f"{namespace}/{COMPOSED}".strip("/"),)
    said = {p.name: p.value for p in config.overrides(*program)}
    runs = which_run(said | asked) | asked
    for node, takes in _FILES[name].items():
        # an empty text is that of an argument that was not given: what the file says holds
        own = {parameter: argument for argument, parameter in takes.items() if given[argument]}
        parameters: list[ParameterFile | Parameter] = [config]
        parameters += [Parameter(p, _value(path, text, given)) for p, text in own.items()]
        if runs.get(node, True):
            names = program if node in PARTS else ()
            plan.add(NodeAction(node, node, namespace, parameters, [], Path(path), names))
    for listed in config.nodes:
        plan.add(user_node(**listed, files=[config]))
    if record := given[RECORD.name]:  # it hears all nodes, and is given the files that they have
        to = Parameter("path", record)
        plan.add(NodeAction(RECORDER, RECORDER, "", [*plan.files(), to], file=Path(path)))
    return plan


def _filled_in(path, arguments: Mapping[str, object]) -> dict[str, str]:
    """Return the text of each argument that the file takes: the given one, or its default."""
    known = {argument.name: argument for argument in read_arguments(path)}
    if none := [name for name, value in arguments.items() if value is None]:
        raise LaunchError(f"argument {none[0]} = None: give a value, or leave it out")
    if unknown := sorted(arguments.keys() - known):
        raise LaunchError(f"{path}: argument {unknown[0]!r} {is_unknown(unknown[0], known)}")
    given = {name: str(value) for name, value in arguments.items()}
    for argument in known.values():
        if argument.default is None and argument.name not in given:
            wanted = f"{argument.name}: give {argument.name}:=value"
            raise LaunchError(f"{path}: {wanted}, {argument.description}")
        given.setdefault(argument.name, argument.default or "")
    return given


def _board(given: dict[str, str]) -> list[str]:
    """Return the command of the demo's board, whose port the skin is given."""
    link = f"{tempfile.gettempdir()}/skin_{os.getpid()}_{uuid.uuid4().hex[:8]}/board"
    given |= zip(_OF_BOARD, (link, "15.0"), strict=True)
    sim = [sys.executable, "-m", PACKAGE, "sim", "--once", f"--link={link}"]
    return [*sim, f"--scene={given['scene']}", f"--{CONFIG}={given[CONFIG]}"]


def _is_true(path, name: str, given: Mapping[str, str]) -> bool:
    if (said := given[name].strip().lower()) not in ("true", "false", "1", "0"):
        raise LaunchError(f"{path}: {name} = {shorten(given[name])}: must be true or false")
    return said in ("true", "1")


def _value(path, name: str, given: Mapping[str, str]):
    """Return the value of an argument: a text is read as YAML, as ROS 2 does."""
    text = given[name]
    where = f"{path}: {name} = {shorten(text)}"
    try:
        value = parse_yaml(text, where)
    except FileError as error:
        raise LaunchError(str(error)) from error
    if name in _NUMBERS and type(value) not in (int, float):
        raise LaunchError(f"{where}: must be a number")
    return value


def _arguments_of(name: str) -> list[Argument]:
    """Return the arguments that a file of the package declares; the demo has the skin's as well."""
    entities = read_yaml(share_dir() / "launch" / name)["launch"]
    found = [
        Argument(a["name"], a.get("default"), a["description"])
        for a in (entity["arg"] for entity in entities if "arg" in entity)
    ]
    for argument in found:
        if argument.default is not None:
            argument.default = argument.default.replace(_SHARE, str(share_dir()))
    said = {*_OF_BOARD, *(argument.name for argument in found)}
    more = _arguments_of(_SKIN) if name == _DEMO else []
    return found + [argument for argument in more if argument.name not in said]


def _shipped(path) -> str:
    """Return the name of a launch file that is the package's own."""
    name = Path(path).name
    if name not in _FILES or Path(path).resolve() != (share_dir() / "launch" / name).resolve():
        raise LaunchError(
            f"launch file {path}: must be {', '.join(_FILES)} of the package: ros2 launch starts "
            "others; nodes of your own stand under `nodes` of the config, or come by skin.add()"
        )
    return name
