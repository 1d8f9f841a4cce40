# SPDX-License-Identifier: Apache-2.0
"""When a body of skins stops, and what it says: on a driven clock."""

import math

import pytest

from tactile_skin.behaviours.stop import Cause, StopConfig, StopMessage
from tactile_skin.body.stop import BodyStop


def free(until: float) -> StopMessage:
    return StopMessage(False, "", until)


@pytest.fixture
def body():
    """Two skins that are free until 0.2 s."""
    stop = BodyStop(("chest", "back"), StopConfig(threshold=30.0, release=20.0, hold=0.3), 0.0)
    stop.skins["chest"].hear(0.0, free(0.2))
    stop.skins["back"].hear(0.0, free(0.2))
    return stop


def test_both_free_is_free_until_the_first_expires(body):
    assert body.decide(0.1) == (False, "", ())
    body.skins["chest"].hear(0.1, free(0.4))
    assert body.until == 0.2


def test_a_skin_that_nobody_has_heard_stops_with_its_name():
    stop = BodyStop(("chest", "back"), StopConfig(), 0.0)
    stop.skins["chest"].hear(0.0, free(1.0))
    decision = stop.decide(0.0)
    assert decision.reason == "back: waiting: no message from its stop yet"
    assert decision.causes == (Cause.WAITING,)


def test_a_push_on_one_is_a_push_alone_and_names_it(body):
    body.skins["back"].hear(0.1, StopMessage(True, "push", causes=(Cause.PUSH,)))
    decision = body.decide(0.1)
    assert decision.reason == "back: push"
    assert decision.for_push_alone
    assert body.stopping(0.1) == ["back"]


def test_a_push_and_a_fault_are_no_push_alone(body):
    body.skins["back"].hear(0.1, StopMessage(True, "push", causes=(Cause.PUSH,)))
    body.skins["chest"].hear(0.1, StopMessage(True, "fault: a cable", causes=(Cause.FAULT,)))
    decision = body.decide(0.1)
    assert decision.reason == "chest: fault: a cable + back: push"
    assert not decision.for_push_alone


def test_silence_and_an_old_free_stop_with_the_name(body):
    body.skins["chest"].hear(0.1, free(0.4))
    assert not body.decide(0.15).stop
    assert body.decide(0.16).reason.startswith("back: stale: no message from its stop")
    body.skins["back"].hear(0.16, free(0.16))
    assert body.decide(0.17).reason.startswith("back: stale: the stop's last 'free'")


def test_a_computer_whose_clock_is_ahead_stops_by_name(body):
    """Its "free" would hold for longer than its readings are fresh."""
    body.skins["chest"].hear(0.1, free(9.0), stamp=0.1)
    body.skins["back"].hear(0.1, free(9.0), stamp=0.13)
    decision = body.decide(0.1)
    assert decision.reason == "back: stale: its clock is ahead: synchronise the clocks"
    assert decision.causes == (Cause.STALE,) and body.stopping(0.1) == ["back"]
    push = StopMessage(True, "push", causes=(Cause.PUSH,))
    body.skins["back"].hear(0.1, push, stamp=0.13)
    assert body.decide(0.1).reason.startswith("back: push + stale: its clock is ahead")
    assert not body.decide(0.1).for_push_alone
    body.skins["back"].hear(0.1, free(0.3), stamp=0.11)  # MAX_AHEAD is 0.02
    assert not body.decide(0.1).stop


def test_a_free_that_is_old_on_arrival_is_of_a_late_or_another_clock(body):
    body.skins["back"].hear(0.1, free(0.05), stamp=-0.1)
    assert body.decide(0.1).reason.startswith("back: stale: its 'free' is old when it arrives")
    body.skins["back"].hear(0.1, free(0.3), stamp=0.1)
    assert not body.decide(0.1).stop


def test_a_clock_that_is_set_back_stops(body):
    assert body.decide(-1.0).stop


def keep_free(body, t: float) -> None:
    for skin in ("chest", "back"):
        body.skins[skin].hear(t, free(t + 0.2))


def test_a_push_across_two_skins_counts_together_and_is_held(body):
    """18 N on each is no push of either, and one of the body."""
    body.touched("chest", 0.0, 18.0)
    assert not body.decide(0.0).stop
    body.touched("back", 0.01, 18.0)
    decision = body.decide(0.01)
    assert decision.reason == "back and chest: push"
    assert decision.for_push_alone
    keep_free(body, 0.1)
    body.touched("back", 0.1, 3.0)  # 21 N: above the release
    keep_free(body, 0.39)
    assert body.decide(0.39).stop
    body.touched("back", 0.39, 0.0)
    keep_free(body, 0.5)
    assert not body.decide(0.5).stop


def test_one_skin_alone_is_left_to_its_own_stop(body):
    body.touched("chest", 0.0, 100.0)
    assert not body.decide(0.0).stop


def test_an_old_force_does_not_count(body):
    body.touched("chest", 0.0, 29.0)
    body.touched("back", 1.1, 29.0)
    keep_free(body, 1.1)
    assert not body.decide(1.1).stop


def test_a_heartbeat_of_a_skin_without_readings_makes_no_push_of_an_old_force(body):
    body.touched("chest", 0.0, 25.0)
    keep_free(body, 5.0)
    body.touched("back", 5.0, 25.0)
    body.touched("chest", 0.0, 25.0)
    assert not body.decide(5.0).stop


def test_a_latched_push_across_two_lasts_until_a_reset():
    stop = BodyStop(("chest", "back"), StopConfig(latch=True), 0.0)
    stop.touched("chest", 0.0, 20.0)
    stop.touched("back", 0.0, 20.0)
    keep_free(stop, 0.2)
    assert stop.reset(0.2) != ""
    stop.touched("chest", 0.2, 0.0)
    keep_free(stop, 1.0)
    assert stop.decide(1.0).reason == "back and chest: latched: push"
    assert stop.reset(1.0) == ""


@pytest.mark.parametrize(
    ("hold", "period"),
    [
        pytest.param(0.0, 0.01, id="no hold"),
        pytest.param(0.1, 0.4, id="slower than the hold"),
        pytest.param(0.1, 0.99, id="as slow as stale_after allows"),
    ],
)
def test_a_push_across_two_lasts_as_long_as_their_readings_say_so(hold, period):
    """They arrive 10 ms late, and each is all that is known until the next one."""
    stop = BodyStop(("chest", "back", "arm"), StopConfig(hold=hold), 0.0)
    for k in range(20):
        stop.touched("chest", k * period, 25.0)
        stop.touched("back", k * period, 25.0)
        stop.touched("arm", k * period, math.nan)
        for share in (0.0, 0.5, 0.99):
            t = (k + share) * period + 0.01
            keep_free(stop, t)
            assert "back and chest: push" in stop.decide(t).reason
    stop.touched("chest", 20 * period, 0.0)
    stop.touched("back", 20 * period, 0.0)
    keep_free(stop, 21 * period)
    assert "push" not in stop.decide(21 * period).reason


def test_a_push_across_two_is_not_forgotten_while_readings_stay_away(body):
    """What comes back is above `release`, and below `threshold`."""
    body.touched("chest", 0.0, 16.0)
    body.touched("back", 0.0, 16.0)
    for k in range(500):
        body.decide(k / 50)
    body.touched("chest", 10.0, 12.0)
    body.touched("back", 10.0, 12.0)
    keep_free(body, 10.0)
    assert body.decide(10.0).reason == "back and chest: push"


def test_a_clock_that_is_set_back_does_not_hold_a_push_across_two_for_as_long(body):
    keep_free(body, 5000.0)
    body.touched("chest", 5000.0, 18.0)
    body.touched("back", 5000.0, 18.0)
    keep_free(body, 100.0)
    assert "push" in body.decide(100.0).reason
    body.touched("chest", 100.0, 0.0)
    body.touched("back", 100.0, 0.0)
    keep_free(body, 100.4)
    assert not body.decide(100.4).stop


def disturbed(stop, trouble: str, t: float) -> None:
    """What the body alone knows of; the skin itself is free all the while."""
    if trouble == "tf":
        stop.skins["back"].fault = "no transform"
    elif trouble == "late":
        stop.skins["back"].hear(t, free(t - 0.1), stamp=t - 0.2)
    elif trouble == "ahead":
        stop.skins["back"].hear(t, free(t + 1.0), stamp=t + 1.0)


@pytest.mark.parametrize("trouble", ["silent", "late", "ahead", "tf"])
def test_what_the_body_alone_knows_of_latches_once_it_was_free(trouble):
    """A cable between two computers that makes contact again must not restart the robot."""
    stop = BodyStop(("chest", "back"), StopConfig(latch=True), 0.0)
    assert stop.decide(0.2).stop  # nothing was heard: no latch
    keep_free(stop, 0.3)
    assert not stop.decide(0.3).stop
    stop.skins["chest"].hear(0.5, free(0.7))
    disturbed(stop, trouble, 0.5)
    why = stop.decide(0.5).reason
    assert stop.reset(0.5).startswith("back: ")
    stop.skins["back"].fault = ""
    keep_free(stop, 0.6)
    decision = stop.decide(0.6)
    assert decision.reason.startswith("back: latched: ") and decision.reason in why
    assert decision.causes == (Cause.LATCHED,)
    assert stop.reset(0.6) == ""
    assert not stop.decide(0.6).stop


def test_what_a_skins_own_stop_latches_or_not_the_body_does_not_latch():
    stop = BodyStop(("chest", "back"), StopConfig(latch=True), 0.0)
    keep_free(stop, 0.0)
    assert not stop.decide(0.0).stop
    stop.skins["back"].hear(0.1, StopMessage(True, "push", causes=(Cause.PUSH,)))
    assert stop.decide(0.1).stop
    keep_free(stop, 0.2)
    assert not stop.decide(0.2).stop


def test_a_skin_in_another_frame_is_a_fault(body):
    body.skins["back"].fault = "its messages are in arm"
    assert body.decide(0.1).reason == "back: fault: its messages are in arm"
    assert body.stopping(0.1) == ["back"]
    body.skins["back"].fault = ""
    assert not body.decide(0.1).stop
