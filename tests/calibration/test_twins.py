# SPDX-License-Identifier: Apache-2.0
"""Two lines that are one are told at rest; lines of a sound fabric are not."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from support.marks import ci

from tactile_skin import Circuit, forward
from tactile_skin.calibration.at_rest import address_bits, equal_lines

NOISE = 0.06  # ADC steps, of the mean of a second
SHAPES = [(8, 8), (8, 16), (16, 16)]


def rest(rng, shape, scatter=0.03) -> np.ndarray:
    """What a skin reads at rest [ADC steps], but for noise."""
    circuit = Circuit(*shape)
    resistance = 40000.0 * np.exp(scatter * rng.standard_normal(shape))
    return forward(circuit, resistance) * circuit.full_scale


def read(rng, steps) -> np.ndarray:
    return steps + NOISE * rng.standard_normal(steps.shape)


@pytest.mark.parametrize("shape", [(8, 8), (16, 16)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_line_that_is_read_twice_is_named(shape, axis):
    rng, cells, right = np.random.default_rng(12), np.ones(shape, bool), 0
    for _ in range(40):
        steps = rest(rng, shape)
        lines = steps if axis == 0 else steps.T
        one, other = sorted(rng.choice(len(lines), 2, replace=False).tolist())
        lines[other] = lines[one]
        right += equal_lines(read(rng, steps), NOISE, cells) == [(axis, one, other)]
    assert right >= 34


def test_readings_in_whole_steps_are_alike_by_rounding():
    rng, cells = np.random.default_rng(13), np.ones((8, 8), bool)
    for _ in range(60):
        assert equal_lines(np.rint(rest(rng, (8, 8), 0.01)), NOISE, cells) == []


def test_cells_that_are_missing_do_not_count():
    rng, cells = np.random.default_rng(14), np.ones((8, 16), bool)
    steps = rest(rng, (8, 16))
    steps[5] = steps[2]
    cells[5, :3] = False
    steps[5, :3] = 0.0
    assert equal_lines(read(rng, steps), NOISE, cells) == [(0, 2, 5)]
    assert equal_lines(steps[:1], NOISE, cells[:1]) == []


@pytest.mark.parametrize("noise", [0.3, ci(1.0), ci(3.0)])
def test_lines_of_a_fabric_without_scatter_are_not_told_apart(noise):
    """Such a fabric is a simulated one. One chance in 10,000 a second is a warning in an hour."""
    rng = np.random.default_rng(12)
    steps, cells = np.full((16, 16), 262.0), np.ones((16, 16), bool)
    for _ in range(3000):
        read = steps + noise / 10.0 * rng.standard_normal((16, 16))
        assert equal_lines(read, noise / 10.0, cells) == []


def stuck(steps, cells):
    """The address bits of rows, and of columns, that are found to be stuck."""
    found = equal_lines(steps, NOISE, cells)
    of = [[(a, b) for at, a, b in found if at == axis] for axis in (0, 1)]
    return [address_bits(pairs, n) for pairs, n in zip(of, steps.shape, strict=True)]


ONE_BIT = [(shape, (bit,)) for shape in SHAPES for bit in range(3)]
TWO_BITS = [((16, 16), bits) for bits in ((0, 1), (0, 2), (1, 2))]  # three quarters are not read


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("shape", "bits"), [*ONE_BIT, *TWO_BITS])
def test_stuck_address_bits_are_named(shape, bits, axis):
    rng, cells, right = np.random.default_rng(15), np.ones(shape, bool), 0
    for _ in range(20):
        selected = np.arange(shape[axis]) & ~sum(1 << bit for bit in bits)
        steps = np.take(rest(rng, shape), selected, axis)
        right += stuck(read(rng, steps), cells)[axis] == list(bits)
    assert right >= 15


@pytest.mark.parametrize("shape", [(4, 4), *SHAPES, (3, 20)])
@pytest.mark.parametrize("smooth", [0.0, 1.5, 4.0])
def test_a_sound_fabric_has_none_however_smooth_it_is(shape, smooth):
    rng, circuit = np.random.default_rng(16), Circuit(*shape)
    for scatter in (0.003, 0.01, 0.03, 0.1):
        for _ in range(20):
            picture = rng.standard_normal(shape)
            picture = gaussian_filter(picture, smooth) if smooth else picture
            resistance = 40000.0 * np.exp(scatter * picture / picture.std())
            steps = forward(circuit, resistance) * circuit.full_scale
            assert stuck(read(rng, steps), circuit.populated) == [[], []]
