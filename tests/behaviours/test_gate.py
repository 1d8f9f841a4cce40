# SPDX-License-Identifier: Apache-2.0
"""The gate lets a robot move away from a push and never into it, and is zero when in doubt."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_skin.behaviours.gate import Gate, GateConfig
from tactile_skin.behaviours.stop import OUT_OF_DATE, Cause, StopMessage

FREE, PUSH = StopMessage(False, ""), StopMessage(True, "push", causes=(Cause.PUSH,))
CONFIG = GateConfig()
RADIUS = 0.15  # m
EIGHT = np.arange(8) * math.pi / 4


def unit(azimuth) -> np.ndarray:
    return np.array([math.cos(azimuth), math.sin(azimuth), 0.0])


def pushed(side, force=40.0, t=10.0, config=CONFIG) -> Gate:
    """A gate that hears of a push on a cylinder's side of this azimuth, at t."""
    gate = Gate(config)
    gate.stop(t, PUSH)
    gate.touch(t, force, -force * unit(side), RADIUS * unit(side))
    return gate


def ask(gate, linear=(0.0, 0.0, 0.0), angular=(0.0, 0.0, 0.0), t=10.0):
    gate.command(t, linear, angular)
    return gate.decide(t)


def is_zero(motion) -> bool:
    return not np.any(motion.linear) and not np.any(motion.angular)


def test_a_free_runs_out_with_the_reading_that_it_rests_on():
    """Also one that was heard this very moment; a stop does not run out."""
    gate = Gate(CONFIG)
    gate.stop(10.0, StopMessage(False, "", until=10.05))
    assert ask(gate, (0.5, 0.0, 0.0), t=10.05).reason == ""
    late = ask(gate, (0.5, 0.0, 0.0), t=10.06)
    assert is_zero(late)
    assert late.reason == OUT_OF_DATE
    gate.stop(10.06, StopMessage(True, "on fire", until=0.0))
    assert ask(gate, (0.5, 0.0, 0.0), t=10.06).reason == "on fire"


# --- directions ---


@pytest.mark.parametrize("side", EIGHT)
@pytest.mark.parametrize("course", EIGHT)
def test_each_course_under_a_push_from_each_of_eight_sides(side, course):
    """Away from the hand and along the skin as asked for; towards the hand not at all."""
    motion = ask(pushed(side), unit(course))
    towards = math.cos(course - side)
    if towards < 1e-9:
        np.testing.assert_array_equal(motion.linear, unit(course))
        assert motion.reason == ""
    else:
        assert is_zero(motion)
        assert motion.reason == "push: motion against it"


def test_a_cover_of_unknown_shape_lets_no_motion_pass_while_it_is_pushed():
    """Its pushes have places, and no direction: each course might lead into the hand."""
    gate = Gate(CONFIG)
    gate.stop(10.0, PUSH)
    gate.touch(10.0, 40.0, np.zeros(3), [0.0, 0.1, 0.0])
    for side in EIGHT:
        motion = ask(gate, unit(side), (0.0, 0.0, 0.4))
        assert is_zero(motion)
        assert motion.reason == "push: its direction is unknown: set geometry.shape"
    gate.stop(10.0, FREE)
    gate.touch(10.01, 0.0, np.zeros(3), np.zeros(3))
    assert not is_zero(ask(gate, unit(0.0)))


@pytest.mark.parametrize(("turn", "passes"), [(1.0, True), (-1.0, False)])
def test_a_rotation_that_turns_the_skin_into_the_hand_is_blocked(turn, passes):
    """A hand on the front, left of the axis: a left turn takes the skin back, away from it."""
    gate = Gate(CONFIG)
    gate.stop(10.0, PUSH)
    gate.touch(10.0, 40.0, (-40.0, 0.0, 0.0), (0.3, 0.2, 0.0))
    motion = ask(gate, angular=(0.0, 0.0, turn))
    assert is_zero(motion) is not passes


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_rotation_between_two_hands_turns_the_skin_into_one_of_them(turn):
    """Both on the front: the centre of force, between them, moves along the skin."""
    gate = Gate(CONFIG)
    gate.stop(10.0, PUSH)
    gate.touch(10.0, 60.0, (-60.0, 0.0, 0.0), [(0.3, 0.2, 0.0), (0.3, -0.2, 0.0)])
    assert is_zero(ask(gate, angular=(0.0, 0.0, turn)))
    assert ask(gate, (-0.3, 0.0, 0.0), (0.0, 0.0, turn)).reason == ""  # faster away than it turns


def test_a_base_that_cannot_move_sideways_is_never_told_to():
    """The command is passed, slowed or zero: a part of it alone would be another path."""
    for side in np.linspace(0.0, 2 * math.pi, 100):
        motion = ask(pushed(side), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5))
        assert motion.linear[1] == 0.0
        assert motion.angular[2] == pytest.approx(0.5 * motion.linear[0])


def test_noise_of_the_direction_does_not_make_it_stutter():
    """Driving along the skin, half a degree of noise changes the speed by less than 9 %."""
    errors = np.arange(-0.2, 0.2, math.radians(0.5))  # rad
    speeds = [ask(pushed(math.pi / 2 + e), (1.0, 0.0, 0.0)).linear[0] for e in errors]
    assert {min(speeds), max(speeds)} == {0.0, 1.0}
    assert np.abs(np.diff(speeds)).max() < 0.09


vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


@given(vectors, vectors, vectors, vectors, st.floats(0.0, 200.0))
def test_what_passes_is_a_share_of_the_command_that_hardly_goes_into_the_contact(
    linear, angular, force, centre, total
):
    """At most a fortieth of the touched point's speed, by the edge's width."""
    gate = Gate(CONFIG)
    gate.stop(10.0, PUSH)
    gate.touch(10.0, total, force, centre)
    motion = ask(gate, linear, angular)
    asked = np.concatenate([linear, angular])
    given_ = np.concatenate(motion[:2])
    share = given_ @ asked / max(asked @ asked, 1e-300)
    assert -1e-9 <= share <= 1.0 + 1e-9
    np.testing.assert_allclose(given_, share * asked, atol=1e-9)
    length = np.linalg.norm(force)
    if total < CONFIG.touch or length < CONFIG.alignment * total:
        assert is_zero(motion)
        return
    velocity = motion.linear + np.cross(motion.angular, centre)
    commanded = np.linalg.norm(linear + np.cross(angular, centre))
    assert -velocity @ force / length <= commanded / 40 + 1e-9


# --- zero when in doubt ---


def test_without_a_stop_the_command_passes_whole():
    gate = Gate(CONFIG)
    gate.stop(10.0, FREE)
    motion = ask(gate, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert (*motion.linear, *motion.angular, motion.reason) == (1, 2, 3, 4, 5, 6, "")


@pytest.mark.parametrize(
    "reason",
    [
        "stale: readings no longer arrive",
        "push + stale: readings no longer arrive",
        "fault: compensation: open line",
        "push + fault: compensation: open line",
        "push + latched: push",
        "latched: push",
        "",
    ],
)
def test_every_stop_but_a_push_alone_is_zero_whatever_the_course(reason):
    gate = pushed(0.0)
    gate.stop(10.0, StopMessage(True, reason))
    for course in EIGHT:
        motion = ask(gate, unit(course))
        assert is_zero(motion)
        assert motion.reason == (reason or "stop")


def test_zero_before_the_stops_first_word_and_when_it_falls_silent():
    gate = Gate(CONFIG)
    assert ask(gate, (1.0, 0.0, 0.0)).reason == "no message from the stop"
    gate.stop(10.0, FREE)
    assert not is_zero(ask(gate, (1.0, 0.0, 0.0), t=10.0 + CONFIG.stop_timeout - 0.01))
    silent = ask(gate, (1.0, 0.0, 0.0), t=10.0 + CONFIG.stop_timeout + 0.01)
    assert is_zero(silent) and silent.reason == "no message from the stop"


def test_a_command_that_nobody_repeats_ends():
    """The dead man's switch: whatever sent it may have died."""
    gate = Gate(CONFIG)
    gate.command(10.0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for dt, passes in ((0.0, True), (0.2, True), (0.26, False), (5.0, False)):
        gate.stop(10.0 + dt, FREE)
        motion = gate.decide(10.0 + dt)
        assert is_zero(motion) is not passes
        assert motion.reason == ("" if passes else "no command")


@pytest.mark.parametrize(
    ("age", "reason"),
    [
        (0.0, ""),
        (0.2, ""),
        (-0.01, ""),
        (0.3, "the command's stamp is old: synchronise the clocks"),
        (1e9, "the command's stamp is old: synchronise the clocks"),
        (-0.05, "the command's stamp is in the future: synchronise the clocks"),
        (-10.0, "the command's stamp is in the future: synchronise the clocks"),
        (math.nan, "the command's stamp is old: synchronise the clocks"),
    ],
)
def test_a_command_is_as_old_as_its_stamp(age, reason):
    gate = Gate(CONFIG)
    gate.stop(10.0, FREE)
    gate.command(10.0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), stamp=10.0 - age)
    motion = gate.decide(10.0)
    assert motion.reason == reason
    assert is_zero(motion) is bool(reason)


def test_a_stamp_does_not_make_a_silent_sender_new():
    gate = Gate(CONFIG)
    gate.command(10.0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), stamp=10.02)
    gate.stop(10.26, FREE)
    assert gate.decide(10.26).reason == "no command"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_number_is_zero(bad):
    gate = Gate(CONFIG)
    gate.stop(10.0, FREE)
    assert is_zero(ask(gate, (0.0, bad, 0.0)))
    assert is_zero(ask(gate, angular=(0.0, 0.0, bad)))


@pytest.mark.parametrize("speed", [1e153, 1e155, 1e308])
@pytest.mark.parametrize("side", EIGHT)
def test_no_command_is_too_large_to_be_against_a_push(speed, side):
    """Its square, and so its length, may be infinite though it is not."""
    assert is_zero(ask(pushed(side), speed * unit(side)))
    assert is_zero(ask(pushed(side), speed * unit(side), (0.0, 0.0, speed)))


@pytest.mark.parametrize("right", [30.0, 2.2])  # N; below 5.3 % of the left it is not noticed
def test_a_squeeze_blocks_both_sides(right):
    """Its vectors cancel: 40 N from the left and 30 N from the right are 10 N from the left."""
    gate = Gate(CONFIG)
    gate.stop(10.0, PUSH)
    gate.touch(10.0, 40.0 + right, (0.0, right - 40.0, 0.0), (0.0, 0.02, 0.0))
    for course in EIGHT:
        motion = ask(gate, unit(course))
        assert is_zero(motion)
        assert motion.reason == "push: it comes from several sides"


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_touch_that_is_no_number_has_no_direction(bad):
    for force, centre in (((bad, 0.0, 0.0), (0.0,) * 3), ((-40.0, 0.0, 0.0), (0.0, bad, 0.0))):
        gate = pushed(0.0)
        gate.touch(10.01, 40.0, force, centre)
        assert is_zero(ask(gate, (-1.0, 0.0, 0.0), t=10.01))


def test_a_direction_that_nobody_renews_does_not_count():
    gate = pushed(0.0)
    for dt, passes in ((0.09, True), (0.11, False)):
        gate.stop(10.0 + dt, PUSH)
        motion = ask(gate, (-1.0, 0.0, 0.0), t=10.0 + dt)
        assert is_zero(motion) is not passes
    assert motion.reason == "push: its direction is not published"


def test_a_stamp_from_the_future_is_no_news():
    """It would count as fresh for ever."""
    gate = Gate(CONFIG)
    gate.stop(10.0, PUSH)
    gate.touch(3600.0, 40.0, (-40.0, 0.0, 0.0), (0.15, 0.0, 0.0))
    assert is_zero(ask(gate, (-1.0, 0.0, 0.0)))


def test_an_old_touch_does_not_replace_a_newer_one():
    gate = pushed(0.0)
    gate.touch(9.99, 40.0, 40.0 * unit(0.0), -RADIUS * unit(0.0))
    assert is_zero(ask(gate, (1.0, 0.0, 0.0)))
    assert not is_zero(ask(gate, (-1.0, 0.0, 0.0)))


# --- after the release ---


def test_while_a_push_is_held_after_its_release_its_last_direction_holds():
    """Moving away goes on without a hitch; moving back comes after the hold."""
    gate = pushed(0.0)
    for k in range(1, 30):
        t = 10.0 + k / 100
        gate.stop(t, PUSH)
        gate.touch(t, 0.0, (0.0,) * 3, (0.0,) * 3)
        assert not is_zero(ask(gate, (-1.0, 0.0, 0.0), t=t))
        assert is_zero(ask(gate, (1.0, 0.0, 0.0), t=t))
    gate.stop(10.3, FREE)
    assert not is_zero(ask(gate, (1.0, 0.0, 0.0), t=10.3))


@pytest.mark.parametrize("course", EIGHT)
def test_a_light_touch_on_another_side_ends_the_last_direction(course):
    """Where the stop's threshold is lower than `touch`, it is a push: of a finger, say."""
    gate = pushed(0.0)
    gate.touch(10.1, 3.0, -3.0 * unit(0.2), RADIUS * unit(0.2))  # the same hand, as it leaves
    assert not is_zero(ask(gate, -unit(0.0), t=10.1))
    gate.touch(10.2, 4.0, 4.0 * unit(0.0), -RADIUS * unit(0.0))
    gate.stop(10.2, PUSH)
    motion = ask(gate, unit(course), t=10.2)
    assert is_zero(motion) and motion.reason == "push: it comes from several sides"


def test_the_next_push_does_not_take_the_last_ones_direction():
    gate = pushed(0.0)
    gate.touch(10.01, 0.0, (0.0,) * 3, (0.0,) * 3)
    gate.stop(10.02, FREE)
    gate.stop(10.03, PUSH)
    for course in EIGHT:
        assert ask(gate, unit(course), t=10.03).reason == "push: its direction is unknown"


def test_a_clock_that_is_set_back_does_not_make_it_deaf_to_touches():
    """Zero until a touch of the new time tells the direction."""
    gate = pushed(math.pi / 2, t=5000.0)
    gate.stop(1400.0, PUSH)
    assert is_zero(ask(gate, (1.0, 0.0, 0.0), t=1400.0))
    gate.touch(1400.01, 40.0, -40.0 * unit(math.pi), RADIUS * unit(math.pi))
    assert ask(gate, (1.0, 0.0, 0.0), t=1400.01).linear[0] == 1.0
