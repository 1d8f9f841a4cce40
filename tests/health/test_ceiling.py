# SPDX-License-Identifier: Apache-2.0
"""A ceiling of the ADC is seen, whatever the board's noise; a flat touch is none."""

import numpy as np
import pytest
from health.seen import Samples, said
from support.marks import ci

from tactile_skin import Circuit
from tactile_skin.health.ceiling import Ceiling
from tactile_skin.physics.adc import Adc

BITS, FRACTION = 10, 64
ADC = Adc(Circuit(8, 8, adc_bits=BITS))
REST = 41.0  # ADC steps


class Board:
    """Readings of 8 x 8 cells: rest, and a touch on a block of them."""

    def __init__(self, noise=1.0, whole=False, ceiling=np.inf):
        self.rng = np.random.default_rng(2)
        self.noise, self.whole, self.ceiling = noise, whole, ceiling
        self.picture = REST + self.rng.uniform(-3.0, 3.0, (8, 8))
        self.watch = Ceiling(ADC)
        self.windows = Samples(self.watch, BITS)

    def steps(self, touch=0.0, cells=np.s_[2:4, 2:4]) -> np.ndarray:
        steps = self.picture.copy()
        steps[cells] += touch
        noise = self.noise * self.rng.standard_normal(steps.shape)
        return np.minimum(steps + noise, self.ceiling)

    def frame(self, *args) -> str:
        steps = self.steps(*args)
        steps = np.rint(steps) if self.whole else np.rint(steps * FRACTION) / FRACTION
        return self.look(np.rint(steps * FRACTION).astype(np.uint16))

    def look(self, samples) -> str:
        return self.windows.frame(samples)

    def frames(self, n, *args):
        return [self.frame(*args) for _ in range(n)]


@pytest.mark.parametrize("noise", [0.3, ci(1.0), 2.0])
@pytest.mark.parametrize("whole", [False, True])
def test_a_sound_board_has_no_ceiling(noise, whole):
    board = Board(noise, whole)
    for touch in np.random.default_rng(3).uniform(50.0, 700.0, 100):
        assert not any(board.frames(40, touch))
        assert not any(board.frames(40))


@pytest.mark.parametrize(("cells", "before"), [(np.s_[2:4, 2:4], 200), (np.s_[5:6, 5:6], 3000)])
def test_readings_that_stand_at_one_height_are_told_soon(cells, before):
    """Of a press on one cell, too, once it is known that others do not stand still by chance."""
    board = Board(ceiling=614.0)
    board.frames(before)
    said = board.frames(40, 800.0, cells)
    assert 8 <= next(k for k, text in enumerate(said) if text) <= 12
    assert said[-1].startswith("readings end at 614 ADC steps")
    assert all(board.frames(500)), "the ceiling is there when nothing touches it, too"


@pytest.mark.parametrize("side", [3, 8])
@pytest.mark.parametrize("noise", [0.2, ci(0.3), ci(0.4), ci(0.5), 0.6])
def test_one_hard_press_that_stands_for_long_is_no_ceiling(side, noise):
    """Halfway between two steps of the ADC noise moves a reading, in the middle of one it hardly
    does; a small matrix has few others that show how much."""
    rng = np.random.default_rng(68)
    for _ in range(6):
        rest = REST + rng.uniform(0.0, 2.0, (side, side))
        rest[1, 1] = 600.0 + rng.uniform(0.0, 1.0)
        watch = Samples(Ceiling(Adc(Circuit(side, side, adc_bits=BITS))), BITS)
        for _ in range(1500):
            steps = np.rint(rest + noise * rng.standard_normal(rest.shape))
            assert not watch.frame(steps.astype(np.uint16) * FRACTION)


def test_it_is_over_once_something_reads_higher():
    board = Board(ceiling=614.0)
    board.frames(200)
    board.frames(40, 800.0)
    board.ceiling = np.inf
    assert not any(board.frames(40, 700.0)[1:])


def test_equal_readings_of_a_quiet_board_are_no_ceiling():
    """Whole steps with hardly any noise: most readings stand still, and some at one height."""
    board = Board(noise=0.05, whole=True)
    board.picture = np.rint(board.picture)
    for touch in (100.0, 300.0, 500.0):
        assert not any(board.frames(100, touch))


def test_rest_is_no_ceiling():
    board = Board(noise=0.0)
    assert not any(board.frames(1000))


def test_a_ceiling_is_forgotten_unless_the_last_frame_shows_it():
    board = Board(ceiling=614.0)
    board.frames(200)
    board.frames(40, 800.0)
    board.watch.forget()
    assert said(board.watch).startswith("readings end at 614 ADC steps")
    assert all(board.frames(20))
    board.watch.forget()
    assert said(board.watch) == ""
    assert not any(board.frames(100))


class Clipped(Board):
    """Clips before the ADC, which adds its own noise: no reading stands still."""

    def frame(self, touch=0.0, cells=np.s_[2:5, 2:5]):
        steps = self.picture.copy()
        steps[cells] += touch * self.texture[cells]
        steps = np.minimum(steps, self.ceiling)
        steps += self.noise * self.rng.standard_normal(steps.shape)
        samples = np.where(self.dead, 0, np.rint(steps * FRACTION)).astype(np.uint16)
        return self.windows.frame(samples)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.dead = False
        self.texture = np.exp(0.1 * self.rng.standard_normal((8, 8)))


@pytest.mark.parametrize("before", [0.0, 700.0])
@pytest.mark.parametrize("unread", [False, True])
def test_a_ceiling_with_noise_is_told_at_the_second_touch(unread, before):
    """Crossings that are not read hide it not: they stand still at 0, without noise."""
    board = Clipped(noise=0.5)
    board.dead = np.zeros((8, 8), bool)
    board.dead[:, 6:] = unread
    board.frames(200)
    assert not any(board.frames(50, before))
    board.ceiling = 614.0
    assert not any(board.frames(50, 800.0))
    board.frames(100)
    assert board.frames(50, 750.0, np.s_[4:8, 2:6])[-1].startswith("readings end at 61")


def test_noise_above_a_ceiling_does_not_end_it():
    """A broad push that stands for seconds at the ceiling is let go otherwise."""
    board = Clipped(noise=0.5, ceiling=614.0)
    board.frames(200)
    board.frames(50, 800.0)
    board.frames(100)
    board.frames(50, 750.0, np.s_[4:8, 4:8])
    assert all(board.frames(2000, 800.0))
    board.ceiling = 700.0
    assert "" in board.frames(20, 800.0), "it was none"


def test_hard_touches_of_a_sound_board_have_none():
    board = Clipped(noise=0.5)
    for touch in np.random.default_rng(3).uniform(300.0, 700.0, 200):
        row, col = board.rng.integers(0, 5, 2)
        assert not any(board.frames(20, touch, np.s_[row : row + 3, col : col + 3]))
        assert not any(board.frames(10))


@pytest.mark.parametrize("harder", [0.0, 650.0])
def test_palms_that_tremble_at_one_height_are_no_ceiling(harder):
    """All readings tremble with them, which is no noise: so many stand together in its width."""
    board, said = Clipped(noise=0.3), []
    board.texture[...] = np.exp(0.01 * board.rng.standard_normal((8, 8)))
    still = board.picture
    board.frames(200)
    if harder:
        said += board.frames(40, harder, np.s_[0:1, 0:1])
    for beside in (0.0, 350.0):
        for _ in range(60):
            board.picture = still + 6.0 * board.rng.standard_normal()
            board.picture[1::4] += beside
            said.append(board.frame(400.0))
        board.picture = still
        said += board.frames(40)
    assert not any(said)


def test_a_flat_touch_that_comes_again_is_no_ceiling():
    """Four cells alike, twice at one height, and another touch elsewhere the second time."""
    board = Clipped(noise=0.5)
    board.texture[2:4, 2:4] = 1.0
    board.picture[2:4, 2:4] = REST
    board.frames(200)
    said = []
    for elsewhere in (0.0, 300.0):
        board.picture[6, 6] = REST + elsewhere
        said += board.frames(50, 640.0, np.s_[2:4, 2:4])
        said += board.frames(50)
    assert not any(said)


class Turned(Board):
    """Readings that fall with pressure, as the compensation node hands them on."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.adc = Adc(Circuit(8, 8, adc_bits=BITS), inverted=True)
        self.windows = Samples(Ceiling(self.adc), BITS)

    def frame(self, *args) -> str:
        sent = np.clip(np.rint(1023.0 - self.steps(*args)), 0, 1023) * FRACTION
        return self.look(self.adc.rising(sent.astype(np.uint16)))


def test_an_inverted_board_at_rest_is_no_ceiling_though_it_reads_the_most():
    board = Turned(noise=1.0)
    board.picture[:] = 0.0  # at the very end of the range: half of the noise is cut off
    for touch in (50.0, 300.0, 700.0):
        assert not any(board.frames(40, touch))
        assert not any(board.frames(40))


def test_the_ceiling_of_an_inverted_board_is_named_as_it_prints_it():
    board = Turned(ceiling=614.0)
    board.frames(200)
    assert board.frames(40, 800.0)[-1].startswith("readings end at 409 ADC steps")
