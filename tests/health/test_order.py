# SPDX-License-Identifier: Apache-2.0
"""The order in which a skin's lines lie, by touches that cover neighbouring cells."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_skin import Circuit
from tactile_skin.health.doctor import order
from tactile_skin.health.doctor.order import reordered

LINES, ACROSS = 12, 7


def touches(seed):
    """(24, LINES, ACROSS) pictures of blobs, as the search for an order takes them."""
    rng = np.random.default_rng(seed)
    y, x = np.indices((LINES, ACROSS))
    at, width = rng.uniform(0, (LINES - 1, ACROSS - 1), (24, 2)), rng.uniform(0.6, 2.5, 24)
    square = [(y - a) ** 2 + (x - b) ** 2 for a, b in at]
    blobs = np.exp(-np.array(square) / (4.0 * width[:, None, None] ** 2))
    blobs *= rng.lognormal(0.0, 0.1, blobs.shape)
    return blobs / blobs.sum((1, 2), keepdims=True)


@pytest.mark.parametrize(
    "wired",
    [[*range(1, 12, 2), *range(10, -1, -2)], [*range(0, 12, 2), *range(1, 12, 2)], "any"],
    ids=["interleaved", "zigzag", "any"],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_is_found_or_its_mirror(wired, seed):
    wired = np.random.default_rng(seed).permutation(LINES) if wired == "any" else wired
    found, votes = reordered(touches(seed)[:, wired])
    assert found in (right := np.argsort(wired).tolist(), right[::-1])
    assert votes.share > 0.2


@pytest.mark.parametrize("seed", range(6))
def test_lines_in_order_and_one_exchange_are_no_other_order(seed):
    pictures, exchanged = touches(seed), np.arange(LINES)
    a, b = np.random.default_rng(seed).choice(LINES, 2, replace=False)
    exchanged[[a, b]] = b, a
    assert reordered(pictures) is None
    assert reordered(pictures[:, exchanged]) is None


def test_rows_and_columns_may_both_be_in_another_order(monkeypatch):
    """Each is named, and none is where a line of theirs is faulty: it is entered with all."""
    rng = np.random.default_rng(3)
    rows, cols = rng.permutation(LINES), rng.permutation(ACROSS)
    pictures = touches(3)[:, rows][:, :, cols]
    monkeypatch.setattr(order, "_pictures", lambda seen: pictures)
    seen = SimpleNamespace(
        circuit=Circuit(LINES, ACROSS), turned=lambda axis, of: of.swapaxes(1, 2) if axis else of
    )
    found = order.misplaced(seen, set())
    assert {bool(f.rows): f.detail for f in found}.keys() == {True, False}
    assert all(f.form == "order" for f in found)
    assert all(not f.rows or f.form != "order" for f in order.misplaced(seen, {(0, 2)}))
