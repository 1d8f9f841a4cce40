# SPDX-License-Identifier: Apache-2.0
"""The pages hold the lines of the run whose pictures they show."""

import json
from pathlib import Path

import pytest

from benchmarks import pages
from tactile_skin.bench import speed
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS


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
