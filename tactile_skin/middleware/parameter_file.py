# SPDX-License-Identifier: Apache-2.0
"""Parameter files of ROS 2: sections for nodes, their parameters, and what is misspelt in them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import SUCCESSORS, FileError, ParameterError
from ..files import shorten
from ..yaml_files import Map, read_yaml
from .bus import Parameter
from .package import CLASSES, COMPOSED, NODES, SKIN_NODES

SHARED = ("circuit", "curve", "geometry")  # parameters that several nodes read
# parameters that ROS itself declares and takes; what ends with a point is a prefix
THEIRS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
SKINS = "skins"  # key of the skins of a body, not of a node
ELSEWHERE = "elsewhere"  # key of a skin whose nodes run on another computer
OWN_NODES = "nodes"  # key of the nodes of a user's that run beside the skin's
CONFIG = "config"  # parameter of a program: its parameter file, which must be there
_PORT = "port"  # of a skin's board
_OF_SKIN = (*SHARED, "frame_id", _PORT)  # what a skin of a body may state of itself
_OF_NODE: dict[str, type] = {  # key of a node of a user's -> what it is
    "class": str,  # module.Class; the others may be left out
    "name": str,
    "namespace": str,
    "parameters": dict,
    "remap": dict,
}
_SKIN_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)


@dataclass(frozen=True)
class Section:
    """Parameters of a file, and the nodes that they are for.

    Attributes:
        name: as the file has it, the file in front.
        namespace: of the node; None: any.
        node: its name; "": all nodes.
        values: parameter -> value.
        of_skin: it stands under `skins`.
        lines: parameter -> its line in the file.
    """

    name: str
    namespace: str | None
    node: str
    values: dict
    of_skin: bool = False
    lines: dict = field(default_factory=dict, compare=False)

    def line(self, name: str, where: str = "") -> str:
        """Return where a parameter stands: the section, or what is given for it, and the line."""
        return (where or self.name) + (f": line {self.lines[name]}" if name in self.lines else "")

    def concerns(self, full_name: str) -> bool:
        """Whether it is for the node of this full name."""
        space, _, name = full_name.strip("/").rpartition("/")
        return self.namespace in (None, space) and self.node in ("", name)


class ParameterFile:
    """A ROS 2 parameter file: ``node_name: {ros__parameters: {...}}``, ``/**`` for every node.

    Each is for every node, ``/**``; for a node in any namespace, ``/**/stop_on_push``; or for the
    one of this full name, which may stand within its namespace.

    ``skins:`` names those of a body. What a skin has, circuit, curve, geometry, port and the
    parameters of nodes by their names, is for the nodes in its namespace, and wins over what its
    own file says, which it names as ``config``. ``elsewhere: true``: another computer runs them.

    ``nodes:`` lists nodes of a user's for the same process, each with its ``class`` in a module.

    Args:
        own: it is the skin's own, named as its `config`: all of it must be known. Another may serve
            other nodes of the robot as well.

    Attributes:
        skins: their names.
        nodes: of a user's: what `user_node` takes of each.
        elsewhere: of those of them that another computer runs.
        sections: what they are given; the later wins.

    Raises:
        FileError: not such a file, or none; the message names the file and the key.
    """

    def __init__(self, path, own: bool = False):
        self.path, self.own = Path(path), own
        try:
            data = read_yaml(path)
        except OSError as error:
            raise FileError(f"parameter file {path}: {error.strerror}") from error
        if not (isinstance(data, dict) and data):
            what = f"holds {shorten(data)}" if data else "is empty"
            raise FileError(f"{path}: {what}: must map node names to ros__parameters")
        self.sections: list[Section] = []
        skins = data.pop(SKINS, {})
        listed = data.pop(OWN_NODES, [])
        if not isinstance(listed, list):
            raise FileError(f"{path}: {OWN_NODES} = {shorten(listed)}: must be a list of maps")
        self.nodes = [self._own_node(node) for node in listed]
        for name, section in data.items():
            self._read(name, section)
        if not isinstance(skins, dict):
            raise FileError(f"{path}: {SKINS} = {shorten(skins)}: must map names to skins")
        self.skins, self.elsewhere = tuple(skins), set[str]()
        for name, given in skins.items():
            self._read_skin(name, given)

    def _own_node(self, given) -> dict:
        where = f"{self.path}: {OWN_NODES}: {shorten(given)}"
        if not isinstance(given, dict) or "class" not in given:
            raise FileError(f"{where}: must be a list of maps, each with class: module.Class")
        for key, value in given.items():
            if key not in _OF_NODE or not isinstance(value, _OF_NODE[key]):
                known = ", ".join(f"{name} ({kind.__name__})" for name, kind in _OF_NODE.items())
                raise FileError(f"{where}: {key}: must be one of {known}")
        named = {key: given[key] for key in ("name", "namespace") if key in given}
        named["parameters"] = _flat(given.get("parameters", {}), where)
        return {"node": given["class"], "remappings": given.get("remap", {}).items()} | named

    def _read(self, name: str, section) -> None:
        below = section if isinstance(section, dict) else {}
        if "ros__parameters" not in below and any(isinstance(v, dict) for v in below.values()):
            for key, value in below.items():  # a namespace
                self._read(f"{name.rstrip('/')}/{key.lstrip('/')}", value)
            return
        if set(below) != {"ros__parameters"}:
            above, _, key = name.rpartition("/")
            of_body = above and key in (*_OF_SKIN, CONFIG)
            hint = f"; the skins of a body stand under {SKINS}, each by its name" if of_body else ""
            raise FileError(
                f"{self.path}: {name}: must hold ros__parameters and nothing else{hint}"
            )
        where = f"{self.path}: {name}"
        space, _, node = name.strip("/").rpartition("/")
        namespace = None if space == "**" or (space, node) == ("", "**") else space
        node = "" if (space, node) == ("", "**") else node
        ours = self.own or node in CLASSES or "*" in node
        if ours and "*" in f"{namespace or ''}{node}":
            raise FileError(
                f"{where}: must be /**, /**/NODE or a node's full name; what is of a namespace "
                f"stands under {SKINS}, by its name"
            )
        values = section["ros__parameters"]
        flat = _flat({} if values is None else values, where)
        read = Section(where, namespace, node, flat, lines=_lines(values))
        for other in self.sections:
            if (other.namespace, other.node) == (read.namespace, read.node):
                other_name = other.name.removeprefix(f"{self.path}: ")
                raise FileError(f"{where}: is the section {other_name} again")
        self.sections.append(read)

    def _read_skin(self, name: str, given) -> None:
        """Take a skin of the body as sections of its namespace."""
        where = f"{self.path}: {SKINS}: {name}"
        if not _SKIN_NAME.fullmatch(str(name)) or not isinstance(given, dict):
            raise FileError(f"{where}: must be a name of letters, digits and _ that maps to values")
        nodes: dict[str, dict] = {}
        shared: dict = {}
        for key, value in given.items():
            if key == CONFIG:
                continue
            if key == ELSEWHERE:
                if not isinstance(value, bool):
                    raise FileError(f"{where}: {key} = {shorten(value)}: must be true or false")
                self.elsewhere |= {name} if value else set()
            elif key in SKIN_NODES:
                nodes.setdefault(key, {}).update(_flat(value, f"{where}: {key}"))
            elif key == _PORT:
                nodes.setdefault("serial_driver", {})[_PORT] = value
            elif key in _OF_SKIN:
                shared |= _flat({key: value}, where)
            else:
                known = ", ".join((*_OF_SKIN, CONFIG, ELSEWHERE, *SKIN_NODES))
                raise FileError(f"{where}: {key}: must be one of {known}")
        if file := given.get(CONFIG):
            own = ParameterFile(self.path.parent / str(file), own=True)
            if own.skins:
                raise FileError(f"{where}: {file}: must be one skin's, and holds {SKINS}")
            self.sections += [
                Section(f"{where}: {one.name}", name, one.node, one.values, True, one.lines)
                for one in own.sections
                if not one.namespace
            ]
        self.sections.append(Section(where, name, "", shared, True))  # later, and so it wins
        for node, values in nodes.items():
            self.sections.append(Section(f"{where}: {node}", name, node, values, True))

    def overrides(self, *nodes: str) -> list[Parameter]:
        """Return what the file says for a node and its programs; what comes later in it wins."""
        found: dict[str, Parameter] = {}
        for section in self.sections:
            if any(section.concerns(name) for name in nodes):
                source = "" if section.of_skin else str(self.path)
                for k, value in section.values.items():
                    found[k] = Parameter(k, value, section.line(k, source))
        return list(found.values())

    def check(
        self, nodes: Mapping[str, Collection[str] | None], programs: Collection[str] = ()
    ) -> None:
        """Refuse what is misspelt, and a file that is of another package.

        Args:
            nodes: name of each node that runs -> names of its parameters; None: not known yet.
            programs: names of those that run them.
        """
        from ..parameters.nodes import own_names, shared_names  # here: reading a file needs none

        shared = shared_names()
        known: dict[str, Collection[str] | None] = {n: own_names(n) | shared for n in CLASSES}
        known |= nodes
        everyone = shared.union(*filter(None, known.values()))
        if not self.own:  # it may also be for a program that runs elsewhere
            programs = [*programs, COMPOSED]
        known |= dict.fromkeys(programs, everyone | NODES.keys())
        said_later = None in known.values()
        foreign = not any(section.node in {"", *known} for section in self.sections)
        for section in self.sections:
            if section.node and section.node not in known:
                if self.own or foreign:
                    there = f"no such node; there are: {', '.join(sorted(known))}"
                    what = SUCCESSORS.get(section.node, there)
                    raise ParameterError(f"{section.name}: {what}")
                continue
            allowed = known[section.node] if section.node else everyone
            if allowed is None or (not section.node and said_later and not section.of_skin):
                continue
            for name in unknown_of(section.values, allowed):
                lacks_group = any(other.endswith(f".{name}") for other in allowed)
                of_skin = section.node or self.own or name.split(".")[0] in SHARED
                if of_skin or lacks_group:
                    raise ParameterError(unknown_parameter(section.line(name), name, allowed))

    def check_skin(self, node: str) -> None:
        """Refuse a body's file for the node of a skin that it does not name."""
        of_one = self.skins and last_of(node) in SKIN_NODES
        if of_one and not any(s.of_skin and s.concerns(node) for s in self.sections):
            raise ParameterError(
                f"{self.path}: {SKINS}: {', '.join(self.skins)}: is the file of a body, and {node} "
                "is of none of them: launch body.launch.yaml, or give the file of one skin"
            )

    def check_meant(self, node: str, *programs: str) -> None:
        """Refuse a file whose sections for this name are all of other namespaces.

        ROS would run the node on its defaults, and not say so.
        """
        self.check_skin(node)
        for full in (node, *programs):
            name = last_of(full)
            alike = [s for s in self.sections if s.node == name and not s.of_skin]
            if alike and not any(section.concerns(full) for section in alike):
                raise ParameterError(
                    f"{' and '.join(section.name for section in alike)}: is not for the node {full}"
                    f": must be /**/{name}, for any namespace, or {full}"
                )


def last_of(full_name: str) -> str:
    """Return the name of a node or section without its namespace."""
    return full_name.rsplit("/", 1)[-1]


def unknown_of(names: Iterable[str], known: Collection[str]) -> list[str]:
    """Return the names that are neither known nor ROS's own."""
    return [name for name in names if name not in known and not name.startswith(THEIRS)]


def unknown_parameter(where: str, name: str, known: Collection[str]) -> str:
    """Return the message that refuses a parameter which nothing has, with those of its group."""
    group = name.rpartition(".")[0]
    near = [k for k in known if k.rpartition(".")[0] == group or k.endswith(f".{name}")]
    return f"{where}: parameter {name!r} is unknown; there are: {', '.join(sorted(near or known))}"


def sources_of(given: Iterable[Parameter], error: ValueError) -> str:
    """Return where what an error refuses is given: files, of one or two values with their lines."""
    names = error.parameters if isinstance(error, ParameterError) else ()
    sources = [
        p.source
        for p in given
        if p.source and any(f"{p.name}.".startswith(f"{name}.") for name in names)
    ]
    if len(set(sources)) > 2:
        sources = [source.partition(": line ")[0] for source in sources]
    return ", ".join(dict.fromkeys(sources))


def _lines(tree, under: str = "") -> dict[str, int]:
    """{"circuit": {"rows": 8}} of a file -> {"circuit.rows": its line}."""
    found: dict[str, int] = {}
    for key, value in tree.items() if isinstance(tree, Map) else ():
        below = _lines(value, f"{under}{key}.")
        found |= below or ({f"{under}{key}": tree.lines[key]} if key in tree.lines else {})
    return found


def _flat(tree, where: str, under: str = "") -> dict:
    """{"circuit": {"rows": 8}} -> {"circuit.rows": 8}."""
    if not isinstance(tree, dict):
        raise FileError(f"{where} = {shorten(tree)}: must map names to values")
    flat: dict = {}
    for key, value in tree.items():
        name = f"{under}{key}"
        below = _flat(value, where, f"{name}.") if isinstance(value, dict) else {name: value}
        if twice := below.keys() & flat:
            raise FileError(f"{where}: {min(twice)} is given twice")
        flat |= below
    return flat
