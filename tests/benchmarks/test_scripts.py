# SPDX-License-Identifier: Apache-2.0
"""Every script of benchmarks/ can be imported, and says what it shows and takes."""

import importlib
import json
import sys
from pathlib import Path

import pytest

from benchmarks import harness

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
    assert {"benchmarks.faults.__main__", "benchmarks.ablation.__main__"} < set(SCRIPTS)


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
