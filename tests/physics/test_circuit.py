# SPDX-License-Identifier: Apache-2.0
"""The forward model against Kirchhoff's equations, and the laws that it must obey."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import kirchhoff

from tactile_skin import Circuit, forward
from tactile_skin.physics.laplacian import two_terminal_resistance

SHAPES = [(2, 2), (3, 3), (9, 4), (8, 16), (16, 16)]


def random_resistance(rng, *shape):
    """Anything from a pressed to an idle cell, spread over the decades."""
    return np.exp(rng.uniform(np.log(85.0), np.log(40_000.0), shape))


@pytest.mark.parametrize("shape", SHAPES)
def test_equals_the_literal_system(shape):
    """The one small inverse gives what one solve of rows*cols + 1 equations per reading gives."""
    rng = np.random.default_rng(sum(shape))
    for _ in range(8 if shape == (8, 16) else 25 if shape != (16, 16) else 2):
        resistance = random_resistance(rng, *shape)
        expected = kirchhoff.adc_ratio(resistance, 1780.0, 326.0)
        np.testing.assert_allclose(forward(Circuit(*shape), resistance), expected, rtol=1e-9)


def test_two_by_two_by_hand():
    """Four equal cells: one cell in parallel with three in series, 3/4 R."""
    circuit = Circuit(2, 2, r_ref=1000.0, r_par=0.0)
    resistance = np.full((2, 2), 400.0)
    np.testing.assert_allclose(forward(circuit, resistance), 1000.0 / 1300.0, rtol=1e-12)


def test_a_single_row_has_no_cross_talk():
    resistance = np.array([[100.0, 5000.0, 900.0]])
    circuit = Circuit(1, 3)
    np.testing.assert_allclose(circuit.two_terminal(forward(circuit, resistance)), resistance)


sizes = st.tuples(st.integers(2, 9), st.integers(2, 9), st.integers(0, 2**32 - 1))


@settings(max_examples=20, deadline=None)
@given(sizes)
def test_reciprocity(size):
    """Rows and columns may change places."""
    rows, cols, seed = size
    g = 1.0 / random_resistance(np.random.default_rng(seed), rows, cols)
    np.testing.assert_allclose(
        two_terminal_resistance(g.T), two_terminal_resistance(g).T, rtol=1e-9
    )


@settings(max_examples=20, deadline=None)
@given(sizes)
def test_rayleigh_monotonicity(size):
    """Pressing one cell lowers no reading, and raises its own."""
    rows, cols, seed = size
    rng = np.random.default_rng(seed)
    circuit = Circuit(rows, cols)
    resistance = random_resistance(rng, rows, cols)
    cell = rng.integers(rows), rng.integers(cols)
    pressed = resistance.copy()
    pressed[cell] *= 0.5
    change = forward(circuit, pressed) - forward(circuit, resistance)
    assert change.min() > -1e-12
    assert change[cell] > 0.0


def test_a_batch_equals_its_frames():
    rng = np.random.default_rng(4)
    circuit = Circuit(5, 7)
    batch = random_resistance(rng, 2, 3, 5, 7)
    together = forward(circuit, batch)
    for k in np.ndindex(2, 3):
        np.testing.assert_allclose(together[k], forward(circuit, batch[k]), rtol=1e-12)


def test_missing_cells_are_open_circuits():
    """A mask reads as cells of nearly infinite resistance do in the literal system."""
    rng = np.random.default_rng(6)
    mask = rng.random((6, 6)) < 0.7
    mask[0] = mask[:, 0] = True
    resistance = random_resistance(rng, 6, 6)
    expected = kirchhoff.adc_ratio(np.where(mask, resistance, 1e14), 1780.0, 326.0)
    np.testing.assert_allclose(forward(Circuit(6, 6, mask=mask), resistance), expected, rtol=1e-6)


def test_an_open_row_reads_zero_and_leaves_the_others_alone():
    rng = np.random.default_rng(8)
    resistance = random_resistance(rng, 5, 5)
    resistance[2] = np.inf
    adc = forward(Circuit(5, 5), resistance)
    assert (adc[2] == 0.0).all()
    kept = np.delete(resistance, 2, 0)
    np.testing.assert_allclose(np.delete(adc, 2, 0), forward(Circuit(4, 5), kept), rtol=1e-9)


def test_parts_without_a_path_between_them_read_as_skins_of_their_own():
    rng = np.random.default_rng(9)
    resistance = np.full((5, 6), np.inf)
    resistance[:2, :3] = random_resistance(rng, 2, 3)
    resistance[2:, 3:] = random_resistance(rng, 3, 3)
    adc = forward(Circuit(5, 6), resistance)
    np.testing.assert_allclose(adc[:2, :3], forward(Circuit(2, 3), resistance[:2, :3]), rtol=1e-9)
    np.testing.assert_allclose(adc[2:, 3:], forward(Circuit(3, 3), resistance[2:, 3:]), rtol=1e-9)
    assert (adc[:2, 3:] == 0.0).all() and (adc[2:, :3] == 0.0).all()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"rows": 0}, "rows = 0"),
        ({"cols": 2.5}, "cols = 2.5"),
        ({"r_ref": 0.0}, "r_ref = 0.0 ohm"),
        ({"r_par": -1.0}, "r_par = -1.0 ohm"),
        ({"adc_bits": 40}, "adc_bits = 40"),
        ({"mask": np.ones((3, 3))}, "mask has shape"),
        ({"mask": np.eye(16)}, "must connect"),
    ],
)
def test_a_circuit_that_cannot_be_is_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        Circuit(**kwargs)


@pytest.mark.parametrize(
    ("resistance", "message"),
    [
        (np.ones((3, 3)), "must end in"),
        (np.zeros((16, 16)), "0.0 ohm"),
        (np.full((16, 16), np.nan), "nan ohm"),
        (np.full((16, 16), -5.0), "-5.0 ohm"),
    ],
)
def test_resistances_that_cannot_be_are_refused(resistance, message):
    with pytest.raises(ValueError, match=message):
        forward(Circuit(), resistance)


def test_ratio_and_two_terminal_are_inverse():
    circuit = Circuit()
    rho = np.array([0.0, 85.0, 40_000.0, np.inf])
    np.testing.assert_allclose(circuit.two_terminal(circuit.ratio(rho)), rho, atol=1e-9)
