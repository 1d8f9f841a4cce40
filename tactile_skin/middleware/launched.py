"""What a launch file gives its nodes; what is wrong names the file."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from pathlib import Path

from ..errors import LaunchError, ParameterError, TopicTypeError
from ..msg import Twist, TwistStamped
from .bus import Context, Node, Parameter
from .launch_file import NodeAction
from .package import CLASSES, NODES
from .parameter_file import SHARED, THEIRS, ParameterFile, concerns, unknown_parameter

_SIMULATED = "use_sim_time"
_ONE_THREAD = ("compensation", "gesture_feature")  # strictly sequential


def make_node(action: NodeAction, context: Context) -> Node:
    """A node of the bus with the names, remappings and parameters of a launch file."""
    arguments = given(action)
    overrides = arguments["parameter_overrides"]
    if any(p.name == _SIMULATED and p.value is not False for p in overrides):
        raise LaunchError(f"{action.file}: {_SIMULATED}: must be false: /clock is on ROS only")
    arguments["parameter_overrides"] = [p for p in overrides if p.name != _SIMULATED]
    return Node(action.name, context=context, **arguments)


def given(action: NodeAction) -> dict:
    """The arguments of a node that a launch file names: namespace, remappings, parameters."""
    full_name = f"{action.namespace}/{action.name}"
    values: dict[str, Parameter] = {}
    for item in action.parameters:
        from_file = isinstance(item, ParameterFile)
        found = item.overrides(full_name) if from_file else [Parameter(*item)]
        values |= {p.name: p for p in found}
    return {
        "namespace": action.namespace,
        "cli_args": remaps(action.remappings),
        "parameter_overrides": list(values.values()),
    }


def by_thread(nodes: list[NodeAction], handles: list[Node]) -> list[list[Node]]:
    """The nodes by thread: a skin's compensation and its features share one."""
    groups: dict = {}
    for action, handle in zip(nodes, handles, strict=True):
        shared = action.kind in _ONE_THREAD
        key = handle.get_namespace() if shared else handle.get_fully_qualified_name()
        groups.setdefault((shared, key), []).append((action.kind, handle))
    order = {name: k for k, name in enumerate(NODES)}  # a user's node has its own thread
    return [
        [handle for _, handle in sorted(group, key=lambda item: order.get(item[0], 0))]
        for group in groups.values()
    ]


def parameters_of(handles: list[Node]) -> dict[str, dict]:
    """Full name of each node -> {parameter: value}."""
    return {
        handle.get_fully_qualified_name(): {
            name: handle.get_parameter(name).value for name in handle.parameter_names()
        }
        for handle in handles
    }


def check_overrides(nodes: list[NodeAction], handles: list[Node]) -> None:
    """Refuse names in parameter files and launch files that no node knows."""
    declared = {name for handle in handles for name in handle.parameter_names()}
    for action, handle in zip(nodes, handles, strict=True):
        own = set(handle.parameter_names())
        check_names(action, handle.get_fully_qualified_name(), own, declared)
    check_files(nodes, handles)


def check_files(nodes: list[NodeAction], handles: list[Node]) -> None:
    """Refuse a parameter file with sections and names that are of no node.

    One file may serve several launches: for nodes that this one does not start, and other
    namespaces.
    """
    declared = {name for handle in handles for name in handle.parameter_names()}
    files = [p for action in nodes for p in action.parameters if isinstance(p, ParameterFile)]
    for file in dict.fromkeys(files):
        if not file.by_launch:
            file.check([handle.get_name() for handle in handles], declared)


def check_names(
    action: NodeAction, full_name: str, own: set[str], every: set[str] | None = None
) -> None:
    """Refuse parameters of one node that nothing has.

    Args:
        own: names of its parameters.
        every: what `/**` may say; None: anything, it may be meant for other nodes.

    Raises:
        LaunchError: naming the file and the parameter.
    """
    for item in action.parameters:
        if not isinstance(item, ParameterFile):
            if item[0] not in own and not item[0].startswith(THEIRS):
                raise _unknown(str(action.file), item[0], own)
            continue
        item.check_meant(full_name)
        for section, values in item.sections.items():
            last = section.rsplit("/", 1)[-1]
            everyone = last in ("*", "**")
            shared = [k for k in values if k.split(".")[0] in SHARED]
            if last in CLASSES and shared:
                raise LaunchError(
                    f"{item.name_of(section)}: {shared[0]}: belongs under /**, since "
                    "several nodes must agree on it"
                )
            allowed = every if everyone else own
            names = [name for name in values if not name.startswith(THEIRS)]
            unknown = sorted(set(names) - allowed) if allowed is not None else []
            if unknown and concerns(section, full_name):
                raise _unknown(item.name_of(section), unknown[0], allowed)


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
def naming_its_file(action: NodeAction, handle: Node, kind: Callable):
    """Put the file that a refused parameter or remapping is from in front of the error.

    Args:
        kind: what makes the node of its handle.
    """
    full_name = handle.get_fully_qualified_name()
    try:
        yield
    except TopicTypeError as error:
        raise LaunchError(f"{action.file}: node {full_name}: {error}: check remap") from error
    except ValueError as error:
        if action.user is None:  # a misspelt name is the mistake, what it leads to is not
            known = Node(action.name, context=Context())
            with contextlib.suppress(ValueError, OSError):
                close(kind(known))
            check_names(action, full_name, {*known.parameter_names(), *handle.parameter_names()})
        words = set(re.findall(r"\w+", str(error)))
        for item in reversed(action.parameters):
            names: list[str]
            file: Path | None
            if isinstance(item, ParameterFile):
                names, file = [p.name for p in item.overrides(full_name)], item.path
            else:  # other errors, of the port say, are not the launch file's
                names, file = [item[0]], action.file if isinstance(error, ParameterError) else None
            if any(name.split(".")[-1] in words for name in names):
                if file is None:
                    break
                raise LaunchError(f"{file}: {error}") from error
        raise


def close(node) -> None:
    """End what a node has begun: the server of a page, a serial port."""
    if hasattr(node, "close"):
        node.close()


def remaps(pairs: list[tuple[str, str]]) -> list[str]:
    return [word for pair in pairs for word in ("-r", ":=".join(pair))]


def _unknown(where: str, key: str, allowed) -> LaunchError:
    return LaunchError(unknown_parameter(where, key, allowed))
