# SPDX-License-Identifier: Apache-2.0
"""Every script of benchmarks/ says what it shows and takes; pages hold the lines of their runs."""

import importlib
import json
import sys
from pathlib import Path

import pytest

from benchmarks import harness, pages
from tactile_skin.bench import speed
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "benchmarks").rglob("*.py")
    if "harness.run(main)" in path.read_text() and path.stem != "harness"
)


def load(name: str):
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name == "torch":
            pytest.skip("PyTorch is not installed")
        raise


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_says_what_it_shows_and_takes(name, capsys):
    script = load(name)
    with pytest.raises(SystemExit) as ended:
        script.main(["--help"])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert said.startswith("usage: python -m benchmarks.") and "--json" in said
    documented = sys.modules[script.main.__module__].__doc__.splitlines()[0]
    assert documented in said and documented[-1] in ".?"


def test_there_are_scripts_of_every_theme():
    assert len(SCRIPTS) > 40
    assert "benchmarks.faults.__main__" in SCRIPTS


def test_results_are_written_with_their_command_and_machine(monkeypatch, capsys, tmp_path):
    def main():
        print("a row")
        return {"error": 0.5}

    monkeypatch.setattr(sys, "argv", ["script", "--json", str(tmp_path / "found.json")])
    harness.run(main)
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["figures"] == {"error": 0.5} and found["printed"] == ["a row"]
    assert {"command", "machine", "seconds"} < set(found)


def test_an_exit_status_is_the_processs(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["script"])
    with pytest.raises(SystemExit) as ended:
        harness.run(lambda: 1)
    assert ended.value.code == 1


def test_a_seed_does_not_depend_on_what_else_is_measured():
    assert harness.seed_of(3, "8x8", 0.5) == harness.seed_of(3, "8x8", 0.5)
    assert harness.seed_of(3, "8x8", 0.5) != harness.seed_of(3, "8x8", 1.0)


def test_tasks_give_their_results_in_order():
    assert list(harness.spread(abs, [-1, 2, -3], 1)) == [1, 2, 3]


def test_the_tables_hold_each_method_and_family():
    data = json.loads((Path(__file__).parents[2] / "docs/bench/speed.json").read_text())
    auto = next(p for p in data["readouts"]["scan"] if p["method"] == "auto")
    first = speed.choice(data)[2]
    assert first.startswith("| `auto` | a robot") and f"| {auto['p99_ms']:.1f} |" in first
    table = pages.paper(data)
    assert len(table) == 2 + len(METHODS)
    assert all(line.count("|") == 2 + 2 * len(scenes.FAMILIES) for line in table)


@pytest.mark.parametrize("page", pages._PAGES, ids=lambda page: page.stem)
def test_the_pages_hold_the_lines_of_the_run_that_they_show(page):
    root = Path(__file__).parents[2]
    text = page.read_text()
    assert "<!-- end -->" in text
    assert pages.fill(text, pages.blocks(root / "docs/bench")) == text


def test_only_the_named_block_of_a_page_is_replaced():
    page = "before\n<!-- a -->\nold\nlines\n<!-- end -->\nafter <!-- end -->\n"
    assert pages.fill(page, {"a": "new", "b": "none"}) == (
        "before\n<!-- a -->\nnew\n<!-- end -->\nafter <!-- end -->\n"
    )
