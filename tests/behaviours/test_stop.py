# SPDX-License-Identifier: Apache-2.0
"""The robot stops for a push and for whatever it does not know, and goes on only when free."""

import dataclasses
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_skin.behaviours.stop import Cause, Stop, StopConfig, StopPolicy, because

CONFIG = StopConfig(threshold=10.0, release=6.0, debounce=0.02, lead=0.0)


def feed(policy, start, seconds, force, rate=100):
    """Readings of one force at 100 a second; the last decision."""
    decision = None
    for k in range(round(seconds * rate)):
        decision = policy.reading(start + k / rate, force)
    return decision


def pushed(decision):
    """Whether it stops for a push, and nothing else."""
    return decision.stop and decision.causes == (Cause.PUSH,)


def test_before_the_first_reading_it_stops():
    decision = StopPolicy(CONFIG).decide(0.0)
    assert decision.stop and decision.reason == "stale: no reading yet"


def test_a_push_stops_after_the_debounce_and_not_before():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    decisions = [policy.reading(0.5 + k / 100, 12.0) for k in range(4)]
    assert [d.stop for d in decisions] == [False, False, True, True]
    assert decisions[2].reason == "push: 12 N, limit 10 N"


def test_a_single_spike_is_no_push():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 0.0)
    for k in range(10, 110):
        assert not policy.reading(k / 100, 50.0 if k % 10 == 0 else 0.0).stop


def test_without_debounce_one_reading_is_enough():
    policy = StopPolicy(StopConfig(threshold=10.0, release=6.0, debounce=0.0))
    feed(policy, 0.0, 0.1, 0.0)
    assert pushed(policy.reading(0.1, 10.0))


def test_hysteresis_keeps_the_stop_between_the_thresholds():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 12.0)
    assert feed(policy, 0.1, 2.0, 8.0).stop
    assert feed(policy, 2.1, 0.25, 5.0).stop, "held after the release"
    assert not feed(policy, 2.35, 0.2, 5.0).stop


def test_readings_that_stay_away_stop():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    assert not policy.decide(0.58).stop
    assert policy.decide(0.60)[:2] == (True, "stale: readings no longer arrive")
    assert policy.reading(0.7, 0.0)[:2] == (True, "stale: readings have only just resumed")
    assert feed(policy, 0.71, 0.02, 0.0).stop
    assert not policy.reading(0.73, 0.0).stop


def test_a_push_is_not_forgotten_while_readings_stay_away():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 20.0)
    said = "push: 20 N, limit 10 N + stale: readings no longer arrive"
    assert policy.decide(5.0).reason == said
    assert feed(policy, 5.0, 0.02, 0.0).stop
    assert not feed(policy, 5.02, 0.05, 0.0).stop


def test_a_burst_after_a_gap_frees_nothing():
    """What lay in a port's buffer while the computer hung is parsed, and stamped, in a moment."""
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(10):
        assert policy.reading(5.0 + k * 1e-4, 0.0).stop
    assert policy.reading(5.01, 0.0).stop
    assert not policy.reading(5.021, 0.0).stop


def test_a_push_after_a_gap_counts_at_once():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 0.0)
    assert policy.reading(1.0, 20.0).reason.startswith("push")


def test_readings_at_a_ninth_of_the_rate_still_stop_for_a_push():
    policy = StopPolicy(CONFIG)
    for k in range(20):
        assert "push" in policy.reading(k / 9, 100.0).reason
        assert policy.decide(k / 9 + 0.05).stop


def test_old_readings_and_repeated_ones_do_not_keep_the_robot_moving():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(50):
        late = policy.reading(0.5 + k / 100, 0.0, stamp=0.5 + k / 100 - 0.2)
    assert late[:2] == (True, "stale: readings are already old when they arrive")
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(50):
        repeated = policy.reading(0.5 + k / 100, 0.0, stamp=0.49)
    assert repeated[:2] == (True, "stale: readings are already old when they arrive")


def test_a_clock_that_is_set_back_stops_and_begins_anew():
    """By an hour, as when a robot's time is set: not free for an hour on a reading of the past."""
    policy = StopPolicy(StopConfig())
    feed(policy, 5000.0, 1.0, 0.0)
    assert not policy.decide(5001.0).stop
    assert policy.decide(1400.0)[:2] == (True, "stale: readings no longer arrive")
    assert policy.reading(1400.01, 0.0)[:2] == (True, "stale: readings have only just resumed")
    feed(policy, 1400.02, 0.1, 0.0)
    assert not policy.decide(1400.12).stop
    feed(policy, 1400.13, 0.1, 40.0)
    assert pushed(policy.decide(1400.23))


def test_a_clock_that_is_set_back_ends_no_push():
    """A hand that has let go a little, but not below the release, is still there."""
    policy = StopPolicy(CONFIG)
    feed(policy, 5000.0, 0.1, 12.0)
    assert pushed(feed(policy, 1400.0, 1.0, 8.0))
    assert feed(policy, 1401.0, 0.28, 0.0).stop
    assert not feed(policy, 1401.28, 0.05, 0.0).stop


def test_a_reading_that_proves_nothing_takes_back_no_invalid_one():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    policy.reading(0.5, float("nan"))
    assert policy.reading(0.505, 0.0, stamp=0.49).reason.startswith("fault: reading")
    assert policy.reading(0.505, 0.0, stamp=3600.0).reason.startswith("fault: reading")
    assert not policy.reading(0.51, 0.0).stop


def test_a_stamp_from_the_future_proves_nothing():
    policy = StopPolicy(CONFIG)
    for k in range(100):
        decision = policy.reading(k / 100, 0.0, stamp=3600.0 + k / 100)
    assert decision.reason == "stale: no reading yet"


@pytest.mark.parametrize("force", [float("nan"), float("inf"), -1.0])
def test_a_force_that_cannot_be_stops_until_it_can(force):
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    assert policy.reading(0.5, force).reason.startswith("fault: reading")
    assert not policy.reading(0.51, 0.0).stop


def test_a_hard_edge_on_one_cell_is_a_push():
    """Three cells at the end of the curve hold 29 N, whatever lies on them."""
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(3):
        decision = policy.reading(0.5 + k / 100, 9.5, peak=9.5)
    assert pushed(decision)


def test_without_a_hold_a_hard_edge_and_a_rise_stop_for_as_long_as_they_last():
    """A cell's peak, and a force that will soon exceed the threshold, lie below the release."""
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0, hold=0.0, lead=0.01))
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(3):
        assert pushed(policy.reading(0.5 + k / 100, 9.5, peak=9.5))
    assert not policy.reading(0.53, 0.0).stop
    assert pushed(policy.reading(0.54, 16.0))
    assert not policy.reading(0.55, 16.0).stop


@pytest.mark.parametrize("limit", [{"threshold": 25.0}, {"peak": 4.0}])
def test_a_limit_that_is_lowered_below_what_was_read_stops_at_once(limit):
    policy = StopPolicy(StopConfig())
    for k in range(200):
        decision = policy.reading(k / 100, 28.0, 5.0)
    assert not decision.stop
    policy.configure(dataclasses.replace(StopConfig(), **limit))
    assert policy.decide(2.0).for_push_alone


def test_limits_by_which_no_push_would_end_are_refused():
    with pytest.raises(ValueError, match=r"release = 6\.0"):
        StopConfig(threshold=5.0, release=6.0)


# --- lead ---

LEADING = StopConfig(threshold=10.0, release=6.0, lead=0.01)


def rising(forces, config=LEADING, dt=0.01):
    """Decisions on readings of these forces, after half a second of nothing."""
    policy = StopPolicy(config)
    feed(policy, 0.0, 0.5, 0.0)
    return [policy.reading(0.49 + (k + 1) * dt, force).stop for k, force in enumerate(forces)]


def test_a_force_that_will_soon_exceed_the_threshold_counts():
    assert rising([3.0, 6.4, 9.9]) == [False, False, True]
    assert rising([3.0, 6.6, 9.9]) == [False, True, True]


def test_a_force_that_rises_slowly_or_falls_counts_as_it_is():
    assert not any(rising([k / 10 for k in range(99)]))
    assert not any(rising([4.9, 7.4, 5.0, 7.4, 0.0]))


def test_no_reading_counts_more_than_twice():
    """Also one of a burst, a millisecond after the last."""
    assert rising([4.9], dt=0.001) == [False]
    assert rising([5.1], dt=0.001) == [True]


def test_the_first_reading_after_a_gap_says_nothing_of_how_fast_it_rose():
    policy = StopPolicy(LEADING)
    feed(policy, 0.0, 0.5, 0.0)
    assert "push" not in policy.reading(1.0, 9.0).reason


# --- latch ---

LATCHING = dataclasses.replace(CONFIG, latch=True)


def free(config=LATCHING, until=0.5):
    """A policy that has been free; its readings end at `until` [s]."""
    policy = StopPolicy(config)
    assert not feed(policy, 0.0, until, 0.0).stop
    return policy


def test_a_latched_push_lasts_until_the_reset():
    policy = free()
    assert (
        feed(policy, 0.5, 0.1, 20.0).reason
        == "push: 20 N, limit 10 N + latched: push: 20 N, limit 10 N"
    )
    assert feed(policy, 0.6, 5.0, 0.0)[:2] == (True, "latched: push: 20 N, limit 10 N")
    assert policy.reset(5.6) == ""
    assert not policy.decide(5.6).stop
    assert not feed(policy, 5.6, 1.0, 0.0).stop


def test_a_reset_is_refused_while_the_cause_lasts_and_says_why():
    """Also during the hold after a release; it is not kept for later."""
    policy = free()
    feed(policy, 0.5, 0.1, 20.0)
    assert policy.reset(0.6).startswith("push")
    feed(policy, 0.6, 0.2, 0.0)
    assert policy.reset(0.8).startswith("push"), "held"
    assert feed(policy, 0.8, 1.0, 0.0)[:2] == (True, "latched: push: 20 N, limit 10 N")
    policy.fault("compensation", "open line")
    assert policy.reset(1.8) == "fault: compensation: open line"
    policy.fault("compensation", "")
    assert policy.reset(2.5) == "stale: readings no longer arrive"
    assert policy.decide(2.5).reason == (
        "stale: readings no longer arrive + latched: push: 20 N, limit 10 N"
    )


def test_a_latched_stop_names_its_first_cause():
    policy = free()
    policy.fault("compensation", "open line")
    feed(policy, 0.5, 0.5, 20.0)
    policy.fault("compensation", "")
    assert feed(policy, 1.0, 1.0, 0.0).reason == "latched: fault: compensation: open line"


def test_a_stream_that_came_back_stays_stopped_when_latched():
    policy = free()
    policy.decide(0.7)
    assert feed(policy, 0.8, 1.0, 0.0)[:2] == (True, "latched: stale: readings no longer arrive")


def test_a_fault_shorter_than_the_timer_latches_too():
    policy = free()
    policy.fault("serial_driver", "unplugged")
    policy.fault("serial_driver", "")
    assert policy.reading(0.5, 0.0)[:2] == (True, "latched: fault: serial_driver: unplugged")


def test_what_stops_a_robot_before_it_was_free_does_not_latch_but_a_push_does():
    policy = StopPolicy(LATCHING)
    policy.decide(0.0)
    policy.fault("serial_driver", "not there yet")
    policy.decide(0.1)
    policy.fault("serial_driver", "")
    assert not feed(policy, 0.2, 0.5, 0.0).stop
    policy = StopPolicy(LATCHING)
    feed(policy, 0.0, 0.5, 20.0)
    assert feed(policy, 0.5, 1.0, 0.0)[:2] == (True, "latched: push: 20 N, limit 10 N")


def test_what_is_waited_for_does_not_latch():
    """Rest may still be measured after a moment in which all was well; another cause latches."""
    policy = free()
    policy.fault("compensation", "measuring rest", waiting=True)
    assert policy.decide(0.5).reason == "waiting: compensation: measuring rest"
    policy.fault("compensation", "")
    assert not feed(policy, 0.5, 0.6, 0.0).stop
    policy.fault("compensation", "measuring rest", waiting=True)
    waiting = "waiting: compensation: measuring rest"
    assert policy.decide(
        0.8
    ).reason == f"{waiting} + stale: readings no longer arrive + latched: " + (
        "stale: readings no longer arrive"
    )


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 0.3), st.sampled_from([0.0, 8.0, 20.0]), st.booleans(), st.booleans()
        ),
        max_size=60,
    )
)
def test_no_latched_stop_ends_without_a_reset_that_was_granted(steps):
    """Whatever readings, gaps and faults come: stop to free only right after a reset."""
    policy, t, stopped = free(), 0.5, False
    for dt, force, faulty, reset in steps:
        t += dt
        policy.fault("stage", "bad" if faulty else "")
        now = policy.reading(t, force).stop
        assert now or not stopped
        stopped = now
        if reset:
            granted = policy.reset(t) == ""
            stopped = policy.decide(t).stop
            assert stopped is not granted


# --- how often readings come ---

FIXED = dataclasses.replace(CONFIG, stale_after=0.1)


def reasons_of(policy, rate, seconds, start=0.0, jitter=0.0):
    """Readings at a rate, and a decision every 20 ms, as the node's heartbeat has it; each new
    decision: (t, stop, reason)."""
    rng, said, period = random.Random(1), [], 1.0 / rate
    times = [(start + k / 50, None) for k in range(round(seconds * 50))]
    times += [
        (start + k * period + jitter * period * rng.random(), 0.0)
        for k in range(round(seconds * rate))
    ]
    for t, force in sorted(times, key=lambda pair: pair[0]):
        decision = policy.decide(t) if force is None else policy.reading(t, force)
        if not said or said[-1][1:] != decision[:2]:
            said.append((t, *decision[:2]))
    return said


@pytest.mark.parametrize("jitter", [0.0, 0.15])
@pytest.mark.parametrize(("rate", "interval", "advice"), [(8, "0.1", "0."), (5, "0.2", "0.")])
def test_a_board_that_is_too_slow_is_told_once_with_its_interval(rate, interval, advice, jitter):
    """It was told 255 times in 15 s, naming neither the parameter nor the rate."""
    said = reasons_of(StopPolicy(FIXED), rate, 15.0, jitter=jitter)
    assert len(said) <= 6
    assert all(stop for _, stop, _ in said)
    reason = said[-1][2]
    assert reason.startswith(f"stale: readings come every {interval}")
    assert "s, but stale_after = 0.1 s: set stop_on_push.stale_after: " + advice in reason
    assert said[-1][0] < 1.0


def test_a_stream_that_slows_down_is_told_too_and_stops_at_once():
    policy = StopPolicy(FIXED)
    reasons_of(policy, 100, 2.0)
    said = reasons_of(policy, 8, 10.0, start=2.0)
    assert said[-1][2].startswith("stale: readings come every 0.12 s, but stale_after = 0.1 s")
    assert said[1][1] and said[1][0] <= 2.0 + 0.12 + 0.02
    assert len(said) <= 8


def test_readings_in_bursts_are_told_with_their_gaps():
    """60 a second on average, 12 at a time."""
    policy, said = StopPolicy(FIXED), set()
    for k in range(100):
        t = 0.2 * k
        for i in range(2):
            policy.reading(t + i / 60, 0.0)
        said.add(policy.decide(t + 0.19).reason)
    assert len(said) <= 4
    assert any("gaps of 0.18 s between readings that usually come every" in text for text in said)


@pytest.mark.parametrize(
    ("rate", "good_for"), [(500, 0.1), (100, 0.1), (60, 0.1), (30, 0.1), (8, 0.3125), (5, 0.5)]
)
def test_measured_a_reading_is_good_for_two_and_a_half_intervals(rate, good_for):
    """At least 0.1 s, and at most 0.5 s, which is the promise; and free within a second or two."""
    policy = StopPolicy(CONFIG)
    assert policy.stale_after == 0.1
    said = reasons_of(policy, rate, 6.0, jitter=0.1)
    assert policy.stale_after == pytest.approx(good_for, rel=0.25)
    assert 0.1 <= policy.stale_after <= 0.5
    assert said[-1][1:] == (False, "")
    assert said[-1][0] < 10.0 / rate + 0.1
    last = 6.0
    stops = next(t for t in (last + k / 1000 for k in range(2000)) if policy.decide(t).stop)
    assert stops - last <= policy.stale_after + 0.001


@pytest.mark.parametrize("rate", [9.0, 8.0, 4.0, 2.5])
def test_a_slow_board_that_will_do_is_not_called_too_slow_at_the_start(rate):
    reasons = " ".join(reason for _, _, reason in reasons_of(StopPolicy(CONFIG), rate, 6.0))
    assert "let the board send" not in reasons
    assert "overloaded" not in reasons


@pytest.mark.parametrize("rate", [1.0, 1.9])
def test_no_rate_stretches_it_beyond_the_promise(rate):
    policy = StopPolicy(CONFIG)
    said = reasons_of(policy, rate, 30.0)
    assert policy.stale_after <= 0.5
    assert all(stop for _, stop, _ in said)
    assert "measured, at most 0.5 s: let the board send more often" in said[-1][2]


def test_one_pause_does_not_stretch_it():
    policy = StopPolicy(CONFIG)
    reasons_of(policy, 100, 2.0)
    for start in (2.4, 2.9, 3.4):
        reasons_of(policy, 100, 0.1, start=start)
        assert policy.stale_after == 0.1


def test_a_lost_reading_stops_no_slow_board():
    policy = StopPolicy(CONFIG)
    for k in range(100):
        if k % 10 != 9:
            decision = policy.reading(k / 8, 0.0)
        policy.decide(k / 8 + 0.12)
        assert k < 12 or not decision.stop


def test_a_board_that_gets_faster_is_held_to_it():
    policy = StopPolicy(CONFIG)
    reasons_of(policy, 8, 5.0)
    reasons_of(policy, 100, 1.0, start=5.0)
    assert policy.stale_after == 0.1


def test_a_decision_names_its_causes():
    """What only a push stops may move away from it: words decide nothing."""
    policy = StopPolicy(CONFIG)
    assert feed(policy, 0.0, 1.0, 0.0).causes == ()
    pushed = feed(policy, 1.0, 1.1, 40.0)
    assert pushed.causes == (Cause.PUSH,) and pushed.for_push_alone
    policy.fault("push", "push")
    both = policy.decide(2.1)
    assert both.causes == (Cause.PUSH, Cause.FAULT) and not both.for_push_alone


@pytest.mark.parametrize("fades", ["exponentially", "evenly"])
@pytest.mark.parametrize("seconds", [1.0, 5.0, 60.0])
def test_a_push_that_fades_is_held_until_it_is_let_go(fades, seconds):
    """Readings that creep back to rest under a hand are those of a board that moves its zero."""
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0))
    feed(policy, 0.0, 0.5, 0.0)
    even = max(seconds, 4.0)  # s: hands may take 3 s
    n = round(100 * (6.0 * seconds + 6.0))
    for k in range(n):
        t = k / 100
        share = math.exp(-t / seconds) if fades == "exponentially" else max(1.0 - t / even, 0.0)
        assert policy.reading(0.5 + t, 45.0 * share).stop
    end = 0.5 + n / 100
    assert "faded" in policy.decide(end).reason and pushed(policy.decide(end))
    feed(policy, end, 0.3, 40.0)
    assert not feed(policy, end + 0.3, 0.5, 0.0).stop, "touched again, and let go"


@pytest.mark.parametrize("rate", [12, 25, 100])
def test_forces_fade_faster_than_readings_where_the_curve_is_steep(rate):
    """A zero that follows in 1 s takes half of a palm's newtons in 0.3 s, and goes on so."""
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0))
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(8 * rate):
        assert policy.reading(0.5 + k / rate, 45.0 * math.exp(-k / rate / 0.45)).stop


@pytest.mark.parametrize("left", [0.05, 0.1, 0.15])
@pytest.mark.parametrize("seconds", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("rate", [12, 100])
def test_a_hand_has_let_go_though_a_soft_cover_comes_back_slowly(rate, seconds, left):
    """It leaves within 0.1 s; what is left neither stands nor is gone for seconds."""
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0))
    for k in range(6 * rate):
        t = k / rate - 2.0  # s since it leaves
        share = 1.0 if t < 0.0 else max(1.0 - 10.0 * t, left * math.exp(-t / seconds))
        policy.reading(k / rate, 45.0 * share)
    assert not policy.decide(6.0 - 1.0 / rate).stop


@pytest.mark.parametrize("rate", [5, 12, 100])
def test_a_push_is_over_where_a_hand_stays_and_presses_less(rate):
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0))
    t = [k / rate for k in range(4 * rate)]
    for at in t:
        policy.reading(at, 35.0 if at < 2.0 else 15.0)
    assert not policy.decide(t[-1]).stop


def test_what_was_let_go_in_part_and_then_fades_is_held():
    policy = StopPolicy(StopConfig(threshold=30.0, release=10.0))
    feed(policy, 0.0, 0.5, 45.0)
    feed(policy, 0.5, 0.5, 20.0)
    for k in range(3000):
        assert policy.reading(1.0 + k / 100, 20.0 * math.exp(-k / 500)).stop


@pytest.mark.parametrize("seconds", [0.02, 0.3, 1.0, 2.5])
def test_a_hand_that_leaves_slowly_has_let_go(seconds):
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0))
    rng = random.Random(7)
    for k in range(300):
        policy.reading(k / 100, 45.0 * (1.0 + 0.03 * rng.gauss(0.0, 1.0)))
    for k in range(round(100 * seconds)):
        policy.reading(3.0 + k / 100, 45.0 * (1.0 - k / 100 / seconds))
    assert not feed(policy, 3.0 + seconds, 0.5, 0.0).stop


def test_who_has_checked_a_skin_ends_what_only_faded():
    policy = StopPolicy(StopConfig(threshold=30.0, release=20.0))
    for k in range(2000):
        policy.reading(k / 100, 45.0 * math.exp(-k / 200))
    assert pushed(policy.decide(20.0))
    assert policy.reset(20.0) == "" and not policy.decide(20.0).stop


def test_a_push_is_said_with_what_it_may_be():
    policy = StopPolicy(StopConfig(threshold=30.0))
    policy.unknown = "newtons are not proved"
    feed(policy, 0.0, 0.5, 0.0)
    said = policy.reading(0.5, 41.0, felt=14.0).reason
    assert said == "push: 14 N (may be 41 N: newtons are not proved), limit 30 N"
    assert policy.reading(0.51, 44.0, felt=15.0).reason == said, "each new reason calls the hooks"


class Door:
    """A source of somebody's own, which is no skin."""

    open = False

    def reasons(self, t):
        return [because(Cause.FAULT, "is open", "door")] if self.open else []


def test_any_source_stops_by_its_name_and_latches():
    door = Door()
    stop = Stop(StopConfig(latch=True), [door, Door()])
    assert not stop.decide(0.0).stop
    door.open = True
    assert stop.decide(0.1).reason == "door: fault: is open + door: latched: fault: is open"
    assert stop.reset(0.2) == "door: fault: is open"
    door.open = False
    assert stop.decide(0.3).causes == (Cause.LATCHED,)
    assert stop.reset(0.4) == "" and not stop.decide(0.4).stop
