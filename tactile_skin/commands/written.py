"""Parameter files that a command writes."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import yaml


class _InLines(yaml.SafeDumper):
    """A list is a line, not a column: some are as long as the skin has cells."""

    def represent_list(self, values):
        return self.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_InLines.add_representer(list, _InLines.represent_list)


def dumped(data: dict) -> str:
    """As YAML, in the order that it has."""
    return yaml.dump(data, Dumper=_InLines, sort_keys=False)


def replace_file(path: Path, text: str) -> None:
    """Write a file in one step; one that was there is kept beside it, as NAME.bak."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            old = Path(f"{name}.bak")
            shutil.copy2(path, old)
            os.replace(old, f"{path}.bak")
        os.replace(name, path)
    except BaseException:
        for left in (name, f"{name}.bak"):
            Path(left).unlink(missing_ok=True)
        raise
