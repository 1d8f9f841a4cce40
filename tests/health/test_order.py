# SPDX-License-Identifier: Apache-2.0
"""The order in which a skin's lines lie, by touches that cover neighbouring cells."""

import numpy as np
import pytest

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
    order, votes = reordered(touches(seed)[:, wired])
    assert order in (right := np.argsort(wired).tolist(), right[::-1])
    assert votes.share > 0.2


@pytest.mark.parametrize("seed", range(6))
def test_lines_in_order_and_one_exchange_are_no_other_order(seed):
    pictures, exchanged = touches(seed), np.arange(LINES)
    a, b = np.random.default_rng(seed).choice(LINES, 2, replace=False)
    exchanged[[a, b]] = b, a
    assert reordered(pictures) is None
    assert reordered(pictures[:, exchanged]) is None
