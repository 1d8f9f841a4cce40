# SPDX-License-Identifier: Apache-2.0
"""Parameter files that a command writes."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
from itertools import dropwhile
from pathlib import Path

from ..files import read_text
from ..yaml_files import YAML_BYTES, read_yaml

_NOTE = "# calibrate: "  # begins the lines at a file's top that the last calibration wrote
_LINE = 1 << 20  # characters: a list is a line, some are as long as the skin has cells
_PARAMETERS = "ros__parameters"


def entered(source: Path | None, section: str, changes: dict, notes: list[str] | None) -> str:
    """Return a parameter file's text with other values; its comments and order stay.

    Args:
        source: the file; None: an empty one.
        section: for what no section of the file has yet: "/**".
        changes: parameter -> value, or group -> {parameter: value}. A group is changed wherever the
            file has it.
        notes: put at the top in place of those of the last calibration; None: those stay.

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
    lines = text.splitlines(True)
    if notes is not None:
        lines = list(dropwhile(lambda line: line.startswith(_NOTE), lines))
    yaml = YAML()
    yaml.preserve_quotes, yaml.width = True, _LINE
    _, indent, offset = load_yaml_guess_indent("".join(lines) or "{}")
    yaml.indent(mapping=indent or 2, sequence=indent or 4, offset=offset or 0)
    data = yaml.load("".join(lines))
    only_comments = data is None
    data = CommentedMap() if only_comments else data
    for name, value in changes.items():
        having = [
            parameters
            for below in data.values()
            if (parameters := _parameters(below)) is not None and _has(parameters, name)
        ]
        if not having:
            below = data.get(section)
            if below is None:
                below = data[section] = CommentedMap()
            if _parameters(below) is None:
                below[_PARAMETERS] = CommentedMap()
            having = [below[_PARAMETERS]]
        for parameters in having:
            _enter(parameters, name, value)
    stream = io.StringIO()
    yaml.dump(data, stream)
    top = "".join(f"{_NOTE}{line}\n" for note in notes or [] for line in note.splitlines())
    return top + ("".join(lines) if only_comments else "") + stream.getvalue()


def _parameters(section) -> dict | None:
    found = section.get(_PARAMETERS) if isinstance(section, dict) else None
    return found if isinstance(found, dict) else None


def _has(parameters: dict, name: str) -> bool:
    return any(key == name or key.startswith(f"{name}.") for key in parameters)


def _enter(parameters, name: str, value) -> None:
    """Set a value, or those of a group, as `group: {name: value}` or as `group.name: value`."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    if isinstance(value, dict):
        flat = [key for key in parameters if key.startswith(f"{name}.")]
        for key, each in value.items():
            if flat and name not in parameters:
                _enter(parameters, f"{name}.{key}", each)
                continue
            if not isinstance(parameters.get(name), dict):
                _put(parameters, name, CommentedMap())
            _enter(parameters[name], key, each)
        return
    if isinstance(value, list):
        old = parameters.get(name)
        listed = old if isinstance(old, CommentedSeq) else CommentedSeq()
        listed[:] = value
        listed.fa.set_flow_style()
        value = listed
    _put(parameters, name, value)


def _put(parameters, name: str, value) -> None:
    """Set one key; a new one before the last, after which comments of what follows stand."""
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
