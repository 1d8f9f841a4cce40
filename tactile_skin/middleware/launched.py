# SPDX-License-Identifier: Apache-2.0
"""What a launch file gives its nodes; what is wrong names the file."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

from ..errors import LaunchError, ParameterError, TopicTypeError
from ..msg import Twist, TwistStamped
from .bus import Context, Node
from .package import CLASSES, NODES
from .parameter_file import SHARED, ParameterFile, unknown_of, unknown_parameter, values_for
from .plan import NodeAction, Plan

_SIMULATED = "use_sim_time"
_ONE_THREAD = ("compensation", "gesture_feature")  # strictly sequential


def given(action: NodeAction) -> dict:
    """Return the arguments of a node that a launch file names."""
    return {
        "namespace": action.namespace,
        "remappings": action.remappings,
        "parameter_overrides": values_for(action.full_name, action.parameters),
    }


def make_node(action: NodeAction, context: Context) -> Node:
    """Return a node of the bus with the names, remappings and parameters of a launch file."""
    arguments = given(action)
    simulated = [p for p in arguments["parameter_overrides"] if p.name == _SIMULATED]
    if any(p.value is not False for p in simulated):
        raise LaunchError(f"{action.file}: {_SIMULATED}: must be false: /clock is on ROS only")
    for p in simulated:
        arguments["parameter_overrides"].remove(p)
    return Node(action.name, context=context, **arguments)


def by_thread(nodes: list[NodeAction], handles: list[Node]) -> list[list[Node]]:
    """Return the nodes by thread: a skin's compensation and its features share one."""
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
    """Return the full name of each node -> {parameter: value}."""
    return {
        handle.get_fully_qualified_name(): {
            name: handle.get_parameter(name).value for name in handle.parameter_names()
        }
        for handle in handles
    }


def check_parameters(plan: Plan, names: Mapping[str, frozenset[str] | None]) -> None:
    """Refuse parameters that nothing has.

    Args:
        names: full name of each node of the plan -> names of its parameters; None: it says which
            once it is made.

    Raises:
        LaunchError: naming the file and the parameter.
        ParameterError: as `ParameterFile.check` and `check_meant`.
    """
    for action in plan.nodes:
        own = names[action.full_name]
        known = plan.for_all | (own or frozenset())
        for item in action.parameters if own is not None else ():
            if not isinstance(item, ParameterFile):
                _refuse_unknown(item.source or str(action.file), [item.name], known)
                continue
            item.check_meant(action.full_name)
            for section, values in item.sections.items() if item.by_launch else ():
                _refuse_unknown(item.name_of(section), values, known)
    lasts = {name.rsplit("/", 1)[-1]: own for name, own in names.items()}
    for file in plan.files():
        if file.by_launch:
            continue
        file.check(lasts)
        for section, values in file.sections.items():
            shared = [name for name in values if name.split(".")[0] in SHARED]
            if section.rsplit("/", 1)[-1] in CLASSES and shared:
                raise LaunchError(
                    f"{file.name_of(section)}: {shared[0]}: belongs under /**, since "
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
        names = error.parameters if isinstance(error, ParameterError) else ()
        files = [
            p.source
            for p in values_for(action.full_name, action.parameters)
            if p.source and any(f"{p.name}.".startswith(f"{name}.") for name in names)
        ]
        files += [action.full_name] if action.namespace and not files else []  # of which skin
        if not files:
            raise
        raise LaunchError(f"{', '.join(dict.fromkeys(files))}: {error}") from error
