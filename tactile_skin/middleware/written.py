# SPDX-License-Identifier: Apache-2.0
"""Parameter files that a command writes."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
from itertools import dropwhile
from pathlib import Path

from ..fields import leaves
from ..files import read_text
from ..yaml_files import YAML_BYTES, read_yaml, write_yaml
from .package import SKIN_NODES
from .parameter_file import last_of

_NOTE = "# calibrate: "  # begins the lines at a file's top that the last calibration wrote
_LINE = 1 << 20  # characters: a list is a line, some are as long as the skin has cells
_PARAMETERS = "ros__parameters"
_EVERY = "/**"  # section for every node


def own_sections(nodes: dict[str, dict]) -> str:
    """Return the sections of a parameter file of what the nodes of a skin do not share.

    Args:
        nodes: full name of each node that runs -> {parameter: value}; its defaults are left out.
    """
    from ..parameters.nodes import SECTIONS, own_names  # here: as in ParameterFile

    sections: dict[str, dict] = {}
    for node, values in nodes.items():
        if (name := last_of(node)) in SKIN_NODES:
            usual = {leaf.name: leaf.default for leaf in leaves(SECTIONS[name])}
            own = {k: v for k, v in values.items() if k in own_names(name) and v != usual[k]}
            sections |= {f"{_EVERY}/{name}": {_PARAMETERS: own}} if own else {}
    return write_yaml(sections) if sections else ""


def entered(
    source: Path | None, changes: dict[str, dict], notes: list[str], keep: bool = False
) -> str:
    """Return a parameter file's text with other values; its comments and order stay.

    Args:
        source: the file; None: an empty one.
        changes: group -> {parameter: value}, entered wherever the file has the group, or else for
            every node.
        notes: put at the top in place of those of the last calibration, or above them.
        keep: whether those stay.

    Raises:
        FileError, OSError: as `read_yaml`.
    """
    from ruamel.yaml import YAML  # here: half of all commands write nothing
    from ruamel.yaml.comments import CommentedMap
    from ruamel.yaml.util import load_yaml_guess_indent

    text = ""
    if source is not None:
        read_yaml(source)  # within its limits, and refused by name
        text = read_text(source, YAML_BYTES)
    given = text.splitlines(True)
    rest = list(dropwhile(lambda line: line.startswith(_NOTE), given))
    before, text = given[: len(given) - len(rest)], "".join(rest)
    yaml = YAML()
    yaml.preserve_quotes, yaml.width = True, _LINE
    _, indent, offset = load_yaml_guess_indent(text or "{}")
    yaml.indent(mapping=indent or 2, sequence=indent or 4, offset=offset or 0)
    data = yaml.load(text)
    only_comments = data is None
    data = CommentedMap() if only_comments else data
    for group, values in changes.items():
        found = [s.get(_PARAMETERS) for s in data.values() if isinstance(s, dict)]
        having = [p for p in found if isinstance(p, dict) and _has(p, group)]
        if not having:
            below = data
            for key in (_EVERY, _PARAMETERS):
                if not isinstance(below.get(key), dict):
                    below[key] = CommentedMap()
                below = below[key]
            having = [below]
        for parameters in having:
            _enter(parameters, group, values)
    stream = io.StringIO()
    yaml.dump(data, stream)
    top = "".join(f"{_NOTE}{line}\n" for note in notes for line in note.splitlines())
    top += "".join(before) if keep else ""
    return top + (text if only_comments else "") + stream.getvalue()


def _has(parameters: dict, group: str) -> bool:
    return any(key == group or key.startswith(f"{group}.") for key in parameters)


def _enter(parameters, group: str, values: dict) -> None:
    """Set the values of a group, as `group: {name: value}` or as `group.name: value`."""
    from ruamel.yaml.comments import CommentedMap

    flat = group not in parameters and _has(parameters, group)
    if not flat and not isinstance(parameters.get(group), dict):
        _put(parameters, group, CommentedMap())
    for name, value in values.items():
        if flat:
            _put(parameters, f"{group}.{name}", value)
        else:
            _put(parameters[group], name, value)


def _put(parameters, name: str, value) -> None:
    """Set one key; a new one before the last, after which comments of what follows stand."""
    from ruamel.yaml.comments import CommentedSeq

    if isinstance(value, list):
        old = parameters.get(name)
        listed = old if isinstance(old, CommentedSeq) else CommentedSeq()
        listed[:] = value
        listed.fa.set_flow_style()
        value = listed
    if name in parameters:
        parameters[name] = value
    else:
        parameters.insert(max(len(parameters) - 1, 0), name, value)


def replace_file(path: Path, text: str) -> None:
    """Write a file in one step, of the mode that it had; the old one is kept as NAME.bak."""
    path = path.resolve()
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        new, old = Path(folder, "new"), Path(folder, "old")
        with new.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, new)
            shutil.copy2(path, old)
            os.replace(old, f"{path}.bak")
        os.replace(new, path)
