#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Print how large the house is, and fail where it outgrows what was decided."""

import ast
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
MARGIN = 1.03  # times the decided size that is allowed: the house grows by a decision only
DECIDED = {  # what -> size as of 29 November 2026: lines, words or constants
    "package, Python lines": 39300,
    "package, C lines": 1245,
    "package, page lines": 2441,
    "tests, Python lines": 36740,
    "benchmarks, Python lines": 12640,
    "docs, words": 37950,
    "numeric constants of modules": 920,
}
TRACKED = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
FILES = [ROOT / name for name in TRACKED.stdout.splitlines()]


def under(folder: str, *ends: str) -> list[Path]:
    """Return the tracked files of a folder whose names end so."""
    here = [p for p in FILES if p.relative_to(ROOT).parts[0] == folder and p.exists()]
    return [p for p in here if p.suffix in ends]


def count(paths: list[Path], of: Callable[[str], list]) -> int:
    return sum(len(of(p.read_text(encoding="utf-8"))) for p in paths)


def is_number(node: ast.expr | None) -> bool:
    match node:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=operand):
            return is_number(operand)
        case ast.BinOp(left=left, right=right):
            return is_number(left) and is_number(right)
    return False


def constants(text: str) -> list[str]:
    """Return the names in capitals that a module sets to a number."""
    found = []
    for statement in ast.parse(text).body:
        if isinstance(statement, ast.Assign):
            targets = statement.targets
        elif isinstance(statement, ast.AnnAssign):
            targets = [statement.target]
        else:
            continue
        names = [t.id for t in targets if isinstance(t, ast.Name) and t.id.isupper()]
        found += names if is_number(statement.value) else []
    return found


SIZES = {
    "package, Python lines": count(under("tactile_skin", ".py"), str.splitlines),
    "package, C lines": count(under("tactile_skin", ".c", ".h"), str.splitlines),
    "package, page lines": count(under("tactile_skin", ".js", ".html", ".css"), str.splitlines),
    "tests, Python lines": count(under("tests", ".py"), str.splitlines),
    "benchmarks, Python lines": count(under("benchmarks", ".py"), str.splitlines),
    "docs, words": count(under("docs", ".md", ".rst"), str.split),
    "numeric constants of modules": count(under("tactile_skin", ".py"), constants),
}

grown = []
for what, size in SIZES.items():
    most = int(MARGIN * DECIDED[what])
    print(f"{what}: {size}, at most {most}")
    grown += [what] if size > most else []
if grown:
    sys.exit(f"larger than decided: {'; '.join(grown)}: let something go, or decide it here")
