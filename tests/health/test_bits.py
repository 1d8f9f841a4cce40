# SPDX-License-Identifier: Apache-2.0
"""A bit of the ADC that fails in use, or was wrong from the start; and boards of which none is."""

import numpy as np
import pytest
from health.seen import Samples, seen
from support.marks import slow

from tactile_skin import Circuit
from tactile_skin.health.bits import Bits
from tactile_skin.health.check import Windows
from tactile_skin.physics.adc import Adc

BITS = 10
REST = 41.0 + np.random.default_rng(3).uniform(-8.0, 8.0, (8, 8))  # ADC steps


def played(frames, stuck, *, inverted=False, scale=1, seed=4, bits=BITS):
    """What is said after each frame [ADC steps] of samples that `stuck` changes."""
    adc, rng = Adc(Circuit(8, 8, adc_bits=bits), inverted=inverted), np.random.default_rng(seed)
    watch, said = Samples(Bits(adc), bits), []
    rest = scale * REST / adc.full_scale
    for k, steps in enumerate(frames):
        counts = scale * np.rint(np.clip(steps + 0.5 * rng.standard_normal((8, 8)), 0, 1023))
        counts = stuck(counts.astype(int), k)
        said.append(watch.frame((counts << 16 - bits).astype(np.uint16), rest))
    return said


def touches(n, seed=1, most=900.0):
    """Frames of palms that stand for 0.2 s each, with as much rest."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        palm = rng.uniform(0.0, most) * rng.uniform(0.1, 1.0, (8, 8))
        yield from [REST] * 20
        yield from [REST + palm] * 20


@pytest.mark.parametrize("bit", [4, 6, 8, 9])
def test_a_bit_that_fails_high_is_named_and_kept_under_touches(bit):
    said = played(touches(10), lambda c, k: c | (k >= 100) << bit)
    assert not any(said[:100])
    assert all(text.startswith(f"ADC bit {bit}: always 1") for text in said[130:])


def test_it_is_over_once_the_rest_reads_as_before():
    said = played([REST] * 300, lambda c, k: c | (100 <= k < 200) << 7)
    assert said[199] and not said[-1]


@pytest.mark.parametrize(("bit", "kept"), [(5, 0), (6, 0), (7, 0), (8, 0), (6, 1), (7, 1)])
def test_a_bit_that_is_wrong_from_the_start_is_named_by_its_gaps(bit, kept):
    def stuck(counts, k):
        return counts | 1 << bit if kept else counts & ~(1 << bit)

    watch = [text for text in played(touches(60), stuck) if text]
    assert watch and f"ADC bit {bit}: always {kept}" in watch[-1]


@pytest.mark.parametrize(("scale", "bits"), [(1, 10), slow(4, 12), (16, 14)])
@pytest.mark.parametrize("most", [slow(60.0), 300.0, slow(900.0)])
def test_sound_boards_have_none_also_where_a_sketch_scales_them(scale, bits, most):
    for seed in (1, 2, 3):
        frames = touches(60, seed, most)
        assert not any(played(frames, lambda c, k: c, scale=scale, bits=bits, seed=seed))


@pytest.mark.parametrize("share", [1.1, 1.25, 2.0])
def test_a_fabric_that_warms_up_has_none(share):
    assert not any(played([REST * share] * 100, lambda c, k: c))


def test_where_readings_fall_the_bit_is_that_of_what_the_board_sends():
    said = played(touches(10), lambda c, k: c | (k >= 100) << 6, inverted=True)
    assert said[-1].startswith("ADC bit 6: always 0")


@pytest.mark.parametrize("recovers", [True, False])
def test_cells_that_rest_lower_by_a_bit_after_a_touch_are_none(recovers):
    """By a third, as Velostat does."""
    adc, windows, rng = Adc(Circuit(8, 8)), Windows(BITS), np.random.default_rng(4)
    check, rest = Bits(adc), 208.0 + 0.4 * (REST - 41.0)
    for _ in range(40):
        counts = np.uint16(np.rint(rest - 64.0 + 0.5 * rng.standard_normal((8, 8)))) << 6
        frame = seen(samples=counts, rest=rest / adc.full_scale, window=windows.frame(counts))
        check.frame(frame._replace(recovers=recovers))
    assert (check.found is None) is recovers
