"""Frames of a real floating insole (tests/data/insole_floating.txt names the source)."""

from pathlib import Path

import numpy as np
import pytest

from tactile_skin.bench import insole

with np.load(Path(__file__).parent / "data" / "insole_floating.npz") as data:
    FRAMES, ROW, COL = data["counts"], data["row"], data["col"]
SKIN = insole.circuit(FRAMES[0] >= 0)


def test_the_circuit_explains_what_the_board_read():
    """To 0.2 % of full scale, less than a tenth of the readings left out."""
    result = insole.summary(FRAMES[::6], SKIN)
    assert result["residual p5 p50 p95"][2] < 9.0  # counts of 4095
    assert result["readings dropped p50 max"][1] <= insole.DROPS


def test_shuffled_cells_and_a_wrong_wiring_are_suspect():
    for name, result in insole.controls(FRAMES[::7], ROW, COL).items():
        assert result["suspect"] >= 0.95, name


def test_less_of_the_picture_is_loaded_after_the_fit():
    """Ghosts are parallel paths: the naive picture can only overestimate."""
    frame = FRAMES[10]
    cells = insole.curve()
    estimate, _ = insole.fit(frame, SKIN, cells)
    naive = cells.force(SKIN.two_terminal(np.maximum(frame, 1) / insole.FULL_SCALE))
    read = frame > 0
    assert estimate.force[read].sum() < 0.6 * naive[read].sum()


def test_a_frame_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    insole.draw(FRAMES[0], ROW, COL, tmp_path / "insole.png")
    assert (tmp_path / "insole.png").stat().st_size > 5000
