# SPDX-License-Identifier: Apache-2.0
"""Touches on the simulated board, `scan`, `auto`, against their truth."""

import numpy as np
import pytest

from benchmarks.accuracy import touch, truth
from benchmarks.body import seam

SIZES = {"singles": 60, "neighbours": 20, "corners": 40, "streams": 2, "strokes": 2}


@pytest.fixture(scope="module")
def quick():
    return touch.measure(SIZES, seed=3)


@pytest.mark.ci
def test_every_bound_is_met(quick):
    """All lines of Must show: force, direction, centre, two beside each other, ghosts, ids."""
    found = touch.lines(quick)
    assert len([line for line in found if line.bound is not None]) == 13
    assert not [str(line) for line in found if not line.met]


@pytest.mark.ci
def test_the_naive_method_would_not_meet_them(quick):
    """The frames of corners are such that ghosts arise."""
    assert quick["corners"]["naive_ghosts"] > 0.5 * SIZES["corners"]


# --- the benchmark itself ---


def test_a_pads_force_and_centre_do_not_depend_on_the_cells():
    """Its sum is its force, and its centre is where it was put, not where the cells are."""
    pad = truth.Pad("sphere", 5.3, 7.9, 4.0, 3.0, 0.6)
    fine = pad.pressed(20.0)
    assert fine.sum() == pytest.approx(20.0)
    assert truth.cells(fine).sum() == pytest.approx(20.0)
    moment = fine.ravel() @ truth._FINE_SKIN.lever
    middle = truth._on_skin(np.array([5.3, 7.9]))
    assert moment[8] / 20.0 == pytest.approx(middle[2], abs=1e-4)
    azimuth = np.arctan2(moment[7], moment[6])
    assert azimuth == pytest.approx(np.arctan2(middle[1], middle[0]), abs=1e-3)
    np.testing.assert_allclose(
        moment[:3] / np.linalg.norm(moment[:3]), -middle * [1, 1, 0] / 0.15, atol=0.01
    )


@pytest.mark.parametrize("kind", truth.KINDS)
def test_gaps_sense_the_same_on_the_whole(kind):
    """12 of 18 mm speak for all: right on average over a wide pad, not on each small one."""
    rng = np.random.default_rng(0)
    ratio = [
        truth.sensed_cells(p).sum() / p.sum()
        for p in (
            truth.Pad(kind, *rng.uniform(6, 9, 2), 6.0, 6.0, 0.3).pressed(1.0) for _ in range(20)
        )
    ]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.ptp(ratio) > 1e-3


@pytest.mark.ci
def test_a_missed_bound_is_told(capsys, monkeypatch):
    """The command's exit status and its line say so."""
    monkeypatch.setattr(truth.found_in, "__defaults__", ("naive", 0.0))
    monkeypatch.setattr(touch, "QUICK", dict.fromkeys(touch.QUICK, 1) | {"singles": 8})
    assert touch.main(["--quick"]) == 1
    assert "MISSED" in capsys.readouterr().out


def test_a_few_strokes_keep_their_id():
    found = seam.measure(strokes=6, seed=11)
    assert found["seam"]["one_id"] == found["one_mat"]["one_id"] == 1.0
