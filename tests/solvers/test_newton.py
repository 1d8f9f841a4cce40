# SPDX-License-Identifier: Apache-2.0
"""The exact inverse and the algebra under it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.measure import moving_touch
from tactile_skin.physics.curve import GRAM
from tactile_skin.physics.laplacian import conjugate_gradients, two_terminal_resistance
from tactile_skin.physics.readouts import solve
from tactile_skin.simulation import scenes
from tactile_skin.solvers.newton import _height
from tactile_skin.solvers.reading import check_reading

CURVE = PressureCurve()


def conductances(shape, seed=0):
    rng = np.random.default_rng(seed)
    return 10.0 ** rng.uniform(-4.5, -2.0, shape)  # S


def test_the_readings_are_the_gradient_of_the_log_determinant():
    """d phi / d g = rho(g) - rho_measured, by central differences."""
    circuit = Circuit(4, 5)
    g = conductances((4, 5))
    reading = check_reading(forward(circuit, 1.0 / conductances((4, 5), 3)), circuit, CURVE)
    slope = two_terminal_resistance(g) - reading.rho
    for i, j in np.ndindex(g.shape):
        step = np.zeros(g.shape)
        step[i, j] = 1e-5 * g[i, j]
        up, down = (_height(reading, g + s, solve(circuit, g + s), slope) for s in (step, -step))
        difference = (up - down) / (2 * step[i, j])
        assert difference == pytest.approx(slope[i, j], rel=1e-4, abs=1e-3)


def test_conjugate_gradients_solve_a_small_system():
    rng = np.random.default_rng(2)
    a = rng.standard_normal((12, 12))
    a = a @ a.T + np.eye(12)
    b = rng.standard_normal(12)
    x = conjugate_gradients(lambda p: a @ p, lambda r: r / a.diagonal(), b, 1e-12)
    np.testing.assert_allclose(a @ x, b, atol=1e-8)


@pytest.mark.parametrize("family", scenes.FAMILIES)
def test_ideal_readings_give_the_force_to_a_milligram(family):
    circuit = Circuit()
    force = scenes.sample(family, 25, 16, 16, np.random.default_rng(5))
    for truth, adc in zip(force, forward(circuit, CURVE.resistance(force)), strict=True):
        estimate = compensate(adc, circuit, CURVE, "newton")
        assert estimate.status == "ok" and estimate.residual < 1e-6
        assert np.abs(estimate.force - truth).max() < 1e-3 * GRAM


def test_a_moving_touch_is_followed_from_the_last_frame():
    circuit = Circuit()
    force = moving_touch(12, np.random.default_rng(6))
    adc = forward(circuit, CURVE.resistance(force))
    last = compensate(adc[0], circuit, CURVE, "newton")
    for truth, frame in zip(force[1:], adc[1:], strict=True):
        last = compensate(frame, circuit, CURVE, "newton", start=last)
        assert last.status == "ok"
        assert np.abs(last.force - truth).max() < 1e-3 * GRAM


@pytest.mark.parametrize("grams", [0.0, 1000.0])
def test_the_way_there_does_not_matter(grams):
    """From anywhere to the one solution: the problem is strictly concave."""
    circuit = Circuit()
    truth = scenes.sample("rects", 1, 16, 16, np.random.default_rng(7))[0]
    adc = forward(circuit, CURVE.resistance(truth))
    far = compensate(forward(circuit, CURVE.resistance(np.full((16, 16), grams * GRAM))),
                     circuit, CURVE, "newton")  # fmt: skip
    estimate = compensate(adc, circuit, CURVE, "newton", start=far)
    assert np.abs(estimate.force - truth).max() < 1e-3 * GRAM


@settings(max_examples=40, deadline=None)
@given(
    rows=st.integers(1, 9),
    cols=st.integers(1, 9),
    holes=st.floats(0.0, 0.4),
    r_ref=st.floats(200.0, 2e4),
    r_par=st.floats(0.0, 500.0),
    seed=st.integers(0, 2**31),
)
def test_any_connected_circuit_is_inverted(rows, cols, holes, r_ref, r_par, seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((rows, cols)) >= holes
    mask[0] = mask[:, 0] = True  # keeps all lines connected
    circuit = Circuit(rows, cols, r_ref=r_ref, r_par=r_par, mask=mask)
    truth = rng.uniform(0.0, CURVE.max_force, (rows, cols)) * (rng.random((rows, cols)) < 0.5)
    truth *= mask
    estimate = compensate(forward(circuit, CURVE.resistance(truth)), circuit, CURVE, "newton")
    assert estimate.status == "ok"
    assert np.abs(estimate.force - truth).max() < 1e-3 * GRAM
    g = circuit.populated / CURVE.resistance(estimate.force)
    foster = np.where(mask, g * two_terminal_resistance(g), 0.0).sum()
    assert foster == pytest.approx(rows + cols - 1, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("size", [32, 64])
def test_large_skins_are_inverted_without_the_matrix(size):
    circuit = Circuit(size, size)
    truth = scenes.sample("random", 1, size, size, np.random.default_rng(8))[0]
    estimate = compensate(forward(circuit, CURVE.resistance(truth)), circuit, CURVE, "newton")
    assert estimate.status == "ok"
    assert np.abs(estimate.force - truth).max() < 1e-3 * GRAM
