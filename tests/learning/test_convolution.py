# SPDX-License-Identifier: Apache-2.0
"""The convolution of the small networks, and the one behind the last step of `map`."""

import numpy as np
import pytest
from scipy.signal import correlate2d

from tactile_skin.learning import denoiser
from tactile_skin.learning.convolution import convolve, layer_of


@pytest.mark.parametrize("shape", [(1, 1), (5, 9), (16, 16), (3, 40)], ids=str)
@pytest.mark.parametrize(
    "channels, outputs, dilation", [(1, 1, 1), (5, 9, 3), (9, 2, 1), (16, 16, 2)]
)
def test_a_convolution_is_the_sum_of_its_channels(shape, channels, outputs, dilation):
    rng = np.random.default_rng(5)
    picture = rng.standard_normal((channels, *shape)).astype(np.float32)
    weight, bias = rng.standard_normal((outputs, channels, 3, 3)), rng.standard_normal(outputs)
    spread = np.zeros((outputs, channels, 2 * dilation + 1, 2 * dilation + 1))
    spread[:, :, ::dilation, ::dilation] = weight
    padded = np.pad(picture, ((0, 0), (dilation, dilation), (dilation, dilation)))
    expected = [
        b + sum(correlate2d(p, w, "valid") for p, w in zip(padded, own, strict=True))
        for own, b in zip(spread, bias, strict=True)
    ]
    layer = layer_of(weight, bias)
    found = convolve(picture, layer, dilation)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
    turned = picture[:, ::-1].transpose(0, 2, 1).copy().transpose(0, 2, 1)  # not in C's order
    np.testing.assert_array_equal(convolve(turned[:, ::-1], layer, dilation), found)


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
