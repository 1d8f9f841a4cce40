# SPDX-License-Identifier: Apache-2.0
"""The network behind the last step of `map`: the same numbers as PyTorch's, on any skin."""

import numpy as np
import pytest

from tactile_skin.learning import denoiser


@pytest.mark.parametrize("off", [-0.5, 0.5])
def test_a_cell_is_expected_to_be_like_its_neighbours(off):
    """In the midst of a flat patch, where the fit knows it less than the others."""
    every = np.ones((16, 16), bool)
    unknown = np.zeros((16, 16), bool)
    unknown[3:12, 3:12] = True
    x, std = np.where(unknown, 5.0, 0.0), np.where(unknown, 0.1, 0.05)
    x[7, 7], std[7, 7] = 5.0 + off, 0.3
    mean, wide = denoiser.shipped()(x, std, np.full((16, 16), 2.0), unknown, every)
    assert abs(mean[7, 7] - 5.0) < 0.4
    assert wide[7, 7] < 0.3
