# SPDX-License-Identifier: Apache-2.0
"""The network of one frame: K against its definition, and what follows from it."""

import numpy as np
import pytest
from support.kirchhoff import transfer_resistance

from tactile_skin.physics import laplacian

SIZES = [(1, 1), (1, 5), (5, 1), (3, 2), (16, 16), (8, 24), (24, 8), (32, 32), (63, 1)]


@pytest.fixture(params=SIZES, ids=str)
def g(request):
    return np.exp(np.random.default_rng(5).normal(-7.0, 2.0, request.param))


def of_lines(p: np.ndarray) -> np.ndarray:
    """The Laplacian of conductances p (rows, cols), written out."""
    rows = len(p)
    matrix = np.zeros((sum(p.shape),) * 2)
    matrix[:rows, rows:], matrix[rows:, :rows] = -p, -p.T
    return matrix - np.diag(matrix.sum(1))


def test_k_is_a_generalised_inverse_of_the_laplacian(g):
    network, matrix = laplacian.solve(g), of_lines(g)
    np.testing.assert_allclose(matrix @ network.k @ matrix, matrix, atol=1e-9 * matrix.max())
    assert network.log_det == pytest.approx(np.linalg.slogdet(network.k)[1])
    between = np.linalg.pinv(matrix)
    own, rows = between.diagonal(), len(g)
    rho = own[:rows, None] + own[rows:] - 2.0 * between[:rows, rows:]
    np.testing.assert_allclose(network.rho, rho, rtol=1e-7)
    np.testing.assert_allclose(laplacian.connected_rho(g), network.rho, rtol=1e-12)
    np.testing.assert_allclose(np.vdot(g, network.rho), sum(g.shape) - 1)  # Foster


def test_the_product_with_the_hessian_is_the_sum_of_squared_transfer_resistances(g):
    network, p = laplacian.solve(g), np.random.default_rng(6).standard_normal(g.shape)
    t = transfer_resistance(network.k, len(g))
    found = laplacian.hessian_product(network.k, p).ravel()
    expected = np.square(t) @ p.ravel()
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_the_sensitivity_is_the_squared_transfer_resistance(g):
    rng, network = np.random.default_rng(7), laplacian.solve(g)
    weight, lines = rng.random(g.shape), np.arange(g.size, dtype=np.int32)
    readings = rng.permutation(lines)[: g.size // 2 + 1]
    row, col = np.divmod(lines, np.int32(g.shape[1]))
    t = transfer_resistance(network.k, len(g))
    expected = (weight.reshape(-1, 1) * np.square(t))[readings]
    found = laplacian.sensitivity(network.k, weight, readings, row, col + np.int32(len(g)))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * expected.max())


@pytest.mark.parametrize("touched", [0, 60])
def test_near_the_hessian_conjugate_gradients_take_half_the_steps(touched):
    rng = np.random.default_rng(4)
    g = np.exp(rng.normal(0.0, 0.3, (40, 24)))
    g.flat[rng.choice(g.size, touched, replace=False)] *= 1e3
    network = laplacian.solve(g)
    cells = np.sort(rng.choice(g.size, 700, replace=False))
    moves, taken = np.zeros(g.shape), []
    moves.flat[cells] = 1.0
    b = moves * rng.normal(size=g.shape)

    def product(p):
        taken[-1] += 1
        return laplacian.hessian_product(network.k, p) * moves

    diagonal = np.square(network.rho)
    for near in (laplacian.near_hessian(network.rho, g, cells), lambda r: r / diagonal):
        taken.append(0)
        x = laplacian.conjugate_gradients(product, near, b, 1e-6)
        assert np.allclose(product(x), b, atol=1e-3 * np.abs(b).max())
    assert taken[0] < taken[1] / 2


def test_a_network_that_is_singular_to_rounding_has_resistances():
    g = np.full((4, 4), 1e-14)
    g[:2, :2] = g[2:, 2:] = 1e6
    rho = laplacian.connected_rho(g)
    assert (rho > 0.0).all()
    np.testing.assert_allclose(rho[:2, :2], 0.75e-6, rtol=0.05)  # 1 MS beside three in series
