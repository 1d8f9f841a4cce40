# SPDX-License-Identifier: Apache-2.0
"""A finger that is drawn across the seam of two mats stays one touch."""

from benchmarks.body import seam


def test_a_few_strokes_keep_their_id():
    found = seam.measure(strokes=6, seed=11)
    assert found["seam"]["one_id"] == found["one_mat"]["one_id"] == 1.0
