# SPDX-License-Identifier: Apache-2.0
"""An untouched skin is taken, with noisy cells too; one that something touches is not."""

import numpy as np
import pytest
from support import resting
from support.lab.unknown import Unknown

from tactile_skin import Circuit, measure_rest

SHAPES = (4, 4), (8, 12), (16, 16)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", resting.NOISY)
def test_noisy_cells_are_named_and_not_used(shape, kind):
    board, rng = Unknown(shape, 31), np.random.default_rng(31)
    cells, frames = resting.noisy(board, kind, 60, rng)
    rest = measure_rest(frames, board.supposed)
    assert set(rest.noisy) == set(cells)
    assert rest.noise < 1.0
    sound = measure_rest(board.at_rest(60), board.supposed).conductance
    np.testing.assert_allclose(rest.conductance, sound, rtol=0.2)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", resting.TOUCHED)
def test_what_touches_is_refused(shape, kind):
    board, rng = Unknown(shape, 32), np.random.default_rng(32)
    with pytest.raises(ValueError, match="does something touch"):
        measure_rest(resting.touched(board, kind, 60, rng), board.supposed)


def test_neighbours_that_move_together_are_refused():
    """Whatever their rows and columns say: noise is each cell's own."""
    board = Unknown((16, 16), 33)
    frames = board.at_rest(60)
    frames[np.random.default_rng(1).random(60) < 0.5, 4, 5:7] += 0.1
    with pytest.raises(ValueError, match="row 4, column"):
        measure_rest(frames, board.supposed)


def test_a_sound_skin_has_no_noisy_cells():
    for seed in range(5):
        board = Unknown((8, 8), seed)
        assert measure_rest(board.at_rest(), board.supposed).noisy == ()


def test_a_single_sensor_is_measured_as_it_is():
    """Its rest differs by half from one press to the next; what touches it conducts 15 times it."""
    circuit = Circuit(1, 3, r_ref=1e4, r_par=0.0, readout="grounded")
    ohm = np.repeat(np.array([[3e5, 5e4, 9e4], [1.4e5, 1e5, 1.9e5]]), 30, 0)[:, None]
    adc = circuit.r_ref / (circuit.r_ref + ohm)
    rest = measure_rest(adc, circuit)
    assert rest.noisy == ()
    assert 1.0 / rest.conductance[0] == pytest.approx([2e5, 7e4, 1.2e5], rel=0.5)
    adc[40, 0, 1] = 0.7
    with pytest.raises(ValueError, match="row 0, column 1 conducts"):
        measure_rest(adc, circuit)
