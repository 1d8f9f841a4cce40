# SPDX-License-Identifier: Apache-2.0
"""The tree shows the way of the data: what each folder may import, without circles."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "tactile_skin"
# Each folder, or module of the root, and those that it may import; itself and errors always.
MAY = {
    "errors": "",
    "files": "",
    "yaml_files": "files",
    "msg": "",
    "physics": "files yaml_files",  # the latter while it reads a file: no PyYAML otherwise
    "touch": "files",
    "fields": "",
    "behaviours": "fields",
    "body": "touch behaviours",
    "learning": "files extras physics simulation touch",  # the latter while it trains
    "solvers": "files physics learning findings",
    "readings": "",
    "findings": "",
    "calibration": "physics solvers readings findings",
    "health": "physics solvers readings findings calibration",
    "board": "physics readings",
    "parameters": "fields physics touch behaviours board",
    "simulation": "physics board",
    "middleware": "fields files yaml_files msg physics touch parameters board",
    "recording": "extras files yaml_files msg physics middleware readings",
    "view": "msg yaml_files physics solvers touch calibration health middleware recording board "
    "guide",
    "nodes": "fields msg physics touch behaviours body learning solvers findings calibration "
    "health board parameters middleware recording view",
    "launch": "files msg touch behaviours parameters middleware recording nodes",
    "ros": "files yaml_files msg parameters middleware nodes launch",
    "opened": "physics touch behaviours board parameters middleware nodes",
    "replay": "extras msg parameters middleware physics recording nodes launch",
    "bench": None,  # everything but the command line
    "guide": "yaml_files physics solvers readings findings calibration health board middleware",
    "arguments": "",
    "extras": "",
    "commands": None,  # so do these
    "cli": "arguments files commands",
    "__init__": "physics solvers calibration findings health opened",
    "__main__": "cli",
}
PURE = "physics readings touch behaviours body learning solvers findings calibration health"
WORLD = {"serial", "socket", "socketserver", "subprocess", "yaml", "select", "asyncio", "signal"}
# that use threads: scratch memory of each, and a hook's own
THREADS = {"learning/network", "behaviours/hooks"}
CIRCLES = {"guide", "view"}  # folders with modules that still import each other
SHARED = "support"  # what tests and benchmarks both import
MODULES = 12  # in a folder
LINES = 400  # in a module
LICENSE = "SPDX-License-Identifier: Apache-2.0"
ROOT = PACKAGE.parent
MODULE_PATHS = sorted(p for p in PACKAGE.rglob("*.py"))
BENCHMARKS = sorted((ROOT / "benchmarks").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
SOURCES = [*MODULE_PATHS, *sorted(p for p in PACKAGE.rglob("*.[ch]"))]


def place(path: Path) -> str:
    """The folder, or the module of the root, that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def imports(path: Path) -> tuple[set[str], set[str]]:
    """Places of ours, and top-level names of others, that a module imports."""
    ours, others = set(), set()
    package = ["tactile_skin", *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            names = [f"{module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            head, *rest = name.split(".")
            if head != "tactile_skin":
                others.add(head)
            elif rest and ((PACKAGE / rest[0]).is_dir() or (PACKAGE / f"{rest[0]}.py").is_file()):
                ours.add(rest[0])
            else:
                ours.add("__init__")  # a name of the package itself
    return ours, others


def forbidden(path: Path) -> set[str]:
    """What a module imports that it may not."""
    here = place(path)
    allowed = MAY[here]
    ours, others = imports(path)
    wrong: set[str] = set()
    if allowed is not None:
        wrong |= ours - {here, "__init__", "errors", *allowed.split()}
        if here not in ("__init__", "__main__") and "__version__" not in path.read_text():
            wrong |= ours & {"__init__"}
    elif here != "cli":
        wrong |= ours & {"cli"}
    if here in PURE.split():
        wrong |= others & WORLD
        if path.relative_to(PACKAGE).with_suffix("").as_posix() not in THREADS:
            wrong |= others & {"threading"}
    return wrong


def test_a_module_imports_only_what_its_folder_may():
    assert {path: wrong for path in MODULE_PATHS if (wrong := forbidden(path))} == {}


def test_every_place_is_known():
    assert {place(path) for path in MODULE_PATHS} == set(MAY)


def in_order(used: dict[str, set[str]]) -> list[str]:
    """Names, each after those that it uses; those of a circle, and who uses them, are missing."""
    order: list[str] = []
    while free := [name for name in used if name not in order and used[name] <= set(order)]:
        order += free
    return order


def test_there_is_no_circle(capsys):
    """Prints the tree, each folder above those that it imports: pytest -s."""
    used = {here: set() for here in MAY}
    for path in MODULE_PATHS:
        used[place(path)] |= imports(path)[0] - {place(path), "__init__"}
    order = in_order(used)
    assert set(order) == set(MAY)
    with capsys.disabled():
        print()
        for name in reversed(order):
            print(f"  {name:12} -> {', '.join(sorted(used[name])) or '-'}")


def of_its_folder(path: Path) -> set[str]:
    """Modules next to it that a module imports, also for types alone."""
    nodes = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
    names = {n.module.split(".")[0] for n in nodes if n.level == 1 and n.module} - {path.stem}
    return {name for name in names if path.with_name(f"{name}.py").exists()}


def test_no_modules_of_a_folder_import_each_other():
    for folder in {path.parent for path in MODULE_PATHS}:
        used = {p.stem: of_its_folder(p) for p in MODULE_PATHS if p.parent == folder}
        assert len(in_order(used)) == len(used) or folder.name in CIRCLES, folder


def others(path: Path) -> set[str]:
    """Top-level names that a module imports, wherever in it."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    found = {a.name.split(".")[0] for n in nodes if isinstance(n, ast.Import) for a in n.names}
    return found | {
        n.module.split(".")[0] for n in nodes if isinstance(n, ast.ImportFrom) and not n.level
    }


def test_nothing_imports_a_benchmark_but_its_own_tests():
    own = ROOT / "tests/benchmarks"
    named = [p for p in (*MODULE_PATHS, *TESTS) if "benchmarks" in p.read_text()]
    users = [p for p in named if "benchmarks" in others(p)]
    assert [p for p in users if own not in p.parents] == []
    assert [p for p in MODULE_PATHS if SHARED in others(p)] == []


FOLDERS = sorted({p.parent for p in (*MODULE_PATHS, *BENCHMARKS)})


def test_no_folder_is_crowded():
    modules = {f: [p.name for p in f.glob("*.py") if p.name != "__init__.py"] for f in FOLDERS}
    assert {f: names for f, names in modules.items() if len(names) > MODULES} == {}


def test_no_module_is_long():
    lines = {path: len(path.read_text().splitlines()) for path in (*SOURCES, *BENCHMARKS)}
    assert {path: n for path, n in lines.items() if n > LINES + 1} == {}  # and its license


def test_each_module_names_its_license_first():
    paths = {*SOURCES, *BENCHMARKS, *TESTS, *PACKAGE.rglob("*.[ch]"), *PACKAGE.rglob("*.js")}
    bare = [path for path in paths if LICENSE not in path.read_text().partition("\n")[0]]
    assert len(paths) > 500 and not bare


def test_pure_folders_work_without_pyyaml():
    """No module of theirs, nor what it imports, imports yaml: only reading a YAML file does."""
    modules = [
        ".".join(["tactile_skin", *path.relative_to(PACKAGE).with_suffix("").parts])
        for path in MODULE_PATHS
        if place(path) in PURE.split() and "torch" not in imports(path)[1]
    ]
    lines = ["import sys"]
    for name in modules:
        lines += [f"import {name}", f"if 'yaml' in sys.modules: sys.exit('{name} imports yaml')"]
    code = "\n".join(lines)
    subprocess.run([sys.executable, "-c", code], check=True, cwd=PACKAGE.parent, timeout=60)


def test_a_robot_needs_no_pytorch_to_run():
    """Only training imports torch; a command asks extras.py for it."""
    users = [p.stem for p in MODULE_PATHS if "torch" in imports(p)[1]]
    assert set(users) == {"training", "soap"}
