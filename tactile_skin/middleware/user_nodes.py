"""Nodes of other packages, named by `pkg` and `exec` in a launch file.

An installed package offers its node classes as entry points of the group `tactile_skin.nodes`:
`pkg` is the package, `exec` the entry point's name. Without an entry point `pkg` is a Python module
that can be imported, and `exec` a class in it. Either is called with a Node handle, as the skin's
own node classes are.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import re
from dataclasses import dataclass

from ..errors import LaunchError

GROUP = "tactile_skin.nodes"


@dataclass(frozen=True)
class UserNode:
    """Where the class of a user's node is; it is imported when the node is made."""

    package: str
    executable: str
    module: str
    name: str  # of the class in its module

    def load(self) -> type:
        """Return the class.

        Raises:
            LaunchError: the module cannot be imported, or has no such class.
        """
        where = f"node {self.package}/{self.executable}"
        try:
            module = importlib.import_module(self.module)
        except ImportError as error:
            raise LaunchError(f"{where}: importing {self.module} failed: {error}") from error
        found = getattr(module, self.name, None)
        if not isinstance(found, type):
            own = [n for n, v in vars(module).items() if isinstance(v, type)]
            own = [n for n in own if vars(module)[n].__module__ == module.__name__]
            raise LaunchError(
                f"{where}: exec: {self.module} has no class {self.name!r}; "
                f"there are: {', '.join(own) or 'none'}"
            )
        return found


def find_user_node(package: str, executable: str) -> UserNode:
    """Return the node that `pkg` and `exec` of a launch file name.

    Raises:
        LaunchError: neither an entry point nor a module; the message says what there is.
    """
    offered, packages = [], set()  # its nodes; whose nodes there are
    for entry in importlib.metadata.entry_points(group=GROUP):
        module = entry.module.split(".")[0]
        owner = module if entry.dist is None else entry.dist.name
        packages.add(owner)
        if _normalised(package) in (_normalised(module), _normalised(owner)):
            if entry.name == executable:
                return UserNode(package, executable, entry.module, entry.attr)
            offered.append(entry.name)
    if _exists(package):
        return UserNode(package, executable, package, executable)
    where = f"node {package}/{executable}"
    if offered:
        there = ", ".join(sorted(offered))
        raise LaunchError(f"{where}: exec: {package} has no node of this name; there are: {there}")
    raise LaunchError(
        f"{where}: pkg: no installed package of this name has entry points of the group {GROUP} "
        f"(there are: {', '.join(sorted(packages)) or 'none'}), and no Python module of this name "
        "can be imported"
    )


def _normalised(name: str) -> str:
    """Return the name of a distribution or module, however - _ . and capitals are written."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _exists(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):  # of a parent; of a name that cannot be one
        return False
