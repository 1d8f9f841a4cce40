# SPDX-License-Identifier: Apache-2.0
"""The compiled loops against the same in NumPy, and what they leave to that.

That both are right is what the other tests of physics and solvers say, which run over each.
"""

from __future__ import annotations

import _ctypes
import ctypes
import importlib.machinery
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from support.implementations import COMPILED

from tactile_skin.physics import compiled, kernel, laplacian, quadratic, readouts
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.solvers import prior
from tactile_skin.solvers.newton import maximise
from tactile_skin.solvers.reading import Linearised, check_reading

pytestmark = pytest.mark.skipif(COMPILED is None, reason="no compiler was found at installation")
SIZES = [(1, 1), (1, 5), (5, 1), (3, 2), (16, 16), (8, 24), (24, 8), (32, 32), (63, 1)]


@pytest.fixture(autouse=True)
def implementation():
    """Once, not over both: these tests compare the two."""


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def problem(rng, shape) -> dict:
    """Arguments of a fixed point from one skin to another, of most of the cells."""
    true, first = np.exp(rng.normal(-8.0, 1.0, (2, *shape)))
    cells = np.flatnonzero(rng.random(shape) < 0.9).astype(np.int32)
    low, high = np.full(cells.size, -10.0), np.full(cells.size, -5.0)
    measured = laplacian.connected_rho(true).ravel()[cells]
    arrays = {"g": first, "cells": cells, "measured": measured, "low": low, "high": high}
    return arrays | {"r_ref": 1780.0, "r_par": 326.0, "goal": 1e-20}


def in_numpy(monkeypatch, **given):
    with monkeypatch.context() as patch:
        patch.setattr(compiled, "library", None)
        return kernel.fixed_point(**given)


def test_the_implementation_is_named(monkeypatch):
    assert compiled.implementation() == "compiled"
    monkeypatch.setattr(compiled, "library", None)
    assert compiled.implementation() == "in NumPy"


def test_what_was_compiled_from_other_sources_is_not_used(tmp_path):
    others = []
    for source in compiled.SOURCES:
        others.append(tmp_path / source.name)
        others[-1].write_bytes(source.read_bytes())
    assert compiled._load(others) is not None
    others[0].write_text("int other;")
    with pytest.warns(UserWarning, match="compiled from other sources and are not used"):
        assert compiled._load(others) is None


@pytest.mark.parametrize("damage", ["empty", "text", "foreign"])
def test_a_library_that_cannot_be_loaded_is_named_and_not_used(tmp_path, monkeypatch, damage):
    foreign = Path(_ctypes.__file__).read_bytes()
    path = tmp_path / f"{damage}.so"
    path.write_bytes({"empty": b"", "text": b"no object file", "foreign": foreign}[damage])
    found = importlib.machinery.ModuleSpec("_loops", None, origin=str(path))
    monkeypatch.setattr(compiled, "find_spec", lambda name: found)
    with pytest.warns(UserWarning, match=f"cannot be loaded .*{damage}.so.* are not used"):
        assert compiled._load(compiled.SOURCES) is None


@pytest.mark.parametrize("shape", SIZES, ids=str)
def test_the_fixed_point_is_numpys(rng, monkeypatch, shape):
    given = problem(rng, shape)
    before = given["g"].copy()
    for steps in (0, 1, 3, 12):
        g, taken = kernel.fixed_point(**given, steps=steps)
        plain, also = in_numpy(monkeypatch, **given, steps=steps)
        assert taken == also
        np.testing.assert_allclose(g, plain, rtol=1e-6)
    np.testing.assert_array_equal(given["g"], before)
    turned = given | {"g": given["g"].T.copy().T}  # not in C's order
    np.testing.assert_array_equal(kernel.fixed_point(**turned, steps=12)[0], g)


def test_it_stops_where_it_has_arrived(rng, monkeypatch):
    given = problem(rng, (16, 16)) | {"goal": 1e-6, "steps": 60}
    given |= {"low": given["low"] - 10.0, "high": given["high"] + 5.0}
    g, taken = kernel.fixed_point(**given)
    plain, also = in_numpy(monkeypatch, **given)
    assert 0 < taken == also < 60
    np.testing.assert_allclose(g, plain, rtol=1e-6)


@pytest.mark.parametrize("form", [kernel.fixed_point, None], ids=["compiled", "in NumPy"])
def test_it_does_not_begin_behind_its_deadline(rng, monkeypatch, form):
    given = problem(rng, (16, 16)) | {"steps": 20, "deadline": time.monotonic() - 1.0}
    g, taken = form(**given) if form else in_numpy(monkeypatch, **given)
    assert taken == 0
    np.testing.assert_array_equal(g, given["g"])


def test_a_network_that_is_singular_to_rounding_is_left_to_numpy(rng, monkeypatch):
    """Conductances 20 decades apart: the inverse fails, the eigenvalues do not."""
    given = problem(rng, (4, 4)) | {"steps": 1}
    g = np.full((4, 4), 1e-14)
    g[:2, :2] = g[2:, 2:] = 1e6
    found, taken = kernel.fixed_point(**given | {"g": g})
    plain, _ = in_numpy(monkeypatch, **given | {"g": g})
    assert taken == 1 and (laplacian.connected_rho(g) > 0).all()
    np.testing.assert_array_equal(found, plain)


def test_nan_does_not_become_a_bound(rng):
    """A measured NaN leaves its cell NaN, which then is no network; no cell is at its bound."""
    given = problem(rng, (4, 4))
    given["measured"][7] = np.nan
    g, n = given["g"].copy(), given["cells"].size
    rest = given["measured"], given["low"], given["high"], 1780.0, 326.0, 0.0, 3
    assert COMPILED.fixed_point(4, 4, g, n, given["cells"], *rest) == -1
    assert np.isnan(g.flat[given["cells"][7]])


def test_long_work_lets_other_threads_run(rng):
    """A second of steps, while this thread counts."""
    given = problem(rng, (32, 32)) | {"steps": 10_000}
    thread = threading.Thread(target=kernel.fixed_point, kwargs=given)
    thread.start()
    seen = 0
    while thread.is_alive():
        time.sleep(0.005)
        seen += 1
    assert seen > 5


def test_what_is_no_such_array_is_refused(rng):
    given = problem(rng, (4, 4)) | {"steps": 3}
    with pytest.raises(ValueError, match="a resistance and two bounds for each cell"):
        kernel.fixed_point(**given | {"low": given["low"][1:]})
    for name in ("measured", "cells"):
        with pytest.raises(ctypes.ArgumentError, match="must be of"):
            kernel.fixed_point(**given | {name: given[name].astype(np.float32)})
    for cell in (-1, 16):
        outside = given["cells"].copy()
        outside[0] = cell
        rest = given["measured"], given["low"], given["high"], 1780.0, 326.0, 0.0, 3
        assert COMPILED.fixed_point(4, 4, given["g"].copy(), outside.size, outside, *rest) == -1


def both(monkeypatch, function):
    """What it returns compiled, and in NumPy."""
    found = function()
    with monkeypatch.context() as patch:
        patch.setattr(compiled, "library", None)
        return found, function()


@pytest.mark.parametrize("shape", SIZES, ids=str)
def test_the_network_is_numpys(rng, monkeypatch, shape):
    g = np.exp(rng.normal(-8.0, 1.0, shape))
    found, plain = both(monkeypatch, lambda: laplacian.solve(g))
    for one, other in zip(found, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
    found, plain = both(monkeypatch, lambda: laplacian.connected_rho(g))
    np.testing.assert_allclose(found, plain, rtol=1e-9)


def test_arrays_of_any_order_are_read(rng):
    """Of Fortran's order, read-only, or of every other cell."""
    g = np.exp(rng.normal(-8.0, 1.0, (6, 8)))
    expected = laplacian.connected_rho(g)
    fixed, wide = g.copy(), np.repeat(g, 2, axis=1)
    fixed.setflags(write=False)
    for same in (np.asfortranarray(g), fixed, wide[:, ::2]):
        np.testing.assert_array_equal(laplacian.connected_rho(same), expected)


@pytest.mark.parametrize("shape", SIZES, ids=str)
def test_a_point_of_a_fit_is_numpys(rng, monkeypatch, shape):
    cells = np.ones(shape, bool)
    cells[0, 0] = min(shape) < 2  # else one is missing
    circuit, curve = Circuit(*shape, mask=cells), PressureCurve()
    curve = curve.resting_at(curve.rest_resistance * rng.uniform(0.8, 1.2, shape))
    adc = np.where(rng.random(shape) < 0.1, np.nan, rng.random(shape))
    reading = check_reading(adc, circuit, curve, noise=2.0, missing=True, threshold=0.2)
    g = cells / curve.resistance(rng.random(shape) * (rng.random(shape) < 0.5))
    found, plain = both(monkeypatch, lambda: vars(prior.Point(reading, g, False)))
    names = "cost", "gx", "x", "own", "pull", "slope", "alone"
    pictures = (
        [*p["model"][2:], *p["prior"], *(p[name] for name in names)] for p in (found, plain)
    )
    for one, other in zip(*pictures, strict=True):
        np.testing.assert_allclose(
            one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max(initial=1e-9)
        )
    between, plain = prior.differences(circuit), plain["prior"]
    free = np.flatnonzero(rng.random(shape) < 0.6)
    jacobian = rng.standard_normal((g.size, free.size)).astype(np.float32)
    for terms in (plain, plain._replace(entries=None)):
        one, other = both(
            monkeypatch,
            lambda terms=terms: prior.precision(jacobian.T @ jacobian, terms, between, free),
        )
        np.testing.assert_allclose(np.triu(one), np.triu(other), rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("wide", [0.02, 0.3, 10.0])
def test_the_programme_within_bounds_is_lapacks(rng, monkeypatch, wide):
    for n in (1, 7, 40, 100, 201):
        root = rng.standard_normal((2 * n, n))
        precision = np.triu(root.T @ root + np.eye(n)).astype(np.float32)
        b = rng.standard_normal(n) * n
        low, high = -wide * rng.random(n), wide * rng.random(n)
        found, plain = both(
            monkeypatch, lambda given=(precision, b, low, high): quadratic.solve_in_box(*given)
        )
        np.testing.assert_allclose(found[0], plain[0], rtol=1e-3, atol=1e-4)
        np.testing.assert_array_equal(found[2], plain[2])
        inverses = both(monkeypatch, lambda a=precision, on=found[2]: quadratic.inverse(a, on))
        np.testing.assert_allclose(*map(np.triu, inverses), rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("shape", SIZES, ids=str)
@pytest.mark.parametrize("share", [0.1, 0.9])
def test_the_normal_equations_are_numpys(rng, monkeypatch, shape, share):
    circuit = Circuit(*shape)
    cells, given = np.flatnonzero(rng.random(shape) < share), rng.random(shape) < 0.8
    g = np.full(shape, 1e-4)
    g.flat[cells] *= np.exp(rng.normal(2.0, 1.0, cells.size))
    network = readouts.solve(circuit, g)
    model = Linearised(g, network, network.adc, 0.0 * g, 1e3 * rng.random(shape) * given)
    found, plain = both(monkeypatch, lambda: model.information(cells, g))
    np.testing.assert_allclose(
        np.triu(found), np.triu(plain), rtol=1e-4, atol=1e-5 * plain.max(initial=0.0)
    )


@pytest.mark.parametrize("shape", SIZES[1:7], ids=str)
def test_the_exact_inverse_is_numpys(rng, monkeypatch, shape):
    circuit, curve = Circuit(*shape), PressureCurve()
    force = 9.0 * rng.random(shape) * (rng.random(shape) < 0.5)
    reading = check_reading(forward(circuit, curve.resistance(force)), circuit, curve, noise=0.0)
    found, plain = both(monkeypatch, lambda: maximise(reading, reading.bounds[0]))
    np.testing.assert_allclose(np.append(*found[:2]), np.append(*plain[:2]), rtol=1e-6)  # g, steps
