"""What a launch file gives its nodes; what is wrong names the file."""

from __future__ import annotations

import contextlib
import re

from ..errors import LaunchError, ParameterError, TopicTypeError
from ..msg import Twist
from .bus import Context, Node, Parameter
from .config import SHARED, ParameterFile
from .launch_file import CLASSES, NodeAction


def make_node(action: NodeAction, context: Context) -> Node:
    """A node of the bus with the names, remappings and parameters of a launch file."""
    full_name = f"{action.namespace}/{action.name}"
    values: dict[str, Parameter] = {}
    for item in action.parameters:
        from_file = isinstance(item, ParameterFile)
        found = item.overrides(full_name) if from_file else [Parameter(*item)]
        values |= {p.name: p for p in found}
    return Node(
        action.name,
        context=context,
        cli_args=remaps(action.remappings),
        namespace=action.namespace,
        parameter_overrides=list(values.values()),
    )


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
    names = {h.get_fully_qualified_name() for h in handles}
    # One file may serve several launches: sections of nodes that this one does not start.
    absent = {f"/{name}" for name in set(CLASSES) - {a.kind for a in nodes}}
    for action, handle in zip(nodes, handles, strict=True):
        own = set(handle.undeclared())
        for item in action.parameters:
            if not isinstance(item, ParameterFile):
                if item[0] in own:
                    raise _unknown(str(action.file), item[0], handle.parameter_names())
                continue
            for section, values in item.sections.items():
                shared = [k for k in values if k.split(".")[0] in SHARED]
                if section != "/**" and shared:
                    raise LaunchError(
                        f"{item.path}: {section}: {shared[0]}: belongs under /**, since "
                        "several nodes must agree on it"
                    )
                full = "/" + section.lstrip("/")
                if section != "/**" and full not in names | absent:
                    there = ", ".join(sorted(name[1:] for name in names))
                    raise LaunchError(
                        f"{item.path}: {section}: no such node in this launch; there are: {there}"
                    )
                mine = full == handle.get_fully_qualified_name()
                allowed = declared if section == "/**" else set(handle.parameter_names())
                unknown = sorted(set(values) - allowed)
                if unknown and (mine or section == "/**"):
                    raise _unknown(f"{item.path}: {section}", unknown[0], allowed)


def check_commands(handles: list[Node]) -> None:
    """Refuse two nodes that would command one base in turns."""
    senders: dict[str, str] = {}
    for handle in handles:
        for publisher in handle.publishers:
            if publisher.msg_type is Twist:
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
            if isinstance(item, ParameterFile):
                names, file = [p.name for p in item.overrides(full_name)], item.path
            else:  # other errors, of the port say, are not the launch file's
                names, file = [item[0]], action.file if isinstance(error, ParameterError) else None
            if any(name.split(".")[-1] in words for name in names):
                if file is None:
                    break
                raise LaunchError(f"{file}: {error}") from error
        raise


def remaps(pairs: list[tuple[str, str]]) -> list[str]:
    return [word for pair in pairs for word in ("-r", ":=".join(pair))]


def _unknown(where: str, key: str, allowed) -> LaunchError:
    return LaunchError(
        f"{where}: parameter {key!r} is unknown; there are: {', '.join(sorted(allowed))}"
    )
