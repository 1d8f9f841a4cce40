# SPDX-License-Identifier: Apache-2.0
"""What is to be started: nodes, commands, and what nodes are given.

What is wrong names the file.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import LaunchError, ParameterError, TopicTypeError
from ..msg import Twist, TwistStamped
from .bus import Context, Node, Parameter
from .package import (
    BODY,
    CLASSES,
    COMPOSED,
    MONITOR,
    NODES,
    PARTS,
    SKIN_NODES,
    VIEW,
    node_class,
)
from .parameter_file import (
    SHARED,
    THEIRS,
    ParameterFile,
    last_of,
    sources_of,
    unknown_of,
    unknown_parameter,
)

_SIMULATED = "use_sim_time"
_ONE_THREAD = ("compensation", "gesture_feature")  # strictly sequential
_AUTO = "auto"  # a port
_NUMBER = "serial_number"
# nodes that learn what the skins are -> groups of a skin's parameters that they have
_OF_SKINS = {BODY: ("circuit", "geometry", "frame_id"), VIEW: SHARED, MONITOR: ()}


@dataclass
class NodeAction:
    """A node to be started.

    Attributes:
        executable: which one: a name in CLASSES, or module.Class of a user's.
    """

    executable: str
    name: str
    namespace: str = ""
    parameters: list[ParameterFile | Parameter] = field(default_factory=list)  # the last wins
    remappings: list[tuple[str, str]] = field(default_factory=list)
    file: Path = Path()  # that asks for it, for messages
    programs: tuple[str, ...] = ()  # full names of what runs it: what is for them is for it
    given_class: type | None = None  # of a user's node that is no text

    @property
    def ours(self) -> bool:
        """Whether it is one of the package's nodes."""
        return self.executable in CLASSES

    @property
    def made_by(self) -> type:
        """The class of the node (LaunchError: there is none)."""
        return self.given_class or node_class(self.executable, self.file)

    @property
    def full_name(self) -> str:
        """The node's name, its namespace in front."""
        return "/" + f"{self.namespace}/{self.name}".strip("/")

    def files(self) -> list[ParameterFile]:
        """Return the parameter files among what it is given."""
        return [p for p in self.parameters if isinstance(p, ParameterFile)]

    def singles(self) -> list[Parameter]:
        """Return the single parameters among what it is given."""
        return [p for p in self.parameters if isinstance(p, Parameter)]

    def given(self) -> list[Parameter]:
        """Return what files and single parameters say, the last for each name."""
        found = {}
        names = self.full_name, *self.programs
        for item in self.parameters:
            for p in item.overrides(*names) if isinstance(item, ParameterFile) else [item]:
                found[p.name] = p
        return list(found.values())

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of its Node, besides its name."""
        return {
            "namespace": self.namespace,
            "remappings": self.remappings,
            "parameter_overrides": self.given(),
        }

    def values(self) -> dict[str, Any]:
        """Return what it is given, name -> value."""
        return {p.name: p.value for p in self.given()}

    def give(self, values: Mapping[str, Any]) -> None:
        """Give it parameters, name -> value, over those that it has."""
        self.parameters += [Parameter(*item) for item in values.items()]


@dataclass
class Plan:
    """What a launch file, with its arguments filled in, starts."""

    nodes: list[NodeAction] = field(default_factory=list)
    commands: list[list[str]] = field(default_factory=list)

    def add(self, node: NodeAction) -> None:
        """Start another node; of a body with those of its skins."""
        self.nodes += with_skins(node)

    def files(self) -> list[ParameterFile]:
        """Return each parameter file that a node is given, once."""
        return list(dict.fromkeys(file for action in self.nodes for file in action.files()))


def user_node(
    node: type | str,
    parameters: Mapping[str, Any],
    name: str = "",
    namespace: str = "",
    remappings: Iterable[tuple[str, str]] = (),
    files: Sequence[ParameterFile] = (),
) -> NodeAction:
    """Return a node that a user adds: a class, module.Class, or the name of one of ours."""
    kind = node if isinstance(node, str) else f"{node.__module__}.{node.__qualname__}"
    action = NodeAction(kind, name or kind.rpartition(".")[2], namespace, [*files], [*remappings])
    action.file = files[0].path if files else Path("skin.add")
    action.given_class = node if isinstance(node, type) else None
    action.give(parameters)
    return action


def which_run(values: Mapping[str, Any]) -> dict[str, bool]:
    """Return which nodes the program `skin` is to run, by its parameters, name -> value."""
    wanted = PARTS | {name: value for name, value in values.items() if name in PARTS}
    for name, runs in wanted.items():
        if not isinstance(runs, bool):
            what = f"parameter {name} of {COMPOSED} = {runs!r}"
            raise ParameterError(f"{what}: must be true or false")
    return wanted


def shared_out(program: NodeAction, kinds, others=()) -> dict[str, list]:
    """Return what each of a program's nodes is given of its parameters; none must be left."""
    from ..parameters.nodes import all_names  # here: reading a launch file needs none

    has = {kind: all_names(kind) for kind in kinds}
    known = frozenset(others).union(*has.values())
    _refuse_unknown(
        f"{program.file}: {program.executable}", [p.name for p in program.singles()], known
    )
    return {
        kind: [
            p
            for p in program.parameters
            if isinstance(p, ParameterFile) or p.name in own or p.name.startswith(THEIRS)
        ]
        for kind, own in has.items()
    }


def with_skins(action: NodeAction) -> list[NodeAction]:
    """Return a node, which learns what each skin of its parameter file is; with a body, theirs too.

    A node in the namespace of a skin is of that one alone.
    """
    if action.executable not in _OF_SKINS:
        return [action]
    files = action.files()
    above = f"{action.namespace}/".lstrip("/")
    skins = {name: file for file in files for name in file.skins}
    if action.namespace.strip("/") in skins:
        return [action]
    spaces = {name: f"{above}{name}" for name in skins}
    nodes = _of_body(action, files, spaces) if action.executable == BODY else []
    given = [*action.parameters]
    if spaces:
        action.give({"skins": list(spaces)})
    for name, file in skins.items():
        has = NodeAction("compensation", "compensation", spaces[name], given).values().items()
        action.parameters += [
            Parameter(f"{name}.{key}", value, str(file.path))
            for key, value in has
            if key.split(".")[0] in _OF_SKINS[action.executable]
        ]
    return [*nodes, action]


def _of_body(body: NodeAction, files: list[ParameterFile], spaces: dict) -> list[NodeAction]:
    """Return the nodes of a body's skins, name -> namespace; a value is for those that have it."""
    if not spaces:
        raise LaunchError(f"{body.file}: {BODY}: needs config:=FILE, with the skins of the body")
    own = shared_out(body, (*SKIN_NODES, BODY))
    elsewhere = {name for file in files for name in file.elsewhere}
    nodes = [
        NodeAction(kind, kind, space, own[kind], [], body.file)
        for name, space in spaces.items()
        for kind in (() if name in elsewhere else SKIN_NODES)
    ]
    _check_boards({a.namespace: a.values() for a in nodes if a.executable == SKIN_NODES[0]})
    body.parameters = own[BODY]
    return nodes


def _check_boards(skins: Mapping[str, dict]) -> None:
    """Refuse skins, name -> what its serial_driver is given, whose boards nothing distinguishes."""
    from ..board.serial_port import devices  # here: only a body needs pyserial this early

    seen: dict[str, str] = {}  # device, or what stands for one that is not there yet -> whose it is
    for name, values in skins.items():
        port, number = (str(values.get(k, other)) for k, other in (("port", _AUTO), (_NUMBER, "")))
        if len(skins) > 1 and port == _AUTO and not number:
            raise LaunchError(
                f"skins: {name}: port {_AUTO} without {_NUMBER}: which board is its own is not "
                "known: run tactile-skin detect for each board, or give a port"
            )
        said = f"{_NUMBER} {number}" if port == _AUTO else f"port {port}"
        found = said, *devices(port, number)
        if other := next((seen[device] for device in found if device in seen), None):
            raise LaunchError(
                f"skins: {other} and {name}'s {said} are one board: each needs a port of its own, "
                f"or the {_NUMBER} of its board, which tactile-skin detect writes"
            )
        seen |= dict.fromkeys(found, f"{name}'s {said}")


def make_node(action: NodeAction, context: Context) -> Node:
    """Return a node of the bus with the names, remappings and parameters of a launch file."""
    if action.values().get(_SIMULATED, False) is not False:
        raise LaunchError(f"{action.file}: {_SIMULATED}: must be false: /clock is on ROS only")
    arguments = action.arguments()
    own = [p for p in arguments.pop("parameter_overrides") if p.name != _SIMULATED]
    return Node(action.name, context=context, parameter_overrides=own, **arguments)


def by_thread(nodes: list[NodeAction], handles: list[Node]) -> list[list[Node]]:
    """Return the nodes by thread: a skin's compensation and its features share one."""
    groups: dict = {}
    for action, handle in zip(nodes, handles, strict=True):
        shared = action.executable in _ONE_THREAD
        key = handle.get_namespace() if shared else handle.get_fully_qualified_name()
        groups.setdefault((shared, key), []).append((action.executable, handle))
    order = {name: k for k, name in enumerate(NODES)}  # a user's node has its own thread
    return [
        [handle for _, handle in sorted(group, key=lambda item: order.get(item[0], 0))]
        for group in groups.values()
    ]


def parameters_of(context: Context, space: str = "/") -> dict[str, dict]:
    """Return the full name of each node in a namespace -> {parameter: value}, if it has any."""
    return {
        node: {name: handle.get_parameter(name).value for name in handle.parameter_names()}
        for node, handle in dict(context.nodes).items()
        if node.startswith(space) and handle.parameter_names()
    }


def check_parameters(plan: Plan, names: Mapping[str, frozenset[str] | None]) -> None:
    """Refuse parameters that nothing has.

    Args:
        names: full name of each node of the plan -> names of its parameters; None: it says which
            once it is made.
    """
    for action in plan.nodes:
        if (known := names[action.full_name]) is None:
            continue
        for p in action.singles():
            _refuse_unknown(p.source or str(action.file), [p.name], known)
        for file in action.files():
            file.check_meant(action.full_name, *action.programs)
    lasts = {last_of(name): own for name, own in names.items()}
    programs = {last_of(name) for action in plan.nodes for name in action.programs}
    for file in plan.files():
        file.check(lasts, programs)
        for section in file.sections:
            shared = [name for name in section.values if name.split(".")[0] in SHARED]
            if section.node in CLASSES and shared:
                raise LaunchError(
                    f"{section.line(shared[0])}: {shared[0]}: belongs under /**, since "
                    "several nodes must agree on it"
                )


def _refuse_unknown(where: str, names, known) -> None:
    if unknown := unknown_of(names, known):
        raise LaunchError(unknown_parameter(where, min(unknown), known))


def check_commands(handles: list[Node]) -> None:
    """Refuse two nodes that would command one base in turns."""
    senders: dict[str, str] = {}
    for handle in handles:
        for publisher in handle.publishers:
            if publisher.msg_type in (Twist, TwistStamped):
                topic, name = publisher.topic_name, handle.get_name()
                if topic in senders:
                    raise LaunchError(
                        f"{topic}: {senders[topic]} and {name} both publish it: start one of "
                        "them, or remap each to an input of a multiplexer"
                    )
                senders[topic] = name


@contextlib.contextmanager
def naming_its_file(action: NodeAction):
    """Put the file that a refused parameter or remapping is from in front of the error."""
    try:
        yield
    except TopicTypeError as error:
        raise LaunchError(
            f"{action.file}: node {action.full_name}: {error}: check remap"
        ) from error
    except ValueError as error:
        where = sources_of(action.given(), error) or (action.full_name if action.namespace else "")
        if not where:
            raise
        raise LaunchError(f"{where}: {error}") from error  # of which skin, if no file says it
