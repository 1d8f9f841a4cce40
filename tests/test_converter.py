"""A ceiling of the ADC is seen, whatever the board's noise; a flat touch is none."""

import numpy as np
import pytest

from tactile_skin.converter import Ceiling

BITS, FRACTION = 10, 64
REST = 41.0  # ADC steps


class Board:
    """Readings of 8 x 8 cells: rest, and a touch on a block of them."""

    def __init__(self, noise=1.0, whole=False, ceiling=np.inf):
        self.rng = np.random.default_rng(2)
        self.noise, self.whole, self.ceiling = noise, whole, ceiling
        self.picture = REST + self.rng.uniform(-3.0, 3.0, (8, 8))
        self.watch = Ceiling(BITS)

    def frame(self, touch=0.0, cells=np.s_[2:4, 2:4]) -> str:
        steps = self.picture.copy()
        steps[cells] += touch
        steps = np.minimum(steps + self.noise * self.rng.standard_normal(steps.shape), self.ceiling)
        steps = np.rint(steps) if self.whole else np.rint(steps * FRACTION) / FRACTION
        return self.watch.frame(np.rint(steps * FRACTION).astype(np.uint16))

    def frames(self, n, *args):
        return [self.frame(*args) for _ in range(n)]


@pytest.mark.parametrize("noise", [0.3, 1.0, 2.0])
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
    assert board.watch.forget().startswith("readings end at 614 ADC steps")
    assert all(board.frames(20))
    assert board.watch.forget() == ""
    assert not any(board.frames(100))
