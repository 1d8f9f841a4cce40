# SPDX-License-Identifier: Apache-2.0
"""A cell that jumps about, never moves, or is often set aside is named; touches are not."""

import numpy as np
import pytest
from health.seen import said, seen

from tactile_skin import Circuit
from tactile_skin.health.odd_cells import OddCells
from tactile_skin.physics.adc import Adc

SHAPE, FRAME = (8, 8), 0.01  # s
AT = 2, 5


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def tremor(rng, n, size=0.03):
    """(n,) a hand's force over its mean."""
    slow = np.convolve(rng.standard_normal(n + 30), np.ones(12) / 12**0.5, "same")[15 : n + 15]
    return 1.0 + size * slow


def finger(rng, n, width, newtons=4.0, at=(3.3, 4.1)):
    row, col = np.indices(SHAPE)
    picture = np.exp(-((row - at[0]) ** 2 + (col - at[1]) ** 2) / (2 * width**2))
    rise = np.minimum(np.arange(n) / 8.0, 1.0)
    return newtons * picture * (rise * tremor(rng, n))[:, None, None]


def odd_cells():
    return OddCells(Adc(Circuit(*SHAPE)))


def watch(frames, cells=None, start=0.0):
    cells, texts = cells or odd_cells(), []
    for k, frame in enumerate(frames):
        cells.frame(seen(start + k * FRAME, force=frame))
        texts.append(said(cells))
    return texts


def one_cell(force):
    frames = np.zeros((len(force), *SHAPE))
    frames[:, AT[0], AT[1]] = force
    return frames


@pytest.mark.parametrize("width", [0.3, 0.6, 1.5])
def test_a_finger_is_not_odd(rng, width):
    """However long it presses, and on a single cell, too."""
    for _ in range(5):
        assert not any(watch(finger(rng, 1000, width)))


def test_taps_are_not_odd(rng):
    """Ten taps of a finger, five a second, each with a rise and a fall of 40 ms."""
    tap = np.interp(np.arange(20), [0, 4, 10, 14, 20], [0, 1, 1, 0, 0])
    assert not any(watch(one_cell(np.tile(5.0 * tap, 10))))


def test_a_cell_that_jumps_is_named_within_a_second(rng):
    said = watch(one_cell(3.0 * np.exp(0.4 * rng.standard_normal(100))))
    assert said[-1].startswith(f"row {AT[0]}, column {AT[1]}: jumps between high and low force")


def test_it_is_named_beside_a_finger_too(rng):
    frames = finger(rng, 100, 0.6, at=(6.0, 1.0))
    frames[:, AT[0], AT[1]] += 3.0 * np.exp(0.4 * rng.standard_normal(100))
    assert f"row {AT[0]}, column {AT[1]}" in watch(frames)[-1]


def test_it_is_over_once_the_cell_is_calm(rng):
    cells = odd_cells()
    watch(one_cell(3.0 * np.exp(0.4 * rng.standard_normal(100))), cells)
    assert watch(np.zeros((300, *SHAPE)), cells, 1.0)[-1] == ""


def test_a_cell_that_stands_still_alone_is_named(rng):
    said = watch(one_cell(5.0 * (1.0 + 0.01 * rng.standard_normal(300))))
    first = next(k for k, text in enumerate(said) if text)
    assert first == pytest.approx(100, abs=6)
    assert said[-1].startswith(f"row {AT[0]}, column {AT[1]}: alone has read a constant ")


def test_what_moves_within_a_twentieth_of_a_second_stands_still():
    """Its mean of five frames does; that of four or six does not."""
    cells, pattern = odd_cells(), 5.0 * (1.0 + 0.1 * np.array([1.0, 1.0, -1.0, -1.0, 0.0]))
    for k, force in enumerate(np.tile(pattern, 40)):
        cells.frame(seen(1.05 * k * FRAME, force=one_cell([force])[0]))
    assert "alone has read a constant" in said(cells)


@pytest.mark.parametrize(("share", "odd"), [(0.12, False), (0.18, True)])
def test_to_and_fro_by_more_than_a_hand_trembles_is_a_jump(share, odd):
    """Of the larger force: what a hand loses from one frame to the next is less."""
    found = watch(one_cell(5.0 * np.tile([1.0, 1.0 - share], 50)))
    assert ("jumps" in found[-1]) == odd


@pytest.mark.parametrize(("frames", "odd"), [(6, False), (4, True)])
def test_no_finger_drums_more_than_twenty_times_a_second(frames, odd):
    found = watch(one_cell(np.tile(np.repeat([5.0, 0.0], frames), 40)))
    assert any("jumps" in text for text in found) == odd


@pytest.mark.parametrize(("share", "odd"), [(0.017, True), (0.023, False)])
def test_what_moves_by_more_than_noise_does_not_stand_still(share, odd):
    found = watch(one_cell(5.0 * np.tile(np.repeat([1.0, 1.0 + share], 30), 5)))
    assert any("alone has read a constant" in text for text in found) == odd


@pytest.mark.parametrize(("newtons", "odd"), [(0.13, False), (0.17, True)])
def test_less_than_a_touch_is_no_odd_cell(newtons, odd):
    assert bool(watch(one_cell(np.tile([newtons, 0.0], 50)))[-1]) == odd
    assert bool(watch(one_cell(np.full(150, newtons)))[-1]) == odd


@pytest.mark.parametrize(("share", "odd"), [(0.22, True), (0.38, False)])
def test_what_its_neighbours_share_is_a_touch(share, odd):
    """Both what jumps and what stands still."""
    jumps, stands = one_cell(np.tile([5.0, 1.0], 50)), one_cell(np.full(150, 5.0))
    for frames in (jumps, stands):
        frames[:, AT[0] + 1, AT[1]] = share * frames[:, AT[0], AT[1]]
        assert bool(watch(frames)[-1]) == odd


@pytest.mark.parametrize(("share", "odd"), [(0.88, True), (0.8, False)])
def test_it_is_let_go_once_its_force_is_another(share, odd):
    cells = odd_cells()
    assert watch(one_cell(np.full(150, 5.0)), cells)[-1]
    assert bool(watch(one_cell(np.full(10, 5.0 * share)), cells, 1.5)[-1]) == odd


def test_it_stays_named_when_something_touches_beside_it(rng):
    cells, frames = odd_cells(), one_cell(np.full(150, 5.0))
    assert watch(frames, cells)[-1]
    touched = frames + finger(rng, 150, 0.8, at=(2.0, 4.0))
    touched[:, AT[0], AT[1]] = 5.2
    assert all(watch(touched, cells, 1.5))
    assert not watch(one_cell(np.full(10, 2.0)), cells, 3.0)[-1], "it was an object that is lifted"


def test_an_object_on_several_cells_is_not(rng):
    frames = np.zeros((500, *SHAPE))
    frames[:, 2:4, 2:4] = 2.0
    assert not any(watch(frames))


def test_a_gap_in_time_begins_anew(rng):
    cells = odd_cells()
    frames = one_cell(np.full(80, 5.0))
    assert not any(watch(frames, cells))
    assert not any(watch(frames, cells, 100.0))


# --- readings that are set aside ---


def set_aside(cells, frames, start=0.0):
    """Whether a contact is named after frames in which these cells are set aside (None: none)."""
    for k, at in enumerate(frames):
        aside = np.zeros(SHAPE, bool)
        if at is not None:
            aside[at] = True
        cells.frame(seen(start + k * FRAME, force=np.zeros(SHAPE), aside=aside))
    return said(cells)


def test_a_reading_that_is_set_aside_in_half_of_the_frames_is_named_soon():
    cells = odd_cells()
    assert set_aside(cells, [AT, None] * 25).startswith(f"row {AT[0]}, column {AT[1]}: reads less")
    assert not set_aside(cells, [None] * 3000, 0.5), "it is over"


def test_one_of_a_few_frames_is_named_in_time():
    cells = odd_cells()
    assert not set_aside(cells, [AT, *[None] * 24] * 4)
    assert set_aside(cells, [AT, *[None] * 24] * 20, 1.0)


@pytest.mark.parametrize(("frames", "bad"), [(80, False), (57, True)])
def test_three_times_in_two_seconds_for_long_is_a_bad_contact(frames, bad):
    assert bool(set_aside(odd_cells(), [AT, *[None] * (frames - 1)] * (6000 // frames))) == bad


def test_what_a_touch_sets_aside_as_it_comes_is_not():
    cells = odd_cells()
    for col in range(8):  # each touch elsewhere
        assert not set_aside(cells, [(2, col)] * 6 + [None] * 94, float(col))


def test_several_at_once_are_not_added_up():
    assert not set_aside(odd_cells(), [(k % 8, k % 7) for k in range(100)])
