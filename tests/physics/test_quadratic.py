# SPDX-License-Identifier: Apache-2.0
"""The quadratic programme of a step."""

import numpy as np
import pytest

from tactile_skin.physics import quadratic


def definite(rng, n: int) -> np.ndarray:
    a = rng.normal(size=(n, n + 3))
    return (a @ a.T / n + 0.1 * np.eye(n)).astype(np.float32)


@pytest.mark.parametrize("n", [1, 2, 5, 17, 60, 130])
def test_a_step_is_the_minimum_within_its_box(n):
    """The gradient vanishes inside and points outwards on the ends (Karush, Kuhn and Tucker)."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        s, b = definite(rng, n), 3.0 * rng.normal(size=n)
        low, high = -rng.exponential(1.0, n), rng.exponential(1.0, n)
        dx, solved, inside = quadratic.solve_in_box(np.triu(s), b, low, high)
        assert solved and ((dx >= low) & (dx <= high)).all()
        found, there = quadratic.inverse(np.triu(s), inside), s[np.ix_(inside, inside)]
        np.testing.assert_allclose(np.triu(found), np.triu(np.linalg.inv(there)), 1e-3, 1e-3)
        pull = b - s @ dx
        assert (pull[dx > low] > -1e-3).all()
        assert (pull[dx < high] < 1e-3).all()


def test_a_few_on_their_ends_need_no_other_factor(monkeypatch):
    s, calls, factor = definite(np.random.default_rng(8), 60), [], quadratic.factor_over
    low = np.where(np.arange(60) % 6, -9.0, -1e-3)
    monkeypatch.setattr(quadratic.compiled, "library", None)
    monkeypatch.setattr(quadratic, "factor_over", lambda *a: calls.append(a) or factor(*a))
    dx, _, inside = quadratic.solve_in_box(np.triu(s), np.full(60, -0.1), low, -low)
    assert len(calls) == 1 and (~inside).sum() >= 5 and ((-0.1 - s @ dx)[dx > low] > -1e-4).all()


def test_a_step_without_a_factor():
    s, b = np.array([[1.0, 2.0], [2.0, 1.0]], np.float32), np.ones(2)
    ends = np.full(2, -9.0), np.full(2, 9.0)
    assert quadratic.solve_in_box(s, b, *ends)[1]  # definite with a ridge
    dx, solved, _ = quadratic.solve_in_box(-np.eye(2, dtype=np.float32), b, *ends)
    assert not solved and not dx.any()


def test_a_step_beyond_numbers_is_no_step():
    """Neither the compiled steps nor LAPACK's put it on the end of its box."""
    ends = np.full(2, -9.0), np.full(2, 9.0)
    dx, _, _ = quadratic.solve_in_box(np.eye(2, dtype=np.float32), np.array([np.nan, 1.0]), *ends)
    assert not np.isfinite(dx).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (3, 2), (16, 16)], ids=str)
def test_roughness_by_hand_and_by_differences(shape):
    rng, (rows, cols) = np.random.default_rng(5), shape
    x, square = rng.standard_normal(shape), 0.09
    weight = rng.integers(0, 3, rows * (cols - 1) + (rows - 1) * cols) * 0.7
    cost, gradient, diagonal, entries = quadratic.roughness(x, weight, square)
    pairs = [((i, j), (i, j + 1)) for i in range(rows) for j in range(cols - 1)]
    pairs += [((i, j), (i + 1, j)) for i in range(rows - 1) for j in range(cols)]
    curvature = [w / (square + (x[a] - x[b]) ** 2) for w, (a, b) in zip(weight, pairs, strict=True)]
    logs = [np.log(square + (x[a] - x[b]) ** 2) for a, b in pairs]
    assert cost == pytest.approx(0.5 * np.dot(weight, logs))
    assert entries == pytest.approx(-np.array(curvature))
    expected = np.zeros(shape)
    for c, (a, b) in zip(curvature, pairs, strict=True):
        expected[a] += c
        expected[b] += c
    assert diagonal == pytest.approx(expected)
    for cell in np.ndindex(shape):
        step = np.zeros(shape)
        step[cell] = 1e-6
        more, less = (quadratic.roughness(x + s, weight, square)[0] for s in (step, -step))
        assert gradient[cell] == pytest.approx((more - less) / 2e-6, abs=1e-6)
