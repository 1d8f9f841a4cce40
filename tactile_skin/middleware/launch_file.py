# SPDX-License-Identifier: Apache-2.0
"""ROS 2's YAML launch format, as far as it is needed; what is unknown is refused by name."""

from __future__ import annotations

import os
import re
import shlex
import sys
import uuid
from collections.abc import Mapping
from pathlib import Path

from ..errors import FileError, LaunchError, did_you_mean
from ..files import shorten
from ..yaml_files import parse_yaml, read_yaml
from .bus import Parameter
from .package import BODY, COMPOSED, FOXGLOVE, NODES, PACKAGE, RECORDER, share_dir
from .parameter_file import CONFIG, ELSEWHERE, SKINS, ParameterFile
from .plan import Argument, NodeAction, Plan, with_skins

RECORD = Argument("record", "", "MCAP file to record all topics to, or folder/ for such files")
LIVE = Argument("foxglove", "false", "serve all topics to the Foxglove app")

_PROCESS = {"output", "respawn", "respawn_delay", "on_exit"}  # of one that ROS starts: ignored
_CONDITIONS = {"if", "unless"}
_KEYS = {  # entity -> keys that it must have, others that it may have
    "arg": ({"name"}, {"default", "description"}),
    "let": ({"name", "value"}, set[str]()),
    "node": ({"pkg", "exec"}, {"name", "namespace", "param", "remap"} | _CONDITIONS | _PROCESS),
    "executable": ({"cmd"}, _PROCESS),
    "include": ({"file"}, {"arg"} | _CONDITIONS),
}
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_NAMESPACE = re.compile(r"/?([A-Za-z_]\w*/?)*", re.ASCII)
_TOPIC = re.compile(r"(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_ALLOWED = {
    _NAME: "of letters, digits and _",
    _NAMESPACE: "names between slashes",
    _TOPIC: "a topic",
}
_SUBSTITUTION = re.compile(r"\$\(([\w-]+)((?:\s+[^()\s]+)*)\)")


def read_arguments(path) -> list[Argument]:
    """Return the arguments that a launch file takes; starts nothing, and needs none of them.

    Raises:
        LaunchError: as `read_plan`.
    """
    reader = _Reader({}, starts=False)
    reader.file(Path(path))
    return [*reader.plan.arguments.values(), RECORD, LIVE]


def read_plan(path, arguments: Mapping[str, object]) -> Plan:
    """Read a launch file and fill in its arguments: texts, or what has the text of one.

    Raises:
        LaunchError: an unknown entity, key, substitution or argument, or a value that is missing.
    """
    if none := [name for name, value in arguments.items() if value is None]:
        raise LaunchError(f"argument {none[0]} = None: give a value, or leave it out")
    given = {name: str(value) for name, value in arguments.items()}
    record, live = (given.pop(a.name, a.default) for a in (RECORD, LIVE))
    reader = _Reader(dict(given))
    reader.file(Path(path))
    plan = reader.plan
    if unknown := sorted(given.keys() - plan.arguments):
        meant = did_you_mean(unknown[0], plan.arguments)
        raise LaunchError(f"{path}: argument {unknown[0]!r} is unknown{meant}")
    plan.arguments |= {a.name: a for a in (RECORD, LIVE)}
    files = plan.files()  # an observer hears all nodes, and is given the files that they have
    if _is_true(live, f"{path}: {LIVE.name}"):
        plan.programs.append(NodeAction(FOXGLOVE, FOXGLOVE, "", [*files], [], Path(path)))
    if record:
        to = Parameter("path", record)
        plan.programs.append(NodeAction(RECORDER, RECORDER, "", [*files, to], [], Path(path)))
    return plan


class _Reader:
    """Reads a launch file and what it includes.

    As in ROS 2, an included file sees all arguments, and what is set stays.

    Args:
        starts: whether the plan is to have nodes and commands, and not only arguments.
    """

    def __init__(self, variables: dict[str, str], starts: bool = True):
        self.plan = Plan()
        self._starts = starts
        self._variables = variables
        self._set: set[str] = set()  # names that launch files themselves have set
        self._anonymous: dict[str, str] = {}
        self._parameter_files: dict[str, ParameterFile] = {}
        self._including: list[Path] = []  # the file that is read is the last, those around it first

    def file(self, path: Path) -> None:
        """Carry out the entities of a launch file."""
        try:
            data = read_yaml(path)
        except OSError as error:
            raise LaunchError(f"launch file {path}: {error.strerror}") from error
        except FileError as error:
            raise LaunchError(f"launch file {error}") from error
        if any(path.resolve() == other.resolve() for other in self._including):
            raise LaunchError(f"launch file {path}: includes itself, by {self._including[-1]}")
        entities = data.get("launch") if isinstance(data, dict) and len(data) == 1 else None
        if not isinstance(entities, list):
            raise LaunchError(f"launch file {path}: must hold one list named launch")
        self._including.append(path)
        for entity in entities:
            kind, body = _checked(entity, path)
            where = f"{path}: {kind}"
            if (self._starts or kind not in ("node", "executable")) and self._wanted(body, where):
                getattr(self, f"_{kind}")(body, where)
        self._including.pop()

    def _wanted(self, body: dict, where: str) -> bool:
        return all(
            _is_true(self._text(body, key, where), f"{where}: {key}") is wish
            for key, wish in (("if", True), ("unless", False))
            if key in body
        )

    def _arg(self, body: dict, where: str) -> None:
        name = self._named(body, "name", where, _NAME)
        default = self._text(body, "default", where) if "default" in body else None
        argument = Argument(name, default, str(body.get("description", "")))
        if name not in self._set:
            self.plan.arguments.setdefault(name, argument)
        if name not in self._variables:
            if default is None and self._starts:
                raise LaunchError(f"{where}: {name} has no default: give {name}:=value")
            self._variables[name] = default or ""

    def _let(self, body: dict, where: str) -> None:
        name = self._named(body, "name", where, _NAME)
        self._variables[name] = self._text(body, "value", where)
        self._set.add(name)

    def _executable(self, body: dict, where: str) -> None:
        text = self._text(body, "cmd", where, self._word)
        try:
            words = shlex.split(text)
        except ValueError as error:  # an open quote
            raise LaunchError(f"{where}: cmd = {shorten(text)}: {error}") from error
        if not words or not words[0]:
            raise LaunchError(f"{where}: cmd = {shorten(text)}: must name a program")
        self.plan.commands.append(words)

    def _include(self, body: dict, where: str) -> None:
        for item in _items(body, "arg", {"name", "value"}, where):
            self._let(item, f"{where}: arg")
        self.file(Path(self._text(body, "file", where)))

    def _node(self, body: dict, where: str) -> None:
        package, executable = (self._text(body, key, where) for key in ("pkg", "exec"))
        where = f"{where} {executable}"
        if package == PACKAGE and executable not in (*NODES, COMPOSED):
            raise LaunchError(f"{where}: exec: must be one of {', '.join((*NODES, COMPOSED))}")
        action = NodeAction(executable, executable, file=self._including[-1], package=package)
        if "name" in body:
            action.name = self._named(body, "name", where, _NAME)
        if "namespace" in body:
            action.namespace = self._named(body, "namespace", where, _NAMESPACE)
        for item in _items(body, "param", None, where):
            if "from" in item:
                action.parameters.append(self._parameter_file(item, "from", where))
            elif item["name"] == CONFIG and package == PACKAGE:
                action.parameters.append(self._parameter_file(item, "value", where))
            elif (value := self._value(item, where)) != "":
                action.parameters.append(Parameter(str(item["name"]), value))
        for item in _items(body, "remap", {"from", "to"}, where):
            source, to = (
                self._named(item, key, f"{where}: remap", _TOPIC) for key in ("from", "to")
            )
            action.remappings.append((source, to))
        self.plan.programs += [action] if action.kind == COMPOSED else with_skins(action)
        for file in self._parameter_files.values() if action.kind == BODY else ():
            if far := min(file.elsewhere, default=""):
                raise LaunchError(
                    f"{file.path}: {SKINS}: {far}: {ELSEWHERE} = true: other computers are heard "
                    "on ROS only: ros2 launch tactile_skin body.launch.yaml"
                )

    def _parameter_file(self, item: dict, key: str, where: str) -> ParameterFile:
        """Return the parameter file of this name; one serves all nodes."""
        name = self._text(item, key, f"{where}: param")
        if name not in self._parameter_files:
            self._parameter_files[name] = ParameterFile(name, own=True)
        return self._parameter_files[name]

    def _value(self, item: dict, where: str):
        """Return a parameter's value: a text is read as YAML, as ROS 2 does.

        An empty text is that of an argument that was not given: what stands before it holds.
        """
        if not isinstance(item["value"], str):
            return item["value"]
        text = self._text(item, "value", where)
        try:
            given = f"{where}: param {item['name']} = {shorten(text)}"
            return parse_yaml(text, given) if text else ""
        except FileError as error:
            raise LaunchError(str(error)) from error

    def _named(self, body: dict, key: str, where: str, pattern: re.Pattern) -> str:
        text = self._text(body, key, where)
        if not pattern.fullmatch(text):
            raise LaunchError(f"{where}: {key} = {shorten(text)}: must be {_ALLOWED[pattern]}")
        return text

    def _text(self, body: dict, key: str, where: str, substitute=None) -> str:
        """Return the text of a value, its substitutions carried out."""
        value = body[key]
        if not isinstance(value, (str, int, float)):
            raise LaunchError(f"{where}: {key} = {shorten(value)}: must be text or a number")
        filled = _SUBSTITUTION.sub(substitute or self._substitute, str(value))
        if "$(" in filled:
            raise LaunchError(f"{where}: {key} = {shorten(value)}: $( is not understood")
        return filled

    def _word(self, found: re.Match) -> str:
        """Return what stands in a command: as in ROS, a space in it begins no other word."""
        text = self._substitute(found)
        quoted = found.string[: found.start()].endswith(("'", '"'))
        return text if quoted or not text or found[1] == "exec-in-pkg" else shlex.quote(text)

    def _substitute(self, found: re.Match) -> str:
        path = self._including[-1]
        match [found[1], *found[2].split()]:
            case ["var", name]:
                if name not in self._variables:
                    known = ", ".join(self._variables) or "none"
                    raise LaunchError(f"{path}: $(var {name}): not known here; there are: {known}")
                return self._variables[name]
            case ["env", name, *default] if len(default) <= 1:
                if (there := os.environ.get(name, *default)) is None:
                    raise LaunchError(f"{path}: $(env {name}): not set, and no default given")
                return there
            case ["dirname"]:
                return str(path.resolve().parent)
            case ["anon", name]:
                unique = f"{name}_{os.getpid()}_{uuid.uuid4().hex[:8]}"
                return self._anonymous.setdefault(name, unique)
            case ["find-pkg-share", package] if package == PACKAGE:
                return str(share_dir())
            case ["exec-in-pkg", "tactile-skin", package] if package == PACKAGE:
                return f"{shlex.quote(sys.executable)} -m {PACKAGE}"
        raise LaunchError(
            f"{path}: {found[0]}: not understood; must be $(var x), $(env X [default]), $(dirname),"
            f" $(anon x), $(find-pkg-share {PACKAGE}) or $(exec-in-pkg tactile-skin {PACKAGE})"
        )


def _checked(entity, path: Path) -> tuple[str, dict]:
    """Return an entity's kind and keys, which are understood and complete."""
    if not isinstance(entity, dict) or len(entity) != 1:
        raise LaunchError(f"{path}: {shorten(entity)}: must be one of {', '.join(_KEYS)}")
    ((kind, body),) = entity.items()
    if kind not in _KEYS:
        raise LaunchError(f"{path}: {kind}: not understood; must be one of {', '.join(_KEYS)}")
    _check_keys(body, *_KEYS[kind], f"{path}: {kind}")
    return kind, body


def _items(body: dict, key: str, keys: set[str] | None, where: str) -> list[dict]:
    """Return a list of maps, each with these keys; None: those of a parameter."""
    items = body.get(key, [])
    if not isinstance(items, list):
        raise LaunchError(f"{where}: {key} = {shorten(items)}: must be a list of maps")
    for item in items:
        from_file = isinstance(item, dict) and "from" in item
        _check_keys(
            item,
            keys or ({"from"} if from_file else {"name", "value"}),
            set(),
            f"{where}: {key} {shorten(item)}",
        )
    return items


def _check_keys(body, needed: set[str], optional: set[str], where: str) -> None:
    if not isinstance(body, dict):
        raise LaunchError(f"{where}: must map keys to values")
    known = needed | optional
    if unknown := sorted(body.keys() - known):
        raise LaunchError(
            f"{where}: key {unknown[0]!r} is not understood; "
            f"must be one of {', '.join(sorted(known))}"
        )
    if missing := sorted(needed - body.keys()):
        raise LaunchError(f"{where}: needs the key {missing[0]!r}")


def _is_true(text: str | None, where: str) -> bool:
    if (said := str(text).strip().lower()) not in ("true", "false", "1", "0"):
        raise LaunchError(f"{where} = {shorten(text)}: must be true or false")
    return said in ("true", "1")
