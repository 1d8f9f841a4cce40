# SPDX-License-Identifier: Apache-2.0
"""Frames of a living board are believed; frames that only look like it are not, and soon."""

import numpy as np
import pytest

from tactile_skin.board.frame import Frame
from tactile_skin.board.liveness import JITTER, Liveness

SHAPE = (8, 12)
RATE = 100.0  # frames a second
WRAP = 1 << 32  # us


class Source:
    """A board that sends noise about a picture, and what goes wrong with it.

    Attributes:
        t: arrival of the next frame [s].
        device: board's clock of the next frame [s].
    """

    def __init__(self, shape=SHAPE, rate=RATE, noise=1.0, text=False, whole=False, after=0.2):
        self.shape, self.period, self.noise, self.text, self.whole = (
            shape,
            1.0 / rate,
            noise,
            text,
            whole,
        )
        self.rng = np.random.default_rng(1)
        self.picture = self.rng.uniform(30.0, 60.0, shape)
        self.t, self.device, self.number = 50.0, 3.0, 7
        self.live = Liveness(shape, after)
        self.frozen = None

    def samples(self) -> np.ndarray:
        steps = self.picture + self.noise * self.rng.standard_normal(self.shape)
        steps = np.rint(steps) if self.whole else np.rint(steps * 64) / 64
        return np.rint(steps * 64).astype(np.uint16)

    def send(self, samples=None, lag=0.0, restarted=False):
        """The verdict on one more frame, which was `lag` on its way [s]."""
        us = None if self.text else round(self.device * 1e6) % WRAP
        frame = Frame(self.samples() if samples is None else samples, 10, self.number, us)
        verdict = self.live.frame(self.t + lag, frame, restarted)
        self.t, self.device = self.t + self.period, self.device + self.period
        self.number += 1
        return verdict

    def run(self, seconds, **kwargs):
        return [self.send(**kwargs) for _ in range(round(seconds / self.period))]


def until(verdicts, condition) -> int:
    """Number of frames up to the first verdict that meets the condition."""
    return next(n for n, v in enumerate(verdicts) if condition(v)) + 1


def troubled(verdict):
    return verdict.trouble != ""


@pytest.fixture(params=["binary", "text"])
def source(request):
    source = Source(text=request.param == "text")
    source.run(1.0)
    return source


def test_a_living_board_is_believed(source):
    verdicts = source.run(20.0)
    assert {v.trouble for v in verdicts} == {""}
    assert all(v.settled for v in verdicts)
    assert max(v.lag for v in verdicts) < 0.001


SHAPES = [(2, 2), (3, 3), (3, 4), (4, 4), (1, 8), (8, 12), (16, 16)]


@pytest.mark.parametrize(("shape", "noise"), [*((s, 0.3) for s in SHAPES), ((2, 2), 2.0)])
def test_whole_steps_with_little_noise_are_believed(shape, noise):
    source = Source(shape, noise=noise, text=True, whole=True)
    assert {v.trouble for v in source.run(60.0)} == {""}


def test_a_frozen_scan_is_told_within_a_fifth_of_a_second(source):
    frozen = source.samples()
    verdicts = source.run(1.0, samples=frozen)
    assert until(verdicts, troubled) / RATE <= 0.23
    assert "frozen" in verdicts[-1].trouble


@pytest.mark.parametrize("length", [2, 5, 20, 100])
def test_a_ring_of_frames_is_told(source, length):
    """As soon as a fifth of a second of it has come again."""
    ring = [source.samples() for _ in range(length)]
    verdicts = [source.send(samples=ring[k % length]) for k in range(5 * length + 30)]
    assert until(verdicts, troubled) <= length + 23
    assert f"the same {length} frames" in verdicts[-1].trouble


def test_a_ring_with_like_frames_in_it_is_told(source):
    a, b, c = (source.samples() for _ in range(3))
    verdicts = [source.send(samples=(a, b, a, c)[k % 4]) for k in range(60)]
    assert troubled(verdicts[-1])


def test_a_board_that_repeats_itself_by_its_filter_is_believed():
    """Two frames in three are like the one before: it is measured how often."""
    source = Source(text=True, whole=True)
    samples, seen = source.samples(), []
    for _ in range(20000):
        if source.rng.random() < 0.33:
            samples = source.samples()
        seen.append(troubled(source.send(samples=samples)))
    assert not any(seen)
    assert any(troubled(v) for v in source.run(2.1, samples=samples))


@pytest.mark.parametrize("rows", [[0], [3], [4, 5, 6, 7]])
def test_rows_that_never_move_are_told_by_name(source, rows):
    still = source.samples()
    for _ in range(200):
        now = source.samples()
        now[rows] = still[rows]
        verdict = source.send(samples=now)
    assert verdict.trouble.startswith(f"row {rows[0]}")
    assert "samples do not change" in verdict.trouble
    source.run(2.0)
    assert source.send().trouble == ""


@pytest.mark.parametrize("before", [0, 300])
@pytest.mark.parametrize("rows", [[0, 1], [1, 3]])
def test_half_of_a_small_skin_that_never_moves_is_told_in_time(before, rows):
    """Eight cells are enough to know that the others' standing still is no chance."""
    source = Source((4, 4))
    still = source.samples()

    def frozen():
        now = source.samples()
        now[rows] = still[rows]
        return source.send(samples=now)

    assert not any(source.send().trouble for _ in range(before))
    assert until((frozen() for _ in range(100)), troubled) <= 28


def test_readings_at_the_ends_of_the_scale_may_stand_still(source):
    """A board's threshold sends 0, an open input full scale: that is no frozen row."""
    for end in (0, 1023 << 6):
        for _ in range(200):
            now = source.samples()
            now[2] = end
            assert source.send(samples=now).trouble == ""


# --- the way ---


@pytest.mark.parametrize("late", [0.15, 0.5, 3.0])
def test_what_a_link_held_back_is_as_old_as_it_is(source, late):
    """All that piled up comes at once; the lag of each frame is what it waited."""
    n = round(late * RATE)
    lags = [source.send(lag=late - k / RATE).lag for k in range(n)]
    for k, lag in enumerate(lags):
        assert lag == pytest.approx(late - k / RATE, abs=0.03)
    assert source.run(0.5)[-1].lag < 0.02


@pytest.mark.parametrize("pace", [1.5, 2.0, 4.0, 50.0])
@pytest.mark.parametrize("late", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("held", [1e-4, 0.016])
def test_a_queue_of_text_is_as_old_as_it_is(pace, late, held):
    """It is emptied at any pace, by a link that delivers at once what came in `held` [s]."""
    source = Source(text=True)

    def arrival(t):
        return np.ceil(t / held) * held

    def send(t):  # the next frame comes at t
        return source.send(lag=arrival(t) - source.t).lag

    for _ in range(300):
        assert send(source.t) < 0.02
    begin = source.t
    out, seen = begin + late, []
    while out - source.t > 0.0:
        seen.append((out - source.t, send(out)))
        out += source.period / pace
    for true, lag in seen:
        assert lag > true - 0.05
    assert [send(source.t) for _ in range(50)][-1] < 0.02


def test_a_link_that_stalls_again_before_its_text_is_on_time_is_late():
    source = Source(text=True)
    source.run(2.0)
    source.t += 0.04
    source.run(0.1)  # nothing was queued, which is not known yet
    source.t += 1.0
    assert source.send().lag > 0.9


def test_text_frames_that_were_lost_and_not_queued_are_no_lag():
    source = Source(text=True)
    source.run(2.0)
    source.t += 1.0
    assert source.run(0.25)[-1].lag == 0.0


@pytest.mark.parametrize("pause", [0.0, 1.0])
@pytest.mark.parametrize("rate", [500.0, 200.0, 50.0, 25.0, 2.0])
def test_a_text_board_that_now_sends_at_another_rate_is_believed(rate, pause):
    source = Source(text=True)
    source.run(2.0)
    source.t += pause
    source.period = 1.0 / rate
    source.run(5.0)
    assert max(v.lag for v in source.run(5.0)) < 0.02


@pytest.mark.parametrize("held", [0.008, 0.016])
@pytest.mark.parametrize("rate", [100.0, 200.0, 500.0])
def test_text_that_a_converter_delivers_in_groups_is_on_time(rate, held):
    source = Source(text=True, rate=rate)
    source.t += 0.1 * held  # the first group is a full one
    lags = []
    for uneven in source.rng.normal(0.0, 0.02 / rate, round(10 * rate)):
        scanned = source.t + uneven
        lags.append(source.send(lag=np.ceil(scanned / held) * held - source.t).lag)
    assert max(lags) <= JITTER


@pytest.mark.parametrize("rate", [100.0, 30.0])
def test_text_frames_that_arrive_together_at_the_start_are_no_pace(rate):
    """A computer that is busy as it starts reads some at once."""
    source = Source(text=True, rate=rate)
    first = source.t + 8 * source.period
    for _ in range(8):
        source.send(lag=first - source.t)
    source.run(1.0)
    assert max(v.lag for v in source.run(5.0)) < 0.02


def test_a_link_that_goes_on_slowly_stays_late():
    """A queue that never empties: the frames come at their pace, and each is as old."""
    source = Source()
    source.run(1.0)
    verdicts = source.run(60.0, lag=0.5)
    assert min(v.lag for v in verdicts) > 0.45


def test_a_queue_at_the_start_is_not_settled():
    """Nothing was there before to compare with: a board's clock that runs ahead of ours gives it
    away."""
    source = Source()
    n = 200
    queued = [source.send(lag=(n - k) / RATE) for k in range(n)]
    assert not any(v.settled for v in queued)
    verdicts = source.run(1.0)
    assert until(verdicts, lambda v: v.settled) / RATE <= 0.25
    assert verdicts[-1].lag < 0.02


@pytest.mark.parametrize("skew", [-0.005, 0.005])
def test_a_ceramic_resonator_is_believed(skew):
    source = Source()
    for _ in range(6000):
        source.device += skew / RATE
        verdict = source.send()
    assert verdict.settled
    assert verdict.lag < 0.02


def test_a_link_that_jitters_is_believed():
    """A USB converter holds bytes for up to 16 ms."""
    source = Source()
    source.run(1.0)
    for _ in range(3000):
        verdict = source.send(lag=source.rng.uniform(0.0, 0.016))
        assert verdict.settled
        assert verdict.lag <= 0.02


@pytest.mark.parametrize("pace", [0.0, 0.5, 0.9])
def test_a_board_whose_clock_does_not_keep_up_is_late(pace):
    source = Source()
    source.run(1.0)
    lags = []
    for _ in range(300):
        source.device -= (1.0 - pace) / RATE
        lags.append(source.send().lag)
    assert lags[-1] > 0.2
    assert sorted(lags[10:]) == lags[10:]


def test_a_board_whose_clock_runs_too_fast_is_not_settled():
    source = Source()
    source.run(1.0)
    for _ in range(50):
        source.device += 1.0 / RATE
        verdict = source.send()
    assert not verdict.settled


def test_the_wrap_of_the_boards_clock_is_none_of_its_restarts():
    source = Source()
    source.device = WRAP / 1e6 - 1.0
    verdicts = source.run(3.0)
    assert {v.trouble for v in verdicts} == {""}
    assert all(v.settled for v in verdicts[25:])
    assert max(v.lag for v in verdicts) < 0.001


def test_one_restart_is_waited_out_and_three_are_trouble():
    source = Source()
    source.run(1.0)
    for restart in (1, 2, 3):
        source.device = 0.0
        verdicts = [source.send(restarted=True), *source.run(0.5)]
        assert not verdicts[0].settled
        assert troubled(verdicts[-1]) is (restart == 3)
    source.run(10.0)
    assert not troubled(source.send())


def test_a_clock_that_runs_backward_is_a_restart_in_each_frame():
    source = Source()
    source.run(1.0)
    for _ in range(10):
        source.device -= 2.0 / RATE
        verdict = source.send()
    assert "the board restarted" in verdict.trouble


def test_text_at_eight_frames_a_second_is_believed_and_its_freeze_told():
    source = Source(rate=8.0, text=True, whole=True)
    assert {v.trouble for v in source.run(60.0)} == {""}
    assert troubled(source.run(1.0, samples=source.samples())[-1])
