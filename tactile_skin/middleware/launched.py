"""What a launch file gives its nodes; what is wrong names the file."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterable
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
    action: NodeAction, full_name: str, own: Collection[str], process: Collection[str] | None = None
) -> None:
    """Refuse parameters of one node that nothing has.

    What a file says to all nodes may be meant for others: `check_files`.

    Args:
        own: names of its parameters.
        process: names that may be given to all nodes of its process; None: its own.

    Raises:
        LaunchError: naming the file and the parameter.
    """
    from ..parameters.nodes import shared_names

    given = own if process is None else process
    for item in action.parameters:
        if not isinstance(item, ParameterFile):
            _refuse_unknown(str(action.file), [item[0]], given)
            continue
        item.check_meant(full_name)
        for section, values in item.sections.items():
            last = section.rsplit("/", 1)[-1]
            shared = [name for name in values if name.split(".")[0] in SHARED]
            if last in CLASSES and shared:
                raise LaunchError(
                    f"{item.name_of(section)}: {shared[0]}: belongs under /**, since "
                    "several nodes must agree on it"
                )
            if concerns(section, full_name):
                if last not in ("*", "**"):
                    _refuse_unknown(item.name_of(section), values, own)
                elif item.by_launch:
                    _refuse_unknown(item.name_of(section), values, given)
                else:
                    _refuse_unknown(item.name_of(section), shared, shared_names())


def _refuse_unknown(where: str, names: Iterable[str], known: Collection[str]) -> None:
    unknown = [name for name in names if name not in known and not name.startswith(THEIRS)]
    if unknown:
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
def naming_its_file(action: NodeAction, full_name: str):
    """Put the file that a refused parameter or remapping is from in front of the error."""
    try:
        yield
    except TopicTypeError as error:
        raise LaunchError(f"{action.file}: node {full_name}: {error}: check remap") from error
    except ValueError as error:
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
