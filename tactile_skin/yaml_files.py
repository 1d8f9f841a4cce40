"""A user's YAML, read within limits: each refusal is one line that names file, line and key.

YAML is what PyYAML's `safe_load` reads, less what no parameter or launch file needs and what it
accepts silently: repeated keys, keys that are not text, other types than null, bool, int, float,
str, list and map, and dates, which stay text.
"""

from __future__ import annotations

import re

import yaml

from .errors import FileError
from .files import read_text, shorten

# Ten skins in one file, with curves of a hundred points, stay within these. So much is read in less
# than half a second.
YAML_BYTES = 64 * 1024
_YAML_NODES = 4000  # keys, values, lists and maps, an alias counted as all that it stands for
_YAML_DEPTH = 20  # of lists and maps in one another; a launch file needs 7
_NUMBER_CHARACTERS = 100  # of a number; Python takes longer the longer it is, or refuses
_INT_BITS = 64  # as ROS 2 keeps a whole number


def read_yaml(path):
    """What a YAML file holds; None if it is empty.

    Raises:
        FileError: as `read_text` and `parse_yaml`.
        OSError: it cannot be read.
    """
    return parse_yaml(read_text(path, YAML_BYTES), path)


def parse_yaml(text: str, where):
    """What a YAML text holds; None if it is empty.

    Args:
        where: what the text is, for messages: its file, or the key that it is the value of.

    Raises:
        FileError: not YAML, or beyond the limits of this module.
    """
    loader = None
    try:
        loader = _Loader(text)
        return loader.get_single_data()
    except _Refused as error:
        line = error.problem_mark.line + 1
        raise FileError(f"{where}: line {line}: {error.problem}") from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise FileError(
            f"{where}: not valid YAML: line {line}: character U+{error.character:04X}"
        ) from error
    except yaml.MarkedYAMLError as error:
        mark, problem = error.problem_mark, str(error.problem)
        if error.context and not error.context.startswith("while"):
            problem = f"{error.context}, {problem}"
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise FileError(f"{where}: not valid YAML: {place}{problem}") from error
    except (ValueError, OverflowError) as error:  # PyYAML's scanner: numbers in escapes, directives
        raise FileError(f"{where}: not valid YAML: line {loader.line + 1}: {error}") from error
    finally:
        if loader is not None:
            loader.dispose()


class _Refused(yaml.MarkedYAMLError):
    def __init__(self, problem: str, mark: yaml.Mark):
        super().__init__(problem=problem, problem_mark=mark)


def _tags(*names: str) -> set[str]:
    return {f"tag:yaml.org,2002:{name}" for name in names}


_SCALARS = _tags("null", "bool", "int", "float", "str", "merge")
_NUMBERS = _tags("int", "float")
_KEYS = _tags("str", "merge")  # merge: the key <<
_TYPES = _SCALARS | _tags("seq", "map")
_NO_TEXT = re.compile("[\0\ud800-\udfff]")  # no file name, no console takes them


class _Loader(yaml.SafeLoader):
    """Refuses while it reads: neither its depth nor its size can grow beyond the limits."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in resolvers if tag in _SCALARS]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str):
        super().__init__(text)
        self._nodes = 0  # so far, aliases counted as all that they stand for
        self._depth = self._deepest = 0
        self._extent: dict[yaml.Node, tuple[int, int]] = {}  # finished node -> nodes, depth

    def compose_node(self, parent, index):
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            node = super().compose_node(parent, index)
            if node not in self._extent:
                raise _Refused(f"alias *{event.anchor} stands within itself", event.start_mark)
            nodes, depth = self._extent[node]
            self._grow(nodes, depth, event)
            return node
        nodes, deepest = self._nodes, self._deepest
        self._depth += 1
        self._deepest = self._depth
        self._grow(1, 0, event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        self._extent[node] = self._nodes - nodes, self._deepest - self._depth
        self._deepest = max(deepest, self._deepest)
        if node.tag not in _TYPES:
            tag = node.tag.replace("tag:yaml.org,2002:", "!!")
            raise _Refused(f"tag {shorten(tag)} is not understood", node.start_mark)
        return node

    def _grow(self, nodes: int, depth: int, event) -> None:
        self._nodes += nodes
        self._deepest = max(self._deepest, self._depth + depth)
        if self._nodes > _YAML_NODES:
            raise _Refused(
                f"too many values: must be at most {_YAML_NODES}, an alias counted as all that it "
                "stands for",
                event.start_mark,
            )
        if self._deepest > _YAML_DEPTH:
            self._refuse_depth(event.start_mark)

    def _refuse_depth(self, mark: yaml.Mark):
        raise _Refused(f"too deep: at most {_YAML_DEPTH} lists and maps in one another", mark)

    def fetch_flow_collection_start(self, token):
        if self.flow_level >= _YAML_DEPTH:  # the scanner reads a thousand brackets ahead
            self._refuse_depth(self.get_mark())
        super().fetch_flow_collection_start(token)

    def compose_mapping_node(self, anchor):
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if key.tag not in _KEYS or not isinstance(key, yaml.ScalarNode):
                shown = shorten(key.value) if isinstance(key, yaml.ScalarNode) else "a list or map"
                raise _Refused(f"key: {shown}: must be text, in quotes if need be", key.start_mark)
            if key.value in lines:
                first = lines[key.value]
                raise _Refused(
                    f"key {shorten(key.value)} is given twice, first in line {first}",
                    key.start_mark,
                )
            lines[key.value] = key.start_mark.line + 1
        return node

    def compose_scalar_node(self, anchor):
        node = super().compose_scalar_node(anchor)
        if bad := _NO_TEXT.search(node.value):
            raise _Refused(f"character U+{ord(bad[0]):04X} is not allowed", node.start_mark)
        if node.tag in _NUMBERS and len(node.value) > _NUMBER_CHARACTERS:
            raise _Refused(
                f"number {shorten(node.value)}: must be at most {_NUMBER_CHARACTERS} characters",
                node.start_mark,
            )
        return node

    def construct_object(self, node, deep=False):
        try:
            value = super().construct_object(node, deep)
        except (ValueError, LookupError, OverflowError) as error:  # of "!!int x", say
            tag = node.tag.replace("tag:yaml.org,2002:", "!!")
            raise _Refused(f"{shorten(node.value)} is no {tag}", node.start_mark) from error
        if type(value) is int and not -(2 ** (_INT_BITS - 1)) <= value < 2 ** (_INT_BITS - 1):
            raise _Refused(
                f"number {shorten(node.value)}: must fit into {_INT_BITS} bit", node.start_mark
            )
        return value
