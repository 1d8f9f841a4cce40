# SPDX-License-Identifier: Apache-2.0
"""Skins of a few nodes, where a test needs no more."""

from collections.abc import Sequence

from tactile_skin.launch import Plan, Skin
from tactile_skin.middleware.bus import Context


def skin_of(
    *nodes: str | type | tuple,
    files: Sequence = (),
    commands: Sequence[list[str]] = (),
    context: Context | None = None,
) -> Skin:
    """Return a skin of these nodes, ready for `with`.

    Args:
        nodes: what `Skin.add` takes: a node; (node, parameters); (node, parameters, the rest).
        files: parameter files that each of them is given before its own parameters.
        commands: processes that run with it.
    """
    skin = Skin(Plan(commands=[*commands]), context)
    for asked in nodes:
        node, given, more = (*asked, {}, {})[:3] if isinstance(asked, tuple) else (asked, {}, {})
        skin.add(node, given, **more)
    for action in skin._plan.nodes:
        action.parameters[:0] = files
    return skin
