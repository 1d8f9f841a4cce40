# SPDX-License-Identifier: Apache-2.0
"""The nodes' parameters, and the files that they name, as attachments of a recording."""

from __future__ import annotations

from pathlib import Path

from ..errors import FileError
from ..files import decode, read_bytes, shorten
from ..yaml_files import parse_yaml, write_yaml

PARAMETERS = "parameters.yaml"  # attachment, a ROS 2 parameter file; files have their own names
_VALUES = "ros__parameters"  # key of a section
_FILES = "weights", "geometry.table"  # parameters that name a file
_LARGEST = 16 << 20  # bytes of such a file


def attachments(parameters: dict[str, dict]) -> dict[str, bytes]:
    """Name -> bytes, of node's full name -> {parameter: value}."""
    sections = {node: {_VALUES: values} for node, values in parameters.items()}
    found = {PARAMETERS: write_yaml(sections).encode()}
    for values in parameters.values():
        for path in filter(None, map(values.get, _FILES)):
            found[path] = read_bytes(path, _LARGEST)
    return found


def parameters(attached: dict[str, bytes], where: str) -> dict[str, dict]:
    """Node's full name -> {parameter: value}; empty: none attached.

    Raises:
        FileError: the attachment is no parameter file; `where` names it.
    """
    if PARAMETERS not in attached:
        return {}
    where = f"{where}: {PARAMETERS}"
    sections = parse_yaml(decode(attached[PARAMETERS]), where)
    if not isinstance(sections, dict):
        raise FileError(f"{where}: holds {shorten(sections)}: must map node names to {_VALUES}")
    found = {}
    for node, section in sections.items():
        values = section.get(_VALUES) if isinstance(section, dict) else None
        if not isinstance(values, dict):
            raise FileError(
                f"{where}: {node} = {shorten(section)}: must hold {_VALUES}, which maps names to "
                "values"
            )
        for name in _FILES:
            if not isinstance(values.get(name, ""), str):
                value = shorten(values[name])
                raise FileError(f"{where}: {node}: {name} = {value}: must be the name of a file")
        found[node] = values
    return found


def unpack(values: dict, attached: dict[str, bytes], folder: Path) -> dict:
    """Return a node's parameters, with the files they name made in `folder` from attachments."""
    changed = dict(values)
    for name in _FILES:
        if (data := attached.get(values.get(name, ""))) is not None:
            path = folder / Path(values[name]).name
            path.write_bytes(data)
            changed[name] = str(path)
    return changed
