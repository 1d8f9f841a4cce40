"""The $(...) of ROS 2's launch files."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
import uuid
from pathlib import Path

from ..errors import LaunchError
from .package import COMPOSED, NODES, PACKAGE, share_dir
from .processes import tool_path

_SUBSTITUTION = re.compile(r"\$\(([\w-]+)((?:\s+[^()\s]+)*)\)")


def substitute(text: str, variables: dict, path: Path, anonymous: dict) -> str:
    """Fill in $(var x), $(env X default), $(dirname), $(anon x), $(find-pkg-share pkg) and
    $(exec-in-pkg x pkg)."""

    def value(match: re.Match) -> str:
        kind, words = match[1], match[2].split()
        if kind == "var" and len(words) == 1:
            if words[0] not in variables:
                known = ", ".join(variables) or "none"
                raise LaunchError(f"{path}: $(var {words[0]}): not known here; there are: {known}")
            return variables[words[0]]
        if kind == "env" and len(words) in (1, 2):
            found = os.environ.get(*words)
            if found is None:
                raise LaunchError(f"{path}: $(env {words[0]}): not set, and no default given")
            return found
        if kind == "dirname" and not words:
            return str(path.resolve().parent)
        if kind == "anon" and len(words) == 1:
            name = f"{words[0]}_{os.getpid()}_{uuid.uuid4().hex[:8]}"
            return anonymous.setdefault(words[0], name)
        if kind == "find-pkg-share" and words == [PACKAGE]:
            return str(share_dir())
        if kind == "exec-in-pkg" and len(words) == 2 and words[1] == PACKAGE:
            return _executable(words[0], path)
        raise LaunchError(
            f"{path}: {match[0]}: not understood; must be $(var x), $(env X [default]), "
            f"$(dirname), $(anon x), $(find-pkg-share {PACKAGE}) or $(exec-in-pkg x {PACKAGE})"
        )

    filled = _SUBSTITUTION.sub(value, text)
    if "$(" in filled:
        raise LaunchError(f"{path}: {text!r}: a substitution that is not understood")
    return filled


def _executable(name: str, path: Path) -> str:
    """How to start a program of the package: as colcon or pip installed it, else by this Python."""
    if name not in ("tactile-skin", COMPOSED, *NODES):
        there = ", ".join(("tactile-skin", COMPOSED, *NODES))
        raise LaunchError(f"{path}: {PACKAGE} has no program {name!r}; there are: {there}")
    built = share_dir().parents[1] / "lib" / PACKAGE / name
    if built.exists():
        return shlex.quote(str(built))
    if name == "tactile-skin" and shutil.which(name, path=tool_path()):
        return name
    module = f"{PACKAGE}.ros {name}" if name != "tactile-skin" else PACKAGE
    return f"{shlex.quote(sys.executable)} -m {module}"
