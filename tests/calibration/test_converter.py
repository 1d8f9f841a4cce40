"""A ceiling of the ADC is seen, whatever the board's noise; a flat touch is none."""

import numpy as np
import pytest

from tactile_skin import Circuit
from tactile_skin.calibration.watch.converter import Ceiling, RestPicture, Windows
from tactile_skin.physics.adc import Adc

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


@pytest.mark.parametrize("noise", [0.6, 1.0])
def test_one_reading_is_told_by_how_long_it_stands_where_noise_moves_all_others(noise):
    board = Board(noise, whole=True, ceiling=614.0)
    board.frames(300)
    said = board.frames(80, 800.0, np.s_[5:6, 5:6])
    assert 25 <= next(k for k, text in enumerate(said) if text) <= 75


@pytest.mark.parametrize("side", [3, 8])
@pytest.mark.parametrize("noise", [0.2, 0.3, 0.4, 0.5, 0.6])
def test_one_hard_press_that_stands_for_long_is_no_ceiling(side, noise):
    """Halfway between two steps of the ADC noise moves a reading, in the middle of one it hardly
    does; a small matrix has few others that show how much."""
    rng = np.random.default_rng(68)
    for _ in range(6):
        rest = REST + rng.uniform(0.0, 2.0, (side, side))
        rest[1, 1] = 600.0 + rng.uniform(0.0, 1.0)
        watch = Ceiling(BITS)
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
    assert board.watch.forget().startswith("readings end at 614 ADC steps")
    assert all(board.frames(20))
    assert board.watch.forget() == ""
    assert not any(board.frames(100))


class Clipped(Board):
    """Clips before the ADC, which adds its own noise: no reading stands still."""

    def frame(self, touch=0.0, cells=np.s_[2:5, 2:5]):
        steps = self.picture.copy()
        steps[cells] += touch * self.texture[cells]
        steps = np.minimum(steps, self.ceiling)
        steps += self.noise * self.rng.standard_normal(steps.shape)
        samples = np.rint(steps * FRACTION).astype(np.uint16)
        said = self.watch.frame(samples)
        window = self.windows.frame(samples)
        return said if window is None else self.watch.window(window)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.windows = Windows(BITS)
        self.texture = np.exp(0.1 * self.rng.standard_normal((8, 8)))


def test_a_ceiling_with_noise_is_told_at_the_second_touch():
    board = Clipped(noise=0.5, ceiling=614.0)
    board.frames(200)
    assert not any(board.frames(50, 800.0))
    board.frames(100)
    assert board.frames(50, 750.0, np.s_[4:8, 4:8])[-1].startswith("readings end at 61")


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
        self.watch = Ceiling(BITS, self.adc.rising_count(0.85), self.adc.circuit.full_scale)

    def frame(self, touch=0.0, cells=np.s_[2:4, 2:4]) -> str:
        steps = self.picture.copy()
        steps[cells] += touch
        steps = np.minimum(steps + self.noise * self.rng.standard_normal(steps.shape), self.ceiling)
        sent = np.clip(np.rint(1023.0 - steps), 0, 1023) * FRACTION
        return self.watch.frame(self.adc.rising(sent.astype(np.uint16)))


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


def test_what_a_short_circuit_reads_is_counted_with_the_offset():
    """Hard touches all read alike near it: no ceiling. With offset and another full scale, too."""
    adc = Adc(Circuit(8, 8, adc_bits=12), offset=176.2, full_scale=2703.0)
    assert adc.rising_count(0.845) == pytest.approx(0.845 * 2703.0 - 176.2)


def test_crossings_that_are_not_read_hide_no_ceiling():
    """They stand still at 0, without the noise that all others have."""
    board = Clipped(noise=0.5, ceiling=614.0)
    inner = board.watch.frame
    dead = np.zeros((8, 8), bool)
    dead[:, 6:] = True
    frame = board.windows.frame
    board.watch.frame = lambda samples: inner(np.where(dead, 0, samples))
    board.windows.frame = lambda samples: frame(np.where(dead, 0, samples))
    board.frames(200)
    board.frames(50, 800.0)
    board.frames(100)
    assert board.frames(50, 750.0, np.s_[4:8, 2:6])[-1].startswith("readings end at 61")


# --- a matrix that is not read ---


def windows_of(picture, noise, n=200):
    """What is said in each window of n frames of a picture [ADC steps]."""
    rng, windows, watch = np.random.default_rng(4), Windows(BITS), RestPicture()
    rest = REST + np.random.default_rng(3).uniform(-3.0, 3.0, (4, 4))
    said = []
    for k in range(n):
        steps = np.broadcast_to(picture(rest, k), rest.shape) + noise * rng.standard_normal((4, 4))
        window = windows.frame(np.rint(steps * FRACTION).astype(np.uint16))
        if window is not None:
            said.append(watch.window(window, rest))
    return said


@pytest.mark.parametrize("level", [REST, REST + 7.0, 300.0])
def test_one_voltage_is_told_at_whatever_height(level):
    said = windows_of(lambda rest, k: rest if k < 100 else level, 1.0)
    assert not any(said[:10]) and all("one voltage" in text for text in said[10:])


@pytest.mark.parametrize("bit", [6, 8, 9])
def test_a_bit_that_is_stuck_lifts_the_picture_as_it_is(bit):
    said = windows_of(lambda rest, k: rest + (k >= 100) * 2**bit, 0.5)
    assert not any(said[:10])
    assert all(text.startswith(f"all cells read {2**bit} ADC steps above") for text in said[10:])


@pytest.mark.parametrize("share", [1.1, 1.25])
def test_a_fabric_that_warms_up_lifts_it_by_less(share):
    assert not any(windows_of(lambda rest, k: rest * share, 0.5))


@pytest.mark.parametrize("noise", [0.3, 1.0, 2.0])
def test_a_skin_is_no_one_voltage_at_rest_or_under_an_even_load(noise):
    uneven = np.random.default_rng(5).normal(1.0, 0.05, (4, 4))
    assert not any(windows_of(lambda rest, k: rest + 0.3 * k * uneven, noise, 2000))


def test_a_skin_that_rests_all_alike_cannot_be_told_from_one_voltage():
    window = Windows(BITS)
    for _ in range(10):
        found = window.frame(np.full((4, 4), 41 * FRACTION, np.uint16))
    assert RestPicture().window(found, np.full((4, 4), 41.0)) == ""


def quiet_windows(scatter, seed, dead, noise=2.0, n=400):
    """The same of 4 x 4 cells that rest about as far apart [ADC steps] as one reading's noise."""
    rng, windows, watch = np.random.default_rng(seed), Windows(BITS), RestPicture()
    rest = 92.0 + scatter * rng.standard_normal((4, 4))
    measured = rest + noise / 40**0.5 * rng.standard_normal((4, 4))
    said = []
    for k in range(n):
        touch = 200.0 * (np.arange(16).reshape(4, 4) == k // 60 % 16) * (k % 60 > 30)
        steps = 85.0 if dead and k >= n // 2 else rest + touch
        steps = steps + noise * rng.standard_normal((4, 4))
        window = windows.frame(np.rint(np.rint(steps) * FRACTION).astype(np.uint16))
        if window is not None:
            said.append(watch.window(window, measured))
    return said


@pytest.mark.parametrize("seed", range(20))
def test_on_a_small_skin_one_voltage_is_told_past_the_noise(seed):
    """Within a second; of a noisy board a single window does not tell it for good."""
    said = quiet_windows(1.8, seed, dead=True)
    assert not any(said[:20])
    assert all("one voltage" in text for text in said[30:])


@pytest.mark.parametrize("seed", range(20))
def test_a_sound_small_skin_is_believed_whatever_its_noise(seed):
    for scatter in (0.9, 1.8, 4.0):
        assert not any(quiet_windows(scatter, seed, dead=False))
