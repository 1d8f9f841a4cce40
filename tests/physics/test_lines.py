# SPDX-License-Identifier: Apache-2.0
"""The stripes' resistance, against two networks of another author's making."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_skin.physics import laplacian, lines
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.laplacian import two_terminal_resistance as ideal
from tactile_skin.simulation.network import Wiring, voltage_ratio


def cells(shape, seed=0):
    """Conductances [S] from hard pressed to at rest."""
    rng = np.random.default_rng(seed)
    return 1.0 / np.exp(rng.uniform(np.log(85.0), np.log(40000.0), shape))


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (2, 2), (5, 7), (16, 16)])
def test_the_literal_network_is_that_of_the_simulation(shape):
    """It eliminates the nodes otherwise: its unknowns are the cells' currents."""
    g, divider = cells(shape), Circuit(*shape, r_ref=1.0, r_par=0.0)
    for r_line in (0.0, 0.1, 10.0, 1000.0):
        wiring = replace(Wiring.sound(*shape), stripe=r_line, leakage=0.0)
        rows, cols = (np.full(n, r_line) for n in shape)
        found = divider.ratio(lines.solve(g, rows, cols))
        np.testing.assert_allclose(found, voltage_ratio(g[None], wiring, divider)[0], rtol=1e-9)


def test_a_single_crossing_by_hand():
    """One cell between one piece of either stripe: three resistances in series."""
    g = np.array([[1.0 / 500.0]])
    assert lines.solve(g, np.array([7.0]), np.array([11.0])) == pytest.approx(518.0)


def test_each_stripe_has_its_own():
    """A lone cell at the far corner sees the whole of its row's and its column's stripe."""
    g = np.full((3, 4), 1e-12)
    g[2, 3] = 1e-2
    found = lines.solve(g, np.array([1.0, 2.0, 4.0]), np.array([8.0, 16.0, 32.0, 64.0]))
    assert found[2, 3] == pytest.approx(100.0 + 4.0 + 64.0, rel=1e-6)


def test_lines_that_no_path_connects():
    """Infinite between the parts, finite within, as of ideal stripes."""
    g = np.kron(np.eye(2), np.full((2, 2), 1e-3))
    found = lines.solve(g, np.full(4, 5.0), np.full(4, 5.0))
    np.testing.assert_array_equal(np.isinf(found), np.isinf(ideal(g)))


@pytest.mark.parametrize("shape", [(2, 3), (4, 3), (16, 16)])
def test_the_first_order_is_exact_to_the_second(shape):
    """Halved, the stripes' resistance leaves a quarter of what the first order misses."""
    g = cells(shape, seed=1)
    k, rho = laplacian.solve(g).k, ideal(g)

    def missed(r_line):
        stripes = [r_line * np.linspace(0.5, 1.5, n) for n in shape]
        added = lines.added_resistance(k, g, *stripes)
        return np.abs(lines.solve(g, *stripes) - rho - added).max()

    assert missed(1.0) < 1e-2  # ohm
    assert missed(0.5) == pytest.approx(0.25 * missed(1.0), rel=0.05, abs=1e-9)


def test_forward_reads_the_stripes_too():
    """And a circuit without them reads as if there were none."""
    g = cells((2, 5, 7), seed=2)
    circuit = Circuit(5, 7, r_line=np.arange(12.0))
    stripes = np.arange(5.0), np.arange(5.0, 12.0)
    expected = [circuit.ratio(lines.solve(frame, *stripes)) for frame in g]
    np.testing.assert_allclose(forward(circuit, 1.0 / g), expected)
    none = forward(Circuit(5, 7), 1.0 / g)
    np.testing.assert_array_equal(forward(Circuit(5, 7, r_line=0.0), 1.0 / g), none)
    tiny = forward(Circuit(5, 7, r_line=1e-9), 1.0 / g)
    np.testing.assert_allclose(tiny, none, rtol=1e-9)


@pytest.mark.parametrize("wrong", [-1.0, np.nan, np.inf, np.ones(3)])
def test_what_no_stripe_has_is_refused(wrong):
    """With the name and what is allowed."""
    with pytest.raises(ValueError, match=r"r_line.*must be"):
        Circuit(2, 2, r_line=wrong)
