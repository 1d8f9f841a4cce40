# SPDX-License-Identifier: Apache-2.0
"""A finger that is drawn across the seam of two mats stays one touch."""

import pytest

from benchmarks.body import seam


def test_a_few_strokes_keep_their_id():
    found = seam.measure(strokes=6, seed=11)
    assert found["seam"]["one_id"] == found["one_mat"]["one_id"] == 1.0


@pytest.mark.slow
def test_200_strokes_keep_their_id_and_the_velocity_that_one_mat_gives():
    """The velocity of a small, slow finger is off by more than the limit on one mat as well."""
    found = seam.measure(strokes=200, seed=3800)
    seams, one_mat = found["seam"], found["one_mat"]
    error = (one_mat["kept"] * (1.0 - one_mat["kept"]) / found["strokes"]) ** 0.5
    assert seams["one_id"] >= seam.SHARE
    assert seams["kept"] >= one_mat["kept"] - 2.0 * error
