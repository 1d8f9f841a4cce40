"""The tree shows the way of the data: pure modules know no port, no bus, no parameters."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "tactile_skin"
PURE = ["circuit", "curve", "scenes", "network", "geometry", "features", "tracking"]
PURE += ["files", "gestures", "stop", "tare", "events", "gate", "admittance"]
PURE += sorted(f"solvers/{path.stem}" for path in (PACKAGE / "solvers").glob("*.py"))
WORLD = {"serial", "socket", "threading", "tactile_skin.bus", "bus", "msg", "config", "nodes"}


def imports(module: str) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module} if node.module else {alias.name for alias in node.names}
    return found


@pytest.mark.parametrize("module", PURE)
def test_pure_modules_import_nothing_of_the_world(module):
    allowed = {"threading"} if module == "network" else set()  # scratch memory per thread
    assert not imports(module) & (WORLD - allowed)


def test_a_robot_needs_no_pytorch_to_run():
    """Only training, and the export of what it made, import torch; cli.py within these commands."""
    users = [p.stem for p in PACKAGE.rglob("*.py") if "torch" in imports_of(p)]
    assert set(users) == {"training", "export", "cli"}


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text())
    return {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
