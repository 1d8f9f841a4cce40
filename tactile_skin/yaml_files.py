# SPDX-License-Identifier: Apache-2.0
"""A user's YAML: each refusal is one line that names file, line and key.

What PyYAML's `safe_load` reads, less what it accepts silently: repeated keys, and keys that are
not text. As in ROS, and in YAML 1.2, 1e3 and 2.5e1 are numbers: PyYAML takes them for text.
"""

from __future__ import annotations

import re

import yaml

from .errors import FileError
from .files import read_text, shorten

YAML_BYTES = 64 * 1024  # ten skins in one file, with curves of a hundred points, stay within
_TEXT = "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"  # tags of keys; the latter is <<


def read_yaml(path):
    """Return what a YAML file holds; None if it is empty.

    Raises:
        FileError: as `read_text` and `parse_yaml`.
        OSError: it cannot be read.
    """
    return parse_yaml(read_text(path, YAML_BYTES), path)


def write_yaml(data) -> str:
    """Return the YAML text that `parse_yaml` reads as these dicts, lists, numbers and texts."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False)


def parse_yaml(text: str, where):
    """Return what a YAML text holds; None if it is empty.

    Args:
        where: what the text is, for messages: its file, or the key that it is the value of.

    Raises:
        FileError: not YAML, or a key that is repeated or not text.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise FileError(f"{where}: not valid YAML: {place}{error.problem}") from error
    except (yaml.YAMLError, ValueError, LookupError, OverflowError, RecursionError) as error:
        raise FileError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from error


class Map(dict):
    """A map of a file; `lines`: key -> its line, but of what is merged into it."""

    lines: dict[str, int]


class _Loader(yaml.SafeLoader):
    def construct_yaml_map(self, node):
        data = Map()
        data.lines = node.lines
        yield data
        data.update(self.construct_mapping(node))

    def construct_document(self, node):
        return self.construct_object(node, deep=True)  # refuses what holds itself

    def compose_mapping_node(self, anchor):
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            problem = ""
            if key.tag not in _TEXT:
                problem = f"key: {shorten(key.value)}: must be text, in quotes if need be"
            elif key.value in lines:
                first = lines[key.value]
                problem = f"key {shorten(key.value)} is given twice, first in line {first}"
            if problem:
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            lines[key.value] = key.start_mark.line + 1
        node.lines = lines
        return node


class _Dumper(yaml.SafeDumper):
    """Puts quotes around a text that reads as a number."""


_Loader.add_constructor("tag:yaml.org,2002:map", _Loader.construct_yaml_map)
_Dumper.add_representer(Map, _Dumper.represent_dict)
for _class in (_Loader, _Dumper):
    _class.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+\Z"),
        list("-+.0123456789"),  # first characters
    )
