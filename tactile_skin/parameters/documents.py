# SPDX-License-Identifier: Apache-2.0
"""config/skin.yaml and docs/parameters.md, written from the parameters."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator

from ..fields import Leaf, leaves, members
from .nodes import SECTIONS, Shared, shared_names

_WIDTH = 110  # characters of a line of config/skin.yaml
_COLUMN = 30  # where comments begin
_PLAIN = re.compile(r"[A-Za-z]\w*|\d+(\.\d+){3}")  # a text that needs no quotes in YAML
_NO_TEXT = {"true", "false", "yes", "no", "on", "off", "null"}

_HEAD = """\
# Parameters of the skin's nodes, in ROS 2's format: "/**" applies to every node,
# "/**/compensation" to the node of that name in any namespace, "/left/compensation" to one.
# Units: newton, metre, radian, second, ohm. Unknown names are errors. Your own file needs only what
# differs from this one. An argument of the launch files that is given, such as method:=map, wins
# over both. Written by `python -m tactile_skin.parameters`; the ranges are in docs/parameters.md.
"""
_PAGE = """\
# Parameters

All of [config/skin.yaml](../config/skin.yaml), with the ranges of the values. *Live* parameters may
change while the node runs (`ros2 param set`); the others are read at the start. This page and the
file are written by `python -m tactile_skin.parameters` from
[the data](../tactile_skin/parameters/nodes.py).
"""


def config() -> str:
    """Return the text of config/skin.yaml."""
    parts = [_HEAD, _section("/**", "", _yaml(Shared, 4))]
    for node, kind in SECTIONS.items():
        if lines := list(_yaml(kind, 4, shared_names())):
            parts.append(_section(f"/**/{node}", _about(kind), lines))
    return "\n".join(parts)


def _section(name: str, about: str, lines) -> str:
    head = f"{name}:".ljust(_COLUMN) + f"# {about}" if about else f"{name}:"
    return "\n".join([head, "  ros__parameters:", *lines]) + "\n"


def _about(kind: type) -> str:
    text = (kind.__doc__ or "").splitlines()[0].removesuffix(".")
    return text[:1].lower() + text[1:]


def _yaml(kind: type, indent: int, without=frozenset(), prefix: str = "") -> Iterator[str]:
    """Yield the lines of a dataclass of parameters."""
    space = " " * indent
    for name, member in members(kind):
        if isinstance(member, Leaf):
            if prefix + name not in without:
                yield from _line(f"{space}{name}: {_value(member.default)}", member, space)
        elif lines := list(_yaml(member, indent + 2, without, f"{prefix}{name}.")):
            yield f"{space}{name}:".ljust(_COLUMN) + f"# {_about(member)}"
            yield from lines


def _line(text: str, leaf: Leaf, space: str) -> Iterator[str]:
    """Yield a parameter with its description behind it, or above it where that is too long."""
    line = f"{text.ljust(_COLUMN - 2)}  # {leaf.about.description}"
    if len(line) <= _WIDTH:
        yield line
    else:
        mark = f"{space}# "
        yield from textwrap.wrap(
            leaf.about.description, _WIDTH, initial_indent=mark, subsequent_indent=mark
        )
        yield text


def _value(value) -> str:
    """Return a value as YAML has it."""
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value not in _NO_TEXT
        return value if plain else json.dumps(value)
    return json.dumps(value)


def page() -> str:
    """Return the text of docs/parameters.md."""
    parts = [_PAGE, _table("Every node: `/**`", "", list(leaves(Shared)))]
    for node, kind in SECTIONS.items():
        if own := [leaf for leaf in leaves(kind) if leaf.name not in shared_names()]:
            parts.append(_table(f"{node}: `/**/{node}`", f"{kind.__doc__}\n\n", own))
    return "\n".join(parts)


def _table(title: str, about: str, found: list[Leaf]) -> str:
    rows = [
        f"| `{leaf.name}` | {_cell(f'`{_value(leaf.default)}`')} | {_range(leaf)} | "
        f"{_cell(leaf.about.description)}{' *Live.*' if leaf.about.live else ''} |"
        for leaf in found
    ]
    head = ["| parameter | default | range | meaning |", "|---|---|---|---|"]
    return f"## {title}\n{about}" + "\n".join([*head, *rows]) + "\n"


def _range(leaf: Leaf) -> str:
    low, high = leaf.about.low, leaf.about.high
    return "" if low is None else f"{low:g} to {high:g}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
