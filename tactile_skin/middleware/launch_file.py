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
from typing import Any

from ..errors import FileError, LaunchError, did_you_mean
from ..files import shorten
from ..yaml_files import parse_yaml, read_yaml
from .package import COMPOSED, FOXGLOVE, NODES, PACKAGE, RECORDER, share_dir
from .parameter_file import CONFIG, ParameterFile
from .processes import tool_path
from .user_nodes import UserNode, find_user_node

_SEPARATE = "separate"  # argument of a launch file: a process for each node


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


_LIFETIME = {"respawn", "respawn_delay", "on_exit"}  # of a process of its own
_KEYS = {  # entity -> keys that it must have, others that are understood, others that are ignored
    "arg": ({"name"}, {"default", "description"}, set[str]()),
    "let": ({"name", "value"}, set[str](), set[str]()),
    "node": (
        {"pkg", "exec"},
        {"name", "namespace", "param", "remap", "if", "unless"},
        {"output", *_LIFETIME},
    ),
    "executable": ({"cmd"}, {"if", "unless"}, {"output", "name", *_LIFETIME}),
    "include": ({"file"}, {"arg", "if", "unless"}, set[str]()),
}
_ALLOWED = {  # what a text is -> how it must look, in words
    "name": (re.compile(r"[A-Za-z_]\w*", re.ASCII), "of letters, digits and _"),
    "namespace": (re.compile(r"/?([A-Za-z_]\w*/?)*", re.ASCII), "names between slashes"),
    "topic": (re.compile(r"(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII), "a topic"),
}


def read_plan(path, arguments: dict[str, str], in_process: bool = True) -> Plan:
    """Read a launch file and fill in its arguments.

    Args:
        in_process: the nodes will share this process; then the argument `separate`, by which a
            launch file asks ROS for a process per node, is true: each is a node of the plan.

    Raises:
        LaunchError: an unknown entity, key, substitution or argument, or a value that is missing.
    """
    given = dict(arguments)
    record, live = (given.pop(a.name, a.default) for a in (RECORD, LIVE))
    reader = _Reader(given | ({_SEPARATE: "true"} if in_process else {}), in_process)
    reader.file(Path(path))
    plan = reader.plan
    if unknown := sorted(given.keys() - plan.arguments):
        meant = did_you_mean(unknown[0], plan.arguments)
        raise LaunchError(f"{path}: argument {unknown[0]!r} is unknown{meant}")
    plan.arguments |= {a.name: a for a in (RECORD, LIVE)}
    if _is_true(live, f"{path}: {LIVE.name}: if"):
        plan.nodes.append(_observer(FOXGLOVE, plan, Path(path)))
    if record:
        plan.nodes.append(_observer(RECORDER, plan, Path(path), ("path", record)))
    return plan


def _observer(kind: str, plan: Plan, file: Path, *given: tuple[str, str | None]) -> NodeAction:
    """Return a node that hears all others, with the parameter files that they have."""
    files = [p for action in plan.nodes for p in action.parameters if isinstance(p, ParameterFile)]
    return NodeAction(kind, kind, "", [*dict.fromkeys(files), *given], [], file)


class _Reader:
    """Reads a launch file and what it includes.

    As in ROS 2, an included file sees all arguments, and what is set stays.
    """

    def __init__(self, variables: dict[str, str], in_process: bool):
        self.plan = Plan()
        self._variables, self._in_process = variables, in_process
        self._set: set[str] = set()  # names that launch files themselves have set
        self._anonymous: dict[str, str] = {}
        self._parameter_files: dict[str, ParameterFile] = {}
        self._including: list[Path] = []  # the file that is read, and those around it

    def file(self, path: Path) -> None:
        """Carry out the entities of a launch file."""
        try:
            data = read_yaml(path)
        except OSError as error:
            raise LaunchError(f"launch file {path}: {error.strerror}") from error
        except FileError as error:
            raise LaunchError(f"launch file {error}") from error
        if path.resolve() in self._including:
            raise LaunchError(f"launch file {path}: includes itself, by {self._including[-1]}")
        if not (isinstance(data, dict) and set(data) == {"launch"}) or not isinstance(
            data["launch"], list
        ):
            raise LaunchError(f"launch file {path}: must hold one list named launch")
        self._including.append(path.resolve())
        for entity in data["launch"]:
            kind, body = _checked(entity, path)
            where = f"{path}: {kind}"
            if self._wanted(body, path, where):
                getattr(self, f"_{kind}")(body, path, where)
        self._including.pop()

    def _wanted(self, body: dict, path: Path, where: str) -> bool:
        return all(
            _is_true(self._fill(body[key], path, f"{where}: {key}"), f"{where}: {key}") is wish
            for key, wish in (("if", True), ("unless", False))
            if key in body
        )

    def _arg(self, body: dict, path: Path, where: str) -> None:
        name = _named(body["name"], "name", f"{where}: name")
        default = None
        if "default" in body:
            default = self._fill(body["default"], path, f"{where}: default")
        argument = Argument(name, default, str(body.get("description", "")))
        if name not in self._set:
            self.plan.arguments.setdefault(name, argument)
        if name not in self._variables:
            if default is None:
                raise LaunchError(f"{path}: argument {name} has no default: give {name}:=value")
            self._variables[name] = default

    def _let(self, body: dict, path: Path, where: str) -> None:
        name = _named(body["name"], "name", f"{where}: name")
        self._variables[name] = self._fill(body["value"], path, f"{where}: value")
        self._set.add(name)

    def _executable(self, body: dict, path: Path, where: str) -> None:
        text = self._fill(body["cmd"], path, f"{where}: cmd")
        try:
            words = shlex.split(text)
        except ValueError as error:  # an open quote
            raise LaunchError(f"{where}: cmd = {shorten(text)}: {error}") from error
        if not words or not words[0]:
            raise LaunchError(f"{where}: cmd = {shorten(text)}: must name a program")
        self.plan.commands.append(words)

    def _include(self, body: dict, path: Path, where: str) -> None:
        for item in _maps(body, "arg", {"name", "value"}, where):
            self._let(item, path, f"{where}: arg")
        self.file(Path(self._fill(body["file"], path, f"{where}: file")))

    def _node(self, body: dict, path: Path, where: str) -> None:
        package = self._fill(body["pkg"], path, f"{where}: pkg")
        executable = self._fill(body["exec"], path, f"{where}: exec")
        there, user = NODES if self._in_process else (COMPOSED, *NODES), None
        if package == PACKAGE and executable not in there:
            raise LaunchError(
                f"{where} {package}/{executable}: exec: must be one of {', '.join(there)}"
            )
        if package != PACKAGE:
            try:
                user = find_user_node(package, executable)
            except LaunchError as error:
                raise LaunchError(f"{path}: {error}; start other programs as executable") from error
        where = f"{where} {executable}"

        def named(value, what: str, key: str) -> str:
            filled = self._fill(value, path, key) if isinstance(value, str) else value
            return _named(filled, what, f"{where}: {key}")

        parameters: list[ParameterFile | tuple[str, Any]] = []
        for item in _maps(body, "param", None, where):
            if set(item) == {"from"}:
                parameters.append(
                    self._parameter_file(self._fill(item["from"], path, f"{where}: param: from"))
                )
            elif set(item) != {"name", "value"}:
                raise LaunchError(f"{where}: param {shorten(item)}: needs from, or name, value")
            elif item["name"] == CONFIG and user is None:
                parameters.append(
                    self._parameter_file(
                        self._fill(item["value"], path, f"{where}: param {CONFIG}")
                    )
                )
            elif (
                value := self._value(item["value"], path, f"{where}: param {item['name']}")
            ) != "":
                parameters.append((str(item["name"]), value))
        remappings = [
            (named(item["from"], "topic", "remap: from"), named(item["to"], "topic", "remap: to"))
            for item in _maps(body, "remap", {"from", "to"}, where)
        ]
        name = named(body.get("name", executable), "name", "name")
        namespace = named(body.get("namespace", ""), "namespace", "namespace")
        self.plan.nodes.append(
            NodeAction(executable, name, namespace, parameters, remappings, path, user)
        )

    def _parameter_file(self, name: str) -> ParameterFile:
        """Return the parameter file of this name; one serves all nodes."""
        if name not in self._parameter_files:
            self._parameter_files[name] = ParameterFile(name, own=True)
        return self._parameter_files[name]

    def _value(self, value, path: Path, where: str):
        """Return a parameter's value: a text is read as YAML, as ROS 2 does.

        An empty text is that of an argument that was not given: what stands before it holds.
        """
        if not isinstance(value, str) or not (text := self._fill(value, path, where)):
            return value if not isinstance(value, str) else ""
        try:
            return parse_yaml(text, f"{where} = {shorten(text)}")
        except FileError as error:
            raise LaunchError(str(error)) from error

    def _fill(self, value, path: Path, where: str) -> str:
        """Return the text of a value, its substitutions carried out."""
        if not isinstance(value, (str, int, float)):
            raise LaunchError(f"{where} = {shorten(value)}: must be text or a number")
        return substitute(str(value), self._variables, path, self._anonymous)


def _checked(entity, path: Path) -> tuple[str, dict]:
    """Return an entity's kind and keys, which are understood and complete."""
    if not isinstance(entity, dict) or len(entity) != 1:
        raise LaunchError(f"{path}: {shorten(entity)}: must be one of {', '.join(_KEYS)}")
    ((kind, body),) = entity.items()
    if kind not in _KEYS:
        raise LaunchError(f"{path}: {kind}: not understood; must be one of {', '.join(_KEYS)}")
    if not isinstance(body, dict):
        raise LaunchError(f"{path}: {kind}: must map keys to values")
    needed, optional, ignored = _KEYS[kind]
    known = needed | optional | ignored
    if unknown := sorted(body.keys() - known):
        raise LaunchError(
            f"{path}: {kind}: key {unknown[0]!r} is not understood; "
            f"must be one of {', '.join(sorted(known))}"
        )
    if missing := sorted(needed - body.keys()):
        raise LaunchError(f"{path}: {kind}: needs the key {missing[0]!r}")
    return kind, body


def _maps(body: dict, key: str, keys: set[str] | None, where: str) -> list[dict]:
    """Return a list of maps, each with these keys; None: any."""
    items = body.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise LaunchError(f"{where}: {key} = {shorten(items)}: must be a list of maps")
    for item in items:
        if keys is not None and set(item) != keys:
            needs = " and ".join(sorted(keys))
            raise LaunchError(f"{where}: {key} {shorten(item)}: needs {needs}")
    return items


def _named(value, what: str, where: str) -> str:
    pattern, allowed = _ALLOWED[what]
    if not isinstance(value, str) or not pattern.fullmatch(value):
        raise LaunchError(f"{where} = {shorten(value)}: must be {allowed}")
    return value


def _is_true(text: str | None, where: str) -> bool:
    if (said := str(text).strip().lower()) not in ("true", "false", "1", "0"):
        raise LaunchError(f"{where} = {shorten(text)}: must be true or false")
    return said in ("true", "1")


# --- substitutions ---

_SUBSTITUTION = re.compile(r"\$\(([\w-]+)((?:\s+[^()\s]+)*)\)")


def substitute(text: str, variables: dict, path: Path, anonymous: dict) -> str:
    """Fill in $(var x), $(env X default), $(dirname), $(anon x), $(find-pkg-share pkg) and
    $(exec-in-pkg x pkg)."""

    def value(found: re.Match) -> str:
        match [found[1], *found[2].split()]:
            case ["var", name]:
                if name not in variables:
                    known = ", ".join(variables) or "none"
                    raise LaunchError(f"{path}: $(var {name}): not known here; there are: {known}")
                return variables[name]
            case ["env", name, *default] if len(default) <= 1:
                if (there := os.environ.get(name, *default)) is None:
                    raise LaunchError(f"{path}: $(env {name}): not set, and no default given")
                return there
            case ["dirname"]:
                return str(path.resolve().parent)
            case ["anon", name]:
                return anonymous.setdefault(name, f"{name}_{os.getpid()}_{uuid.uuid4().hex[:8]}")
            case ["find-pkg-share", package] if package == PACKAGE:
                return str(share_dir())
            case ["exec-in-pkg", name, package] if package == PACKAGE:
                return _program(name, path)
        raise LaunchError(
            f"{path}: {found[0]}: not understood; must be $(var x), $(env X [default]), "
            f"$(dirname), $(anon x), $(find-pkg-share {PACKAGE}) or $(exec-in-pkg x {PACKAGE})"
        )

    filled = _SUBSTITUTION.sub(value, text)
    if "$(" in filled:
        raise LaunchError(f"{path}: {text!r}: a substitution that is not understood")
    return filled


def _program(name: str, path: Path) -> str:
    """Return how to start the package's command: as it was installed, else by this Python."""
    if name != "tactile-skin":
        raise LaunchError(f"{path}: {PACKAGE} has no program {name!r}; there is: tactile-skin")
    built = share_dir().parents[1] / "lib" / PACKAGE / name
    if built.exists():
        return shlex.quote(str(built))
    if shutil.which(name, path=tool_path()):
        return name
    return f"{shlex.quote(sys.executable)} -m {PACKAGE}"
