"""ROS 2's YAML launch format, as far as it is needed; what is unknown is refused by name."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
import uuid
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import FileError, LaunchError, did_you_mean
from ..files import shorten
from ..yaml_files import parse_yaml, read_yaml
from .package import COMPOSED, FOXGLOVE, NODES, PACKAGE, RECORDER, share_dir
from .parameter_file import CONFIG, ParameterFile
from .processes import tool_path
from .user_nodes import UserNode, find_user_node

_SEPARATE = "separate"  # argument of a launch file: a process for each node
_MAX_FILES = 30  # launch files of one launch: includes may double at each level
_MAX_TEXT = 10_000  # characters of a filled-in value: it may double with each let


@dataclass
class Argument:
    name: str
    default: str | None
    description: str


RECORD = Argument("record", "", "MCAP file to record all topics to, or folder/ for such files")
LIVE = Argument("foxglove", "false", "serve all topics to the Foxglove app")


@dataclass
class NodeAction:
    executable: str
    name: str
    namespace: str
    parameters: list  # in order: ParameterFile or (name, value)
    remappings: list[tuple[str, str]]
    file: Path = Path()  # the launch file
    user: UserNode | None = None  # None: a node of this package

    @property
    def kind(self) -> str:
        """Which node it is: a name in NODES, or package/executable of a user's."""
        return f"{self.user.package}/{self.executable}" if self.user else self.executable


@dataclass
class Plan:
    """What a launch file, with its arguments filled in, asks for."""

    nodes: list[NodeAction] = field(default_factory=list)
    commands: list[list[str]] = field(default_factory=list)
    arguments: dict[str, Argument] = field(default_factory=dict)


_LIFETIME = ("respawn", "respawn_delay", "on_exit")  # of a process of its own
_KEYS = {  # entity -> keys that are understood; of these, the last tuple's say nothing in-process
    "arg": ({"name", "default", "description"}, set()),
    "let": ({"name", "value"}, set()),
    "node": (
        {"pkg", "exec", "name", "namespace", "param", "remap", "if", "unless"},
        {"output", *_LIFETIME},
    ),
    "executable": ({"cmd", "if", "unless"}, {"output", "name", *_LIFETIME}),
    "include": ({"file", "arg", "if", "unless"}, set()),
}


def read_plan(path, arguments: dict[str, str], in_process: bool = True) -> Plan:
    """Read a launch file and fill in its arguments.

    Args:
        in_process: the nodes will share this process; then the argument `separate`, by which a
            launch file asks ROS for a process per node, is true: each is a node of the plan.

    Raises:
        LaunchError: an unknown entity, key, substitution or argument, or a value that is missing.
    """
    plan, given = Plan(), dict(arguments)
    record, live = (given.pop(a.name, a.default) for a in (RECORD, LIVE))
    _read_file(str(path), given, plan, _Read(in_process))
    plan.arguments |= {a.name: a for a in (RECORD, LIVE)}
    if _wanted({"if": live}, lambda text, _: text, Path(path), LIVE.name):
        plan.nodes.append(_observer(FOXGLOVE, plan, Path(path)))
    if record:
        plan.nodes.append(_observer(RECORDER, plan, Path(path), ("path", record)))
    return plan


def _observer(kind: str, plan: Plan, file: Path, *given: tuple[str, str]) -> NodeAction:
    """A node that hears all others, with the parameter files that they have."""
    files = [p for action in plan.nodes for p in action.parameters if isinstance(p, ParameterFile)]
    return NodeAction(kind, kind, "", [*dict.fromkeys(files), *given], [], file)


@dataclass
class _Read:
    """What the files of one launch share while they are read."""

    in_process: bool
    anonymous: dict[str, str] = field(default_factory=dict)
    parameter_files: dict[str, ParameterFile] = field(default_factory=dict)
    including: list[str] = field(default_factory=list)  # the file being read, and those around it
    files: int = 0

    def parameter_file(self, name: str) -> ParameterFile:
        """Return the parameter file of this name; one serves all nodes."""
        if name not in self.parameter_files:
            self.parameter_files[name] = ParameterFile(name, own=True)
        return self.parameter_files[name]


def _read_file(name: str, given: dict[str, str], plan: Plan, read: _Read) -> None:
    path = Path(name)
    try:
        data = read_yaml(name)
    except OSError as error:
        raise LaunchError(f"launch file {path}: {error.strerror}") from error
    except FileError as error:
        raise LaunchError(f"launch file {error}") from error
    here = os.path.realpath(path)
    if here in read.including:
        raise LaunchError(f"launch file {path}: includes itself, by {read.including[-1]}")
    read.files += 1
    if read.files > _MAX_FILES:
        raise LaunchError(f"launch file {path}: one too many: must be at most {_MAX_FILES}")
    read.including.append(here)
    if (
        not isinstance(data, dict)
        or set(data) != {"launch"}
        or not isinstance(data["launch"], list)
    ):
        raise LaunchError(f"launch file {path}: must hold one list named launch")
    variables = {}
    declared = {}

    def fill(value, key):
        text = substitute(_text(value, path, key), variables, path, read.anonymous)
        if len(text) > _MAX_TEXT:
            raise LaunchError(
                f"{path}: {key} = {shorten(text)}: must be at most {_MAX_TEXT} characters"
            )
        return text

    for entity in data["launch"]:
        if not isinstance(entity, dict) or len(entity) != 1:
            raise LaunchError(f"{path}: {shorten(entity)}: must be one of {', '.join(_KEYS)}")
        ((kind, body),) = entity.items()
        if kind not in _KEYS:
            raise LaunchError(f"{path}: {kind}: not understood; must be one of {', '.join(_KEYS)}")
        if not isinstance(body, dict):
            raise LaunchError(f"{path}: {kind}: must map keys to values")
        known, ignored = _KEYS[kind]
        unknown = sorted(set(body) - known - ignored)
        if unknown:
            raise LaunchError(
                f"{path}: {kind}: key {unknown[0]!r} is not understood; "
                f"must be one of {', '.join(sorted(known | ignored))}"
            )
        if not _wanted(body, fill, path, kind):
            continue
        if kind == "arg":
            name, default = _name(body, path, kind), body.get("default")
            if name in declared:
                raise LaunchError(f"{path}: arg: name = {name!r}: there are two of this name")
            declared[name] = Argument(
                name,
                None if default is None else fill(default, "arg: default"),
                _text(body.get("description", ""), path, "arg: description"),
            )
            value = given.get(name, declared[name].default)
            if name == _SEPARATE and read.in_process:
                value = "true"
            if value is None:
                raise LaunchError(f"{path}: argument {name} has no default: give {name}:=value")
            variables[name] = value
        elif kind == "let":
            name = _name(body, path, kind)
            variables[name] = fill(_need(body, "value", path, kind), "let: value")
        elif kind == "executable":
            plan.commands.append(_command(fill(_need(body, "cmd", path, kind), "cmd"), path))
        elif kind == "include":
            passed = {}
            for item in _maps(body, "arg", path, kind):
                if set(item) != {"name", "value"}:
                    raise LaunchError(f"{path}: include: arg {shorten(item)}: needs name and value")
                name = _name(item, path, "include: arg")
                if name in passed:
                    raise LaunchError(f"{path}: include: arg {name!r}: is given twice")
                passed[name] = fill(item["value"], f"include: arg {name}")
            _read_file(fill(_need(body, "file", path, kind), "include: file"), passed, plan, read)
        else:
            plan.nodes.append(_node(body, fill, path, read))
    unknown = sorted(set(given) - set(declared))
    if unknown:
        meant = did_you_mean(unknown[0], declared)
        raise LaunchError(f"{path}: argument {unknown[0]!r} is unknown{meant}")
    read.including.pop()
    if not read.including:
        plan.arguments = declared


_ARGUMENT = re.compile(r"[\w.-]+", re.ASCII)
_NODE_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_NAMESPACE = re.compile(r"/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*/?)?", re.ASCII)
_TOPIC = re.compile(r"(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def _text(value, path: Path, key: str) -> str:
    """A value that stands for a text."""
    if not isinstance(value, (str, int, float)):
        raise LaunchError(f"{path}: {key} = {shorten(value)}: must be text or a number")
    return str(value)


def _name(body: dict, path: Path, kind: str) -> str:
    """The name of an argument, as $(var x) and x:=value can have it."""
    name = _need(body, "name", path, kind)
    if not isinstance(name, str) or not _ARGUMENT.fullmatch(name):
        raise LaunchError(
            f"{path}: {kind}: name = {shorten(name)}: must be of letters, digits and _.-"
        )
    return name


def _command(text: str, path: Path) -> list[str]:
    try:
        words = shlex.split(text)
    except ValueError as error:  # an open quote
        raise LaunchError(f"{path}: executable: cmd = {shorten(text)}: {error}") from error
    if not words or not words[0]:
        raise LaunchError(f"{path}: executable: cmd = {shorten(text)}: must name a program")
    return words


def _need(body: dict, key: str, path: Path, kind: str):
    if key not in body:
        raise LaunchError(f"{path}: {kind}: needs the key {key!r}")
    return body[key]


def _maps(body: dict, key: str, path: Path, kind: str) -> list[dict]:
    items = body.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise LaunchError(f"{path}: {kind}: {key} = {shorten(items)}: must be a list of maps")
    return items


def _wanted(body: dict, fill, path: Path, kind: str) -> bool:
    for key, wish in (("if", True), ("unless", False)):
        if key in body:
            text = fill(body[key], f"{kind}: {key}").strip().lower()
            if text not in ("true", "false", "1", "0"):
                asked = " = ".join([key, *dict.fromkeys(map(shorten, (body[key], text)))])
                raise LaunchError(f"{path}: {kind}: {asked}: must be true or false")
            if (text in ("true", "1")) is not wish:
                return False
    return True


def _node(body: dict, fill, path: Path, read: _Read) -> NodeAction:
    package, executable = (
        fill(_need(body, key, path, "node"), f"node: {key}") for key in ("pkg", "exec")
    )
    user = None
    there = NODES if read.in_process else (COMPOSED, *NODES)
    if package == PACKAGE and executable not in there:
        raise LaunchError(
            f"{path}: node {package}/{executable}: exec: must be one of {', '.join(there)}"
        )
    if package != PACKAGE:
        try:
            user = find_user_node(package, executable)
        except LaunchError as error:
            raise LaunchError(f"{path}: {error}; start other programs as executable") from error
    where = f"{path}: node {executable}"

    def named(value, key, pattern, allowed):
        """Of text that ROS takes as a name, filled in."""
        if isinstance(value, str) and pattern.fullmatch(text := fill(value, f"node: {key}")):
            return text
        raise LaunchError(f"{where}: {key} = {shorten(value)}: must be {allowed}")

    parameters = []
    for item in _maps(body, "param", path, "node"):
        if set(item) == {"from"}:
            parameters.append(read.parameter_file(fill(item["from"], "param: from")))
        elif item.get("name") == CONFIG and set(item) == {"name", "value"} and user is None:
            parameters.append(read.parameter_file(fill(item["value"], f"param {CONFIG}")))
        elif set(item) == {"name", "value"}:
            name = named(item["name"], "param: name", _ARGUMENT, "a parameter's name")
            if any(isinstance(other, tuple) and other[0] == name for other in parameters):
                raise LaunchError(f"{where}: param {name} is given twice")
            value = item["value"]
            if isinstance(value, str):  # ROS 2 reads a value that comes from a substitution as YAML
                text = fill(value, f"param {name}")
                if not text:  # of an argument that was not given: what stands before it holds
                    continue
                try:
                    value = parse_yaml(text, f"{where}: param {name} = {shorten(text)}")
                except FileError as error:
                    raise LaunchError(str(error)) from error
            parameters.append((name, value))
        else:
            raise LaunchError(f"{where}: param {shorten(item)}: needs from, or name, value")
    remappings = []
    for item in _maps(body, "remap", path, "node"):
        if set(item) != {"from", "to"}:
            raise LaunchError(f"{where}: remap {shorten(item)}: needs from and to")
        pair = (named(item[key], f"remap: {key}", _TOPIC, "a topic") for key in ("from", "to"))
        remappings.append(tuple(pair))
    if len(dict(remappings)) < len(remappings):
        raise LaunchError(f"{where}: remap: two from one topic: {shorten(remappings)}")
    name = body.get("name", executable)
    name = named(name, "name", _NODE_NAME, "of letters, digits and _, no digit first")
    namespace = named(body.get("namespace", ""), "namespace", _NAMESPACE, "names between slashes")
    return NodeAction(executable, name, namespace, parameters, remappings, path, user)


# --- substitutions ---

_SUBSTITUTION = re.compile(r"\$\(([\w-]+)((?:\s+[^()\s]+)*)\)")


def substitute(text: str, variables: dict, path: Path, anonymous: dict) -> str:
    """Fill in $(var x), $(env X default), $(dirname), $(anon x), $(find-pkg-share pkg) and
    $(exec-in-pkg x pkg)."""

    def value(match: re.Match) -> str:
        kind, words = match[1], match[2].split()
        if kind == "var" and len(words) == 1:
            if words[0] not in variables:
                known = ", ".join(variables) or "none"
                raise LaunchError(f"{path}: $(var {words[0]}): not known here; there are: {known}")
            return variables[words[0]]
        if kind == "env" and len(words) in (1, 2):
            found = os.environ.get(*words)
            if found is None:
                raise LaunchError(f"{path}: $(env {words[0]}): not set, and no default given")
            return found
        if kind == "dirname" and not words:
            return str(path.resolve().parent)
        if kind == "anon" and len(words) == 1:
            name = f"{words[0]}_{os.getpid()}_{uuid.uuid4().hex[:8]}"
            return anonymous.setdefault(words[0], name)
        if kind == "find-pkg-share" and words == [PACKAGE]:
            return str(share_dir())
        if kind == "exec-in-pkg" and len(words) == 2 and words[1] == PACKAGE:
            return _executable(words[0], path)
        raise LaunchError(
            f"{path}: {match[0]}: not understood; must be $(var x), $(env X [default]), "
            f"$(dirname), $(anon x), $(find-pkg-share {PACKAGE}) or $(exec-in-pkg x {PACKAGE})"
        )

    filled = _SUBSTITUTION.sub(value, text)
    if "$(" in filled:
        raise LaunchError(f"{path}: {text!r}: a substitution that is not understood")
    return filled


def _executable(name: str, path: Path) -> str:
    """How to start a program of the package: as colcon or pip installed it, else by this Python."""
    if name not in ("tactile-skin", COMPOSED, *NODES):
        there = ", ".join(("tactile-skin", COMPOSED, *NODES))
        raise LaunchError(f"{path}: {PACKAGE} has no program {name!r}; there are: {there}")
    built = share_dir().parents[1] / "lib" / PACKAGE / name
    if built.exists():
        return shlex.quote(str(built))
    if name == "tactile-skin" and shutil.which(name, path=tool_path()):
        return name
    module = f"{PACKAGE}.ros {name}" if name != "tactile-skin" else PACKAGE
    return f"{shlex.quote(sys.executable)} -m {module}"
