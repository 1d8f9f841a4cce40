# SPDX-License-Identifier: Apache-2.0
"""Frames of a real floating insole (tests/data/insole_floating.txt names the source)."""

from pathlib import Path

import numpy as np
import pytest
from support import insole

with np.load(Path(__file__).parents[1] / "data" / "insole_floating.npz") as data:
    FRAMES, ROW, COL, RECORDING = (data[n] for n in ("counts", "row", "col", "recording"))
SKIN = insole.circuit(FRAMES[0] >= 0)
WALKING_LEFT, STANDING_LEFT, WALKING_RIGHT, STANDING_RIGHT = range(4)
ALL = WALKING_LEFT, STANDING_LEFT, WALKING_RIGHT, STANDING_RIGHT


def frames_of(recording: int) -> np.ndarray:
    return FRAMES[np.equal(RECORDING, recording)]


@pytest.mark.parametrize("recording", ALL)
def test_the_circuit_explains_what_the_board_read(recording):
    """To 0.2 % of full scale, less than a tenth of the readings left out; no constant was fitted
    to these frames."""
    result = insole.summary(frames_of(recording)[::2], SKIN)
    assert result["ok"] >= 0.85, result["why"]
    assert result["residual p5 p50 p95"][2] < 7.0  # counts of 4095
    assert result["readings dropped p50 max"][1] <= insole.DROPS


def test_shuffled_cells_and_a_wrong_wiring_are_suspect_but_a_sound_twin_is_not():
    result = insole.controls(FRAMES[::7], ROW, COL)
    assert result["simulated"]["ok"] >= 0.9
    for name in ("permuted", "picture's grid"):
        assert result[name]["suspect"] >= 0.95, name


@pytest.mark.ci
def test_a_sound_sole_loaded_throughout_is_not_called_wrong():
    """With a cell to move for each reading, a lean of the misfit is the prior's, not r_par's."""
    frames = np.concatenate([frames_of(STANDING_LEFT), frames_of(STANDING_RIGHT)] * 3)
    result = insole.summary(insole.twins(frames, SKIN), SKIN)
    assert result["ok"] >= 0.93, result["why"]


@pytest.mark.ci
def test_the_adc_starts_at_142_mv():
    """In each of them more is explained than by an ADC that starts at 0 V."""
    assert insole.ratio(0) == pytest.approx(0.142 / 3.3)
    assert insole.ratio(1000) == pytest.approx((0.142 + 0.8056) / 3.3, abs=1e-4)
    for recording in ALL:
        frames = frames_of(recording)[::4]
        calibrated = insole.summary(frames, SKIN)["unexplained"]
        assert calibrated < 0.95 * insole.summary(frames, SKIN, offset=0.0)["unexplained"]


def test_the_pressure_adds_up_to_a_persons_weight():
    """Standing on both feet: that is what fixes the divider, which the fit leaves open."""
    both = sum(
        insole.summary(frames_of(foot)[::3], SKIN)["weight N p50"]
        for foot in (STANDING_LEFT, STANDING_RIGHT)
    )
    assert 400 < both < 900


def test_less_of_the_picture_is_loaded_after_the_fit():
    """Ghosts are parallel paths: the naive picture can only overestimate."""
    frame = FRAMES[10]
    cells = insole.curve()
    estimate, _ = insole.fit(frame, SKIN, cells)
    naive = cells.force(SKIN.two_terminal(insole.ratio(np.maximum(frame, 1))))
    read = frame > 0
    assert estimate.force[read].sum() < 0.6 * naive[read].sum()
