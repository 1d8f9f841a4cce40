# SPDX-License-Identifier: Apache-2.0
"""The ablation: what is switched off says nothing, and all else stays as it was."""

import json

import numpy as np
import pytest

from benchmarks.ablation import run as ablation
from benchmarks.ablation.mechanisms import (
    ALL_ON,
    BUNDLES,
    MECHANISMS,
    changes,
    numbers_of,
    sweep,
    variants,
)
from benchmarks.ablation.switchboard import installed
from tactile_skin.calibration import tare
from tactile_skin.calibration.at_rest import which_are_one
from tactile_skin.findings.finding import Kind

CELLS = np.ones((4, 8), bool)
NOISE = 0.05  # ADC steps


@pytest.fixture
def board():
    with installed(MECHANISMS) as board:
        yield board


def equal_rows():
    """A picture at rest whose rows 1 and 2 read the same."""
    steps = 40.0 + np.random.default_rng(3).normal(0.0, 2.0, CELLS.shape)
    steps[2] = steps[1]
    return steps


def test_a_mechanism_that_is_off_says_nothing_and_one_that_is_on_is_heard(board):
    found = tare.which_are_one(equal_rows(), NOISE, CELLS)
    assert (found.kind, found.rows) == (Kind.DOUBLED, (1, 2))
    assert board.spoke == {"twins"}
    board.switch_off({"twins"})
    assert tare.which_are_one(equal_rows(), NOISE, CELLS) is None
    assert board.spoke == set()


def test_all_is_as_it_was_once_the_board_is_closed():
    with installed(MECHANISMS):
        assert tare.which_are_one is not which_are_one
    assert tare.which_are_one is which_are_one


def test_a_sweep_plays_again_only_what_can_differ(board):
    played = []

    def play():
        found = tare.which_are_one(equal_rows(), NOISE, CELLS)
        played.append(board.off)
        return {"found": bool(found)}

    results, spoke = sweep(board, play, frame=False)
    assert spoke == {"twins"}
    assert played == [frozenset(), frozenset({"twins"})]
    row = {"results": changes(results)}
    assert numbers_of(row, "twins") == {"found": False}
    assert numbers_of(row, "odd cells") == numbers_of(row, ALL_ON) == {"found": True}


def test_every_mechanism_has_code_or_a_limit_and_every_bundle_knows_its_members():
    names = {m.name for m in MECHANISMS}
    assert len(names) == len(MECHANISMS)
    assert all(m.parts for m in MECHANISMS)
    assert all(m.lines > 0 for m in MECHANISMS if m.source)
    assert all(set(members) <= names for members in BUNDLES.values())
    assert set(variants(False)) >= names


@pytest.mark.slow
def test_a_quick_run_makes_a_page_and_measures_nothing_twice(tmp_path):
    ablation.main(["--quick", "--out", str(tmp_path)])
    page = (tmp_path / "ablation.md").read_text(encoding="utf-8")
    assert "| live.ring |" in page
    assert "| by_residual |" in page
    before = json.loads((tmp_path / "ablation.json").read_text(encoding="utf-8"))
    ring = next(row for row in before["streams"] if row["name"] == "ring of 5")
    assert numbers_of(ring, "live.ring")["silent"] > numbers_of(ring, ALL_ON)["silent"]
    ablation.main(["--quick", "--out", str(tmp_path)])
    assert json.loads((tmp_path / "ablation.json").read_text(encoding="utf-8")) == before
