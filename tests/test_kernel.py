"""The compiled inner loops against the same in NumPy, which other tests hold against physics."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, circuit, compensate, forward, network, scenes
from tactile_skin.solvers import check_reading, laplacian, map, prior

# the package has a function of that name
fixed_point = importlib.import_module("tactile_skin.solvers.fixed_point")
kernel = circuit.kernel
pytestmark = pytest.mark.skipif(kernel is None, reason="no compiler was found at installation")
SIZES = [(1, 1), (1, 5), (5, 1), (3, 2), (16, 16), (8, 24), (24, 8), (32, 32), (63, 1)]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def both(monkeypatch):
    """A function's results, compiled and in NumPy."""

    def both(function, *args):
        compiled = function(*args)
        with monkeypatch.context() as patch:
            for module in (circuit, map, prior):
                patch.setattr(module, "kernel", None)
            return compiled, function(*args)

    return both


def conductance(rng, shape) -> np.ndarray:
    return np.exp(rng.normal(-7.0, 2.0, shape))


@pytest.mark.parametrize("shape", SIZES)
def test_the_network_is_numpys(both, rng, shape):
    g, p = conductance(rng, shape), rng.normal(size=shape)
    compiled, plain = both(circuit.connected_rho, g)
    np.testing.assert_allclose(compiled, plain, rtol=1e-12)
    compiled, plain = both(laplacian.solve, g)
    for one, other in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-13 * np.abs(other).max())
    products = both(laplacian.hessian_product, plain.k, p)
    np.testing.assert_allclose(*products, rtol=1e-9, atol=1e-12 * np.abs(products[1]).max())


def test_a_network_that_is_singular_to_rounding_is_left_to_numpy(both):
    """Conductances 20 decades apart: the factor fails, the eigenvalues do not."""
    g = np.full((4, 4), 1e-14)
    g[:2, :2] = g[2:, 2:] = 1e6
    k, rho = np.empty((8, 8)), np.empty((4, 4))
    assert kernel.network(4, 4, np.full((4, 4), np.nan), np.empty((8, 8)), k, rho) is False
    compiled, plain = both(circuit.connected_rho, g)
    assert (compiled > 0).all()
    np.testing.assert_allclose(compiled[:2, :2], plain[:2, :2], rtol=1e-6)


@pytest.mark.parametrize("shape", SIZES)
def test_how_readings_follow_a_conductance(both, rng, shape):
    k = laplacian.solve(conductance(rng, shape)).k
    weight = rng.random(shape)
    told = np.flatnonzero(rng.random(shape) < 0.7).astype(np.int32)
    one, other = rng.integers(0, sum(shape), (2, 9)).astype(np.int32)
    compiled, plain = both(laplacian.sensitivity, k, weight, told, one, other)
    assert compiled.shape == (told.size, 9)
    np.testing.assert_allclose(compiled, plain, rtol=1e-5, atol=1e-7 * plain.max(initial=1e-9))


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("masked", [False, True])
def test_the_prior_is_numpys(both, rng, shape, masked):
    mask = np.ones(shape, bool)
    if masked:
        mask[1:, 1:] = rng.random((shape[0] - 1, shape[1] - 1)) < 0.7
    between = prior.differences(Circuit(*shape, mask=mask))
    x = -10.5 + np.abs(rng.normal(0.0, 2.0, shape))
    compiled, plain = both(prior.touches, x, -10.5, between)
    assert compiled.value == pytest.approx(plain.value, rel=1e-12)
    for one, other in zip(compiled[1:], plain[1:], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def definite(rng, n: int) -> np.ndarray:
    a = rng.normal(size=(n, n + 3))
    return (a @ a.T / n + 0.1 * np.eye(n)).astype(np.float32)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 17, 130])
def test_a_step_in_a_box_is_numpys(both, rng, n):
    met = 0
    for _ in range(20):
        s, b = definite(rng, n), rng.normal(size=n)
        low, high = -rng.exponential(1.0, n), rng.exponential(1.0, n)
        compiled, plain = both(map._solve_in_box, s, b, low, high)
        np.testing.assert_array_equal(compiled[2], plain[2])
        np.testing.assert_allclose(compiled[0], plain[0], rtol=1e-3, atol=1e-4)
        u, v = (np.triu(factor) for factor in (compiled[1], plain[1]))
        np.testing.assert_allclose(u.T @ u, v.T @ v, rtol=1e-3, atol=1e-4)
        assert ((compiled[0] >= low) & (compiled[0] <= high)).all()
        met += (~compiled[2]).sum()
    assert met or n == 1  # a single unknown that leaves the box is put on its end


def test_a_step_without_a_factor(both):
    s, b = np.array([[1.0, 2.0], [2.0, 1.0]], np.float32), np.ones(2)
    ends = np.full(2, -9.0), np.full(2, 9.0)
    compiled, plain = both(map._solve_in_box, s, b, *ends)  # definite with a ridge
    np.testing.assert_allclose(compiled[0], plain[0], rtol=1e-5)
    s[:] = -np.eye(2)
    for dx, factor, _ in both(map._solve_in_box, s, b, *ends):
        assert factor is None
        assert not dx.any()


@pytest.mark.parametrize("told", [1, 6, 23])
def test_the_precision_is_numpys(both, rng, told):
    between = prior.differences(Circuit(4, 5))
    terms = prior.touches(-10.5 + np.abs(rng.normal(size=(4, 5))), -10.5, between)
    free = np.flatnonzero(rng.random(20) < 0.6)
    jacobian = rng.normal(size=(told, free.size)).astype(np.float32)
    for known in (terms, terms._replace(entries=None)):
        compiled, plain = both(map._precision, jacobian, known, between, free)
        np.testing.assert_allclose(np.triu(compiled), np.triu(plain), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 17, 130])
def test_the_diagonal_of_an_inverse_is_numpys(both, rng, n):
    s = definite(rng, n)
    compiled, plain = both(map._inverse_diagonal, np.linalg.cholesky(s).T.copy())
    np.testing.assert_allclose(compiled, plain, rtol=1e-3)
    np.testing.assert_allclose(compiled, np.linalg.inv(s.astype(float)).diagonal(), rtol=1e-3)


@pytest.mark.parametrize("shape", [(3, 2), (16, 16), (8, 24)])
def test_the_fixed_point_is_numpys(both, rng, shape):
    board, curve = Circuit(*shape), PressureCurve()
    (force,) = scenes.sample("rects", 1, *shape, rng) if min(shape) > 8 else rng.random((1, *shape))
    reading = check_reading(forward(board, curve.resistance(force)), board, curve)
    for steps in (0, 1, 3, 12):
        (g, taken), (plain, also) = both(
            fixed_point.iterate, reading, fixed_point.first_guess(reading), steps, 1e-3
        )
        assert taken == also
        np.testing.assert_allclose(g, plain, rtol=1e-6)
    assert not np.array_equal(g, fixed_point.first_guess(reading))


@pytest.mark.parametrize("shape", [(3, 2), (16, 16), (8, 24)])
def test_the_networks_inputs_are_numpys(both, rng, shape):
    board, curve = Circuit(*shape), PressureCurve()
    adc = forward(board, curve.resistance(10.0 * rng.random((1, *shape)) ** 4))
    inputs, plain = both(network.physics_inputs, adc, board, curve)
    np.testing.assert_allclose(inputs, plain, rtol=1e-5, atol=1e-6)
    assert np.ptp(inputs, axis=(1, 2, 3)).min() > 0.01


@pytest.mark.parametrize("family", ["blobs", "rects", "random"])
@pytest.mark.parametrize("method", ["newton", "map"])
def test_estimates_are_numpys(both, family, method):
    board, curve = Circuit(), PressureCurve()
    rng = np.random.default_rng(7)
    for force in scenes.sample(family, 5, *board.shape, rng):
        adc = forward(board, curve.resistance(force))
        if method == "map":
            adc = np.rint(adc * 1023) / 1023
        compiled, plain = both(compensate, adc, board, curve, method)
        assert compiled.status == plain.status
        # map stops at the noise, where rounding leaves more to choose from than for newton
        close = 1e-2 if method == "map" else 1e-6
        np.testing.assert_allclose(compiled.force, plain.force, rtol=close, atol=0.1 * close)
        # a cell that rounding keeps at rest, or not, has another spread
        assert np.median(np.abs(compiled.std - plain.std)) < 1e-5


@pytest.mark.parametrize(
    ("function", "arguments", "named"),
    [
        ("two_terminal", (2, 2, np.ones((2, 2))), "4 arguments are due, got 3"),
        ("two_terminal", (40, 40, np.ones((40, 40)), np.ones((40, 40))), "1 to 64 lines"),
        ("two_terminal", (0, 2, np.ones((0, 2)), np.ones((0, 2))), "1 to 64 lines"),
        ("two_terminal", (2, 2, np.ones(3), np.ones(4)), "argument 2: must have 4 items, has 3"),
        (
            "two_terminal",
            (2, 2, np.ones(4, int), np.ones(4)),
            "argument 2: must be an array of 'd'",
        ),
        ("two_terminal", ("2", 2, np.ones(4), np.ones(4)), "integer"),
        ("touches", (1, 2), "10 arguments are due, got 2"),
        ("solve_in_box", (np.ones(4, "f"), *4 * [1]), "8 arguments are due, got 5"),
    ],
)
def test_what_is_no_such_array_is_refused(function, arguments, named):
    with pytest.raises((TypeError, ValueError), match=named):
        getattr(kernel, function)(*arguments)


def test_what_cannot_be_written_is_refused():
    rho = np.ones((2, 2))
    rho.setflags(write=False)
    with pytest.raises(ValueError, match="read-only"):
        kernel.two_terminal(2, 2, np.ones((2, 2)), rho)
    with pytest.raises(ValueError, match="contiguous"):
        kernel.two_terminal(2, 2, np.ones((2, 4))[:, ::2], np.ones((2, 2)))
