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
    for k in range(100):
        assert not policy.reading(k / 100, 50.0 if k % 10 == 0 else 0.0).stop


def test_without_debounce_one_reading_is_enough():
    policy = StopPolicy(StopConfig(threshold=10.0, release=6.0, debounce=0.0))
    assert policy.reading(0.0, 10.0) == (True, "push")


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
    assert not policy.reading(0.7, 0.0).stop


def test_a_push_is_not_forgotten_while_readings_stay_away():
    policy = StopPolicy(CONFIG)
    feed(policy, 0.0, 0.1, 20.0)
    assert policy.decide(5.0).reason == "push + stale: readings stay away"
    assert policy.reading(5.0, 0.0).stop is False


def test_a_gap_does_not_count_as_time_above_the_threshold():
    policy = StopPolicy(CONFIG)
    policy.reading(0.0, 20.0)
    assert not policy.reading(1.0, 20.0).stop
    assert policy.reading(1.02, 20.0).stop


def test_a_fault_stops_until_it_is_taken_back():
    policy = StopPolicy(CONFIG)
    policy.reading(0.0, 0.0)
    policy.fault("compensation", "open line")
    assert policy.decide(0.0) == (True, "fault: compensation: open line")
    policy.fault("compensation", "")
    assert not policy.decide(0.0).stop


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
