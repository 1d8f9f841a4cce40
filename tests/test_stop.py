"""The robot stops for a push and for whatever it does not know, and goes on only when free."""

import pytest

from tactile_skin.stop import StopConfig, StopPolicy

CONFIG = StopConfig(threshold=10.0, release=6.0, debounce=0.02, hold=0.3, stale_after=0.1)


def feed(policy, start, seconds, force, rate=100):
    """Readings of one force at 100 a second; the last decision."""
    decision = None
    for k in range(round(seconds * rate)):
        decision = policy.reading(start + k / rate, force)
    return decision


def test_before_the_first_reading_it_stops():
    decision = StopPolicy(CONFIG).decide(0.0)
    assert decision.stop and decision.reason == "stale: no reading yet"


def test_an_idle_skin_is_free():
    assert feed(StopPolicy(CONFIG), 0.0, 1.0, 0.0) == (False, "")


def test_a_push_stops_after_the_debounce_and_not_before():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    decisions = [policy.reading(0.5 + k / 100, 12.0) for k in range(4)]
    assert [d.stop for d in decisions] == [False, False, True, True]
    assert decisions[2].reason == "push"


def test_a_single_spike_is_no_push():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 0.0)
    for k in range(10, 110):
        assert not policy.reading(k / 100, 50.0 if k % 10 == 0 else 0.0).stop


def test_without_debounce_one_reading_is_enough():
    policy = StopPolicy(StopConfig(threshold=10.0, release=6.0, debounce=0.0))
    feed(policy, 0.0, 0.1, 0.0)
    assert policy.reading(0.1, 10.0) == (True, "push")


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
    assert policy.decide(0.60) == (True, "stale: readings stay away")
    assert policy.reading(0.7, 0.0) == (True, "stale: readings only just came back")
    assert feed(policy, 0.71, 0.02, 0.0).stop
    assert not policy.reading(0.73, 0.0).stop


def test_a_push_is_not_forgotten_while_readings_stay_away():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 20.0)
    assert policy.decide(5.0).reason == "push + stale: readings stay away"
    assert feed(policy, 5.0, 0.02, 0.0).stop
    assert not feed(policy, 5.02, 0.05, 0.0).stop


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
    assert late.stop and late.reason.startswith("stale")
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.5, 0.0)
    for k in range(50):
        repeated = policy.reading(0.5 + k / 100, 0.0, stamp=0.49)
    assert repeated.reason == "stale: readings stay away"


def test_a_clock_that_is_set_back_stops_and_begins_anew():
    """By an hour, as when a robot's time is set: not free for an hour on a reading of the past."""
    policy = StopPolicy(StopConfig())
    feed(policy, 5000.0, 1.0, 0.0)
    assert not policy.decide(5001.0).stop
    assert policy.decide(1400.0) == (True, "stale: readings stay away")
    assert policy.reading(1400.01, 0.0) == (True, "stale: readings only just came back")
    feed(policy, 1400.02, 0.1, 0.0)
    assert not policy.decide(1400.12).stop
    feed(policy, 1400.13, 0.1, 40.0)
    assert policy.decide(1400.23) == (True, "push")


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
    assert decision == (True, "push")


def test_a_fault_stops_until_it_is_taken_back():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 0.0)
    policy.fault("compensation", "open line")
    assert policy.decide(0.1) == (True, "fault: compensation: open line")
    policy.fault("compensation", "")
    assert not policy.decide(0.1).stop


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"threshold": 0.0}, "threshold = 0.0"),
        ({"threshold": 5.0, "release": 6.0}, "release = 6.0"),
        ({"stale_after": 0.0}, "stale_after = 0.0"),
        ({"debounce": -1.0}, "debounce = -1.0"),
        ({"hold": float("nan")}, "hold = nan"),
    ],
)
def test_settings_that_switch_the_stop_off_are_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        StopConfig(**kwargs)
