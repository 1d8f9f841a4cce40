"""The compiled inner loops against the same in NumPy, and what they refuse.

That both are right is what the other tests of physics and solvers say, which run over each.
"""

from __future__ import annotations

import importlib
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from support.implementations import COMPILED

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.physics import kernel, laplacian, numpy_kernel
from tactile_skin.simulation import scenes
from tactile_skin.solvers import check_reading

# the package has a function of that name
fixed_point = importlib.import_module("tactile_skin.solvers.fixed_point")
pytestmark = pytest.mark.skipif(COMPILED is None, reason="no compiler was found at installation")
SIZES = [(1, 1), (1, 5), (5, 1), (3, 2), (16, 16), (8, 24), (24, 8), (32, 32), (63, 1)]


@pytest.fixture(autouse=True)
def implementation():
    """Once, not over both: these tests compare the two."""


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def conductance(rng, shape) -> np.ndarray:
    return np.exp(rng.normal(-7.0, 2.0, shape))


def test_the_implementation_is_named(monkeypatch):
    assert kernel.implementation() == "compiled"
    monkeypatch.setattr(kernel, "_kernel", None)
    assert kernel.implementation() == "in NumPy"


def test_what_was_compiled_from_other_sources_is_not_used(tmp_path):
    sources = Path(kernel.__file__).with_name("kernel")
    assert kernel._is_of(kernel._kernel, sources)
    assert kernel._is_of(kernel._kernel, tmp_path)  # an installed package has no sources
    for file in sources.glob("*.[ch]"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    assert kernel._is_of(kernel._kernel, tmp_path)
    (tmp_path / "box.c").write_text("int other;")
    assert not kernel._is_of(kernel._kernel, tmp_path)


@pytest.mark.parametrize("shape", SIZES)
def test_the_network_is_numpys(rng, shape):
    g = conductance(rng, shape)
    plain = numpy_kernel.solve(g)
    np.testing.assert_allclose(kernel.connected_rho(g), plain.rho, rtol=1e-12)
    np.testing.assert_allclose(numpy_kernel.connected_rho(g), plain.rho, rtol=1e-12)
    for one, other in zip(kernel.solve(g), plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-13 * np.abs(other).max())
    turned = kernel.solve(g.T[::-1].T)  # neither in C's order nor contiguous
    np.testing.assert_allclose(turned.rho, plain.rho[:, ::-1], rtol=1e-12)


def test_a_network_that_is_singular_to_rounding_is_left_to_numpy():
    """Conductances 20 decades apart: the factor fails, the eigenvalues do not."""
    g = np.full((4, 4), 1e-14)
    g[:2, :2] = g[2:, 2:] = 1e6
    found, plain = kernel.connected_rho(g), numpy_kernel.connected_rho(g)
    assert (found > 0).all()
    np.testing.assert_allclose(found[:2, :2], plain[:2, :2], rtol=1e-6)


def test_nan_is_no_network():
    k, rho = np.empty((8, 8)), np.empty((4, 4))
    assert COMPILED.network(4, 4, np.full((4, 4), np.nan), np.empty((8, 8)), k, rho) is False


@pytest.mark.parametrize("shape", SIZES)
def test_the_products_with_the_hessian_are_numpys(rng, shape):
    k, p = laplacian.solve(conductance(rng, shape)).k, rng.standard_normal(shape)
    p[rng.random(shape) < 0.3] = 0.0
    plain = numpy_kernel.hessian_product(k, p)
    atol = 1e-12 * np.abs(plain).max()
    np.testing.assert_allclose(kernel.hessian_product(k, p), plain, rtol=1e-9, atol=atol)
    turned = kernel.hessian_product(k.T, p.T.copy().T)  # not in C's order
    np.testing.assert_allclose(turned, plain, rtol=1e-9, atol=atol)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("scale", [1.0, 1e30])
def test_the_cost_of_differences_is_numpys(rng, shape, scale):
    """Whatever their weights; with huge ones, too, whose product is no number."""
    rows, cols = shape
    n = rows * (cols - 1) + (rows - 1) * cols
    x = scale * rng.standard_normal(shape)
    weight, square = rng.integers(0, 3, n) * 0.7, 0.09
    found = kernel.roughness(x, weight, square)
    for one, other in zip(found, numpy_kernel.roughness(x, weight, square), strict=True):
        np.testing.assert_allclose(
            one, other, rtol=1e-9, atol=1e-12 * (1.0 + np.abs(other).max(initial=0.0))
        )


@pytest.mark.parametrize("shape", SIZES)
def test_how_readings_follow_a_conductance(rng, shape):
    k = laplacian.solve(conductance(rng, shape)).k
    weight = rng.random(shape)
    told = np.flatnonzero(rng.random(shape) < 0.7).astype(np.int32)
    one, other = rng.integers(0, sum(shape), (2, 9)).astype(np.int32)
    found = kernel.sensitivity(k, weight, told, one, other)
    plain = numpy_kernel.sensitivity(k, weight, told, one, other)
    assert found.shape == (told.size, 9)
    np.testing.assert_allclose(found, plain, rtol=1e-5, atol=1e-7 * plain.max(initial=1e-9))


@pytest.mark.parametrize("shape", [(1, 1), (5, 9), (16, 16), (3, 40)])
@pytest.mark.parametrize(
    "channels, outputs, dilation", [(1, 1, 1), (5, 9, 3), (9, 2, 1), (16, 16, 2)]
)
def test_the_convolution_is_numpys(rng, shape, channels, outputs, dilation):
    picture = rng.standard_normal((channels, *shape)).astype(np.float32)
    weight, bias = rng.standard_normal((outputs, channels, 3, 3)), rng.standard_normal(outputs)
    layer = kernel.convolution(weight, bias)
    plain = numpy_kernel.convolve(picture, layer, dilation)
    assert plain.shape == (outputs, *shape)
    found = kernel.convolve(picture, layer, dilation)
    np.testing.assert_allclose(found, plain, rtol=1e-4, atol=1e-5)
    turned = kernel.convolve(picture[:, :, ::-1], layer, dilation)  # not in C's order
    np.testing.assert_allclose(
        turned, numpy_kernel.convolve(picture[:, :, ::-1], layer, dilation), rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize("convolve", [kernel.convolve, numpy_kernel.convolve])
def test_a_convolution_by_hand(convolve):
    """A picture of ones: each cell counts its neighbours, and itself ten times; the bias is 0.5."""
    weight = np.ones((1, 1, 3, 3))
    weight[0, 0, 1, 1] = 10.0
    layer = kernel.convolution(weight, np.array([0.5]))
    ones = np.ones((1, 3, 4), np.float32)
    near = [[13.5, 15.5, 15.5, 13.5], [15.5, 18.5, 18.5, 15.5], [13.5, 15.5, 15.5, 13.5]]
    np.testing.assert_array_equal(convolve(ones, layer, 1), [near])
    far = [[13.5] * 4, [11.5] * 4, [13.5] * 4]
    np.testing.assert_array_equal(convolve(ones, layer, 2), [far])


def a_reading(rng, shape):
    board, curve = Circuit(*shape), PressureCurve()
    (force,) = scenes.sample("rects", 1, *shape, rng) if min(shape) > 8 else rng.random((1, *shape))
    return check_reading(forward(board, curve.resistance(force)), board, curve)


@pytest.mark.parametrize("shape", [(3, 2), (16, 16), (8, 24)])
def test_the_fixed_point_is_numpys(rng, monkeypatch, shape):
    reading = a_reading(rng, shape)
    first = fixed_point.first_guess(reading)
    for steps in (0, 1, 3, 12):
        g, taken = fixed_point.iterate(reading, first, steps, 1e-3)
        with monkeypatch.context() as patch:
            patch.setattr(kernel, "_kernel", None)
            plain, also = fixed_point.iterate(reading, first, steps, 1e-3)
        assert taken == also
        np.testing.assert_allclose(g, plain, rtol=1e-6)
    assert not np.array_equal(g, first)


def iterate_arguments(rng, steps: int, seconds: float, shape=(16, 16)):
    """Of a fixed point that never arrives."""
    g = conductance(rng, shape)
    n = g.size
    low, high = np.full(n, -20.0), np.zeros(n)
    measured = 2.0 * kernel.connected_rho(g).ravel()
    return (
        *shape,
        g,
        np.arange(n, dtype=np.int32),
        measured,
        low,
        high,
        1.0,
        0.0,
        0.0,
        steps,
        seconds,
    )


def test_the_deadline_holds_in_the_compiled_fixed_point(rng):
    assert COMPILED.iterate(*iterate_arguments(rng, 20, -1.0)) == 0
    assert COMPILED.iterate(*iterate_arguments(rng, 20, np.inf)) == 20
    since = time.monotonic()
    assert COMPILED.iterate(*iterate_arguments(rng, 10**6, 0.02)) < 10**5
    assert time.monotonic() - since < 1.0


def test_nan_does_not_become_a_bound(rng):
    """A measured NaN leaves its cell NaN, which then is no network; no cell is at its bound."""
    arguments = iterate_arguments(rng, 3, np.inf)
    arguments[4][7] = np.nan
    assert COMPILED.iterate(*arguments) == -1
    assert np.isnan(arguments[2].flat[7])


def test_long_work_lets_other_threads_run(rng):
    """A second of steps, while this thread counts."""
    started, taken = threading.Event(), []

    def work():
        arguments = iterate_arguments(rng, 10**6, 0.5)
        started.set()
        taken.append(COMPILED.iterate(*arguments))

    thread = threading.Thread(target=work)
    thread.start()
    started.wait(10.0)
    seen = 0
    while thread.is_alive():
        time.sleep(0.005)
        seen += 1
    assert taken[0] > 0 and seen > 5


G, I4, F4 = np.ones((2, 2)), np.zeros(1, np.int32), np.ones(4, np.float32)


@pytest.mark.parametrize(
    ("function", "arguments", "named"),
    [
        ("two_terminal", (2, 2, G), "4 arguments are due, got 3"),
        ("two_terminal", (40, 40, np.ones((40, 40)), np.ones((40, 40))), "1 to 64 lines"),
        ("two_terminal", (0, 2, np.ones((0, 2)), np.ones((0, 2))), "1 to 64 lines"),
        ("two_terminal", (2**62, 2**62, G, G), "1 to 64 lines"),
        ("two_terminal", (2, 2, np.ones(3), np.ones(4)), "argument 2: must have 4 items, has 3"),
        (
            "two_terminal",
            (2, 2, np.ones(4, int), np.ones(4)),
            "argument 2: must be an array of 'd'",
        ),
        ("two_terminal", ("2", 2, np.ones(4), np.ones(4)), "integer"),
        (
            "sensitivity",
            (2, 2, np.ones((4, 4)), G, I4 + 4, I4, I4, np.ones(1, "f")),
            "argument 4: 4 at 0: must be from 0 to 3",
        ),
        (
            "sensitivity",
            (2, 2, np.ones((4, 4)), G, I4, I4 - 1, I4, np.ones(1, "f")),
            "argument 5: -1 at 0: must be from 0 to 3",
        ),
        (
            "sensitivity",
            (2, 2, np.ones((4, 4)), G, I4, I4, I4 + 9, np.ones(1, "f")),
            "argument 6: 9 at 0: must be from 0 to 3",
        ),
        (
            "iterate",
            (2, 2, G.copy(), I4 + 4, *3 * [np.ones(1)], 1.0, 0.0, 0.0, 1, 1.0),
            "argument 3: 4 at 0: must be from 0 to 3",
        ),
        ("iterate", (1, 2), "12 arguments are due, got 2"),
        ("interpolate", (G, G, G, I4[:0], G.copy()), "two points or more"),
        ("interpolate", (G, G, G, I4, np.ones(3)), "argument 4: must have 4 items, has 3"),
        ("convolve", (2, 2, 0, 1, F4, F4, F4), "argument 2: 0: must be 1 to 4096"),
        (
            "convolve",
            (2, 3, 1, 1, F4, np.ones(10, np.float32), F4),
            "argument 4: must have 6 items",
        ),
        ("convolve", (2, 2, 1, 1, F4, F4, F4), "argument 5: must have 0 items, has 4"),
        (
            "convolve",
            (2, 2, 1, 1, F4, np.ones(20, np.float32), F4),
            "argument 6: must have 8 items, has 4",
        ),
    ],
)
def test_what_is_no_such_array_is_refused(function, arguments, named):
    with pytest.raises((TypeError, ValueError), match=named):
        getattr(COMPILED, function)(*arguments)


def test_a_table_of_senseless_starts_stays_inside_its_arrays():
    points, out = np.arange(3.0), np.empty(2)
    starts = np.array([2**30, -5], np.int32)
    COMPILED.interpolate(np.array([0.5, 1.5]), points, points, starts, out)
    np.testing.assert_allclose(out, [0.5, 1.5])


def test_what_cannot_be_written_is_refused():
    rho = np.ones((2, 2))
    rho.setflags(write=False)
    with pytest.raises(ValueError, match="read-only"):
        COMPILED.two_terminal(2, 2, np.ones((2, 2)), rho)
    with pytest.raises(ValueError, match="contiguous"):
        COMPILED.two_terminal(2, 2, np.ones((2, 4))[:, ::2], np.ones((2, 2)))


@pytest.mark.parametrize("family", ["blobs", "rects", "random"])
@pytest.mark.parametrize("method", ["newton", "map"])
def test_estimates_are_numpys(monkeypatch, family, method):
    board, curve = Circuit(), PressureCurve()
    rng = np.random.default_rng(7)
    for force in scenes.sample(family, 5, *board.shape, rng):
        adc = forward(board, curve.resistance(force))
        if method == "map":
            adc = np.rint(adc * 1023) / 1023
        found = compensate(adc, board, curve, method)
        with monkeypatch.context() as patch:
            patch.setattr(kernel, "_kernel", None)
            plain = compensate(adc, board, curve, method)
        assert found.status == plain.status
        # map stops at the noise, where rounding leaves more to choose from than for newton
        close = 1e-2 if method == "map" else 1e-6
        np.testing.assert_allclose(found.force, plain.force, rtol=close, atol=0.1 * close)
        # a cell that rounding keeps at rest, or not, has another spread
        assert np.median(np.abs(found.std - plain.std)) < 1e-5
