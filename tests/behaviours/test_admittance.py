# SPDX-License-Identifier: Apache-2.0
"""A robot that is led moves like a mass on a damper, within its limits, and never by itself."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_skin.behaviours.admittance import Admittance, AdmittanceConfig, Linear
from tactile_skin.behaviours.stop import Cause, StopMessage

FREE, PUSH = StopMessage(False, ""), StopMessage(True, "push", causes=(Cause.PUSH,))
UNLIMITED = Linear(max_speed=1e6, max_acceleration=1e6)
DT = 0.01


class Led:
    """An admittance as on a robot: readings and the stop's messages at 100 a second."""

    def __init__(self, config=None, start=10.0):
        self.t, self.policy = start, Admittance(config or AdmittanceConfig())

    def push(self, force=(0.0, 0.0, 0.0), torque=(0.0, 0.0, 0.0), total=None, word=PUSH, dt=DT):
        self.t += dt
        self.policy.stop(self.t, word)
        total = float(np.linalg.norm(force)) if total is None else total
        self.policy.touch(self.t, total, force, torque)
        return self.policy.step(self.t)

    def hold(self, seconds, *args, **kwargs):
        return [self.push(*args, **kwargs) for _ in range(round(seconds / DT))][-1]


def is_zero(motion) -> bool:
    return not np.any(motion.linear) and not np.any(motion.angular)


# --- the mass on the damper ---


def test_the_solution_meets_the_differential_equation():
    """m dv/dt + d v = F, by central differences."""
    force, v0, h = np.array([40.0, 30.0]), np.array([0.3, -0.2]), 1e-5
    before, at, after = (UNLIMITED.step(v0, force, 0.1 + k * h) for k in (-1, 0, 1))
    left = 20.0 * (after - before) / (2 * h) + 80.0 * at
    np.testing.assert_allclose(left, force * (1 - 5.0 / 50.0), rtol=1e-7)


def test_two_short_steps_are_one_long_one():
    v, force = np.array([0.1, 0.2]), np.array([-20.0, 9.0])
    twice = UNLIMITED.step(UNLIMITED.step(v, force, 0.03), force, 0.05)
    np.testing.assert_allclose(twice, UNLIMITED.step(v, force, 0.08), rtol=1e-12)


def test_a_steady_push_moves_at_what_exceeds_the_dead_band_over_the_damping():
    motion = Led().hold(3.0, (21.0, 0.0, 0.0))
    np.testing.assert_allclose(motion.linear, [16.0 / 80.0, 0.0, 0.0], rtol=1e-3)


@pytest.mark.parametrize("azimuth", np.arange(8) * math.pi / 4)
def test_the_robot_moves_where_it_is_pushed(azimuth):
    d = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    motion = Led().hold(2.0, 20.0 * d)
    np.testing.assert_allclose(motion.linear, np.linalg.norm(motion.linear) * d, atol=1e-12)
    assert motion.linear @ d > 0.1


def test_a_push_from_above_moves_nothing():
    assert is_zero(Led().hold(1.0, (0.0, 0.0, -50.0)))


def test_it_turns_only_when_told_to():
    torque = (0.0, 0.0, 3.0)
    assert is_zero(Led().hold(1.0, torque=torque))
    turning = AdmittanceConfig(turns=True)
    motion = Led(turning).hold(3.0, torque=torque)
    assert motion.angular[2] == pytest.approx((3.0 - 1.0) / 8.0, rel=1e-3)
    assert not motion.linear.any()


def test_after_a_release_it_comes_to_rest_and_stays():
    led = Led()
    assert not is_zero(led.hold(1.0, (40.0, 0.0, 0.0)))
    assert is_zero(led.hold(3.0))
    assert is_zero(led.push())


# --- laws that hold whatever comes ---

axes = st.builds(
    Linear,
    mass=st.floats(0.1, 100.0),
    damping=st.floats(0.1, 500.0),
    dead_band=st.floats(0.0, 20.0),
    max_speed=st.floats(0.01, 2.0),
    max_acceleration=st.floats(0.01, 5.0),
)
forces = st.tuples(st.floats(-200.0, 200.0), st.floats(-200.0, 200.0)).map(np.array)
steps = st.lists(st.tuples(forces, st.floats(0.0, 3.0)), max_size=40)


@given(axes, steps)
def test_speed_and_acceleration_keep_their_limits(axis, steps):
    v = np.zeros(2)
    for force, dt in steps:
        new = axis.step(v, force, dt)
        assert np.linalg.norm(new) <= axis.max_speed * (1 + 1e-9)
        assert np.linalg.norm(new - v) <= axis.max_acceleration * dt * (1 + 1e-9) + 1e-15
        v = new


@given(axes, steps)
def test_the_energy_is_bounded_and_only_a_push_raises_it(axis, steps):
    """The speed never exceeds the old one and what the force can hold; with no force it falls."""
    v = np.zeros(2)
    for force, dt in steps:
        size = np.linalg.norm(force)
        held = max(0.0, size - axis.dead_band) / axis.damping
        new = axis.step(v, force, dt)
        before, after = np.linalg.norm(v), np.linalg.norm(new)
        assert after <= max(before, held) * (1 + 1e-9) + 1e-12  # m/s, of rounding
        if size <= axis.dead_band:
            assert after < before or before == 0.0 or dt * axis.damping / axis.mass < 1e-9
        v = new


@given(forces, forces, st.floats(1e-4, 1.0))
def test_it_gives_no_more_work_than_the_hand_puts_in(force, v, dt):
    """Passive, without limits: what the energy gains is at most the work of the force."""
    free = dataclasses.replace(UNLIMITED, dead_band=0.0)
    v = v / 100.0
    new = free.step(v, force, dt)
    rate = free.damping / free.mass
    held = force / free.damping
    way = held * dt + (v - held) * -math.expm1(-rate * dt) / rate  # of the exact solution [m]
    gained = 0.5 * free.mass * (new @ new - v @ v)
    assert gained <= force @ way + 1e-9 * (1 + abs(gained))


@given(
    st.builds(
        Linear,
        mass=st.floats(1.0, 50.0),
        damping=st.floats(10.0, 500.0),
        dead_band=st.floats(0.0, 20.0),
        max_speed=st.floats(0.01, 2.0),
        max_acceleration=st.floats(0.2, 5.0),
    ),
    st.floats(0.05, 1.0),
    forces,
)
def test_without_a_push_it_returns_to_rest(axis, dt, force):
    """Exactly, in the time that its limits and ten of its time constants allow."""
    v = axis.step(np.zeros(2), force, 3.0)
    seconds = axis.max_speed / axis.max_acceleration + 10.0 * axis.mass / axis.damping
    for _ in range(math.ceil(seconds / dt) + 1):
        v = axis.step(v, np.zeros(2), dt)
    assert not v.any()


@given(axes, st.floats(0.0, 1.0), st.floats(0.0, 2 * math.pi), st.floats(0.0, 3.0))
def test_nothing_in_the_dead_band_starts_a_motion(axis, share, azimuth, dt):
    force = share * axis.dead_band * np.array([math.cos(azimuth), math.sin(azimuth)])
    assert not axis.step(np.zeros(2), force * (1 - 1e-12), dt).any()


@pytest.mark.parametrize("stiffness", [200.0, 1000.0, 3000.0])
def test_hands_that_hold_it_somewhere_do_not_make_it_swing_up(stiffness):
    """Hands on both sides are a spring [N/m], and the robot hears of them 20 ms late.

    That takes k * delay out of the damping: 60 of 80 N s/m at the stiffest.
    """
    led, x, late, way = Led(), 0.0, [0.0, 0.0], []
    for _ in range(1500):
        late.append(stiffness * (0.02 - x))
        x += led.push((late.pop(0), 0.0, 0.0)).linear[0] * DT
        way.append(x)
    assert abs(0.02 - x) <= 5.0 / stiffness + 1e-3
    assert np.ptp(way[-200:]) < 1e-3


def test_how_far_it_rolls_on_when_the_hand_is_taken_away():
    """At full speed, by the mass over the damping or the limit: at most 9 cm."""
    led = Led()
    assert led.hold(2.0, (60.0, 0.0, 0.0)).linear[0] == pytest.approx(0.3)
    way = sum(led.push().linear[0] * DT for _ in range(500))
    assert 0.05 < way < 0.09


# --- zero at once ---


@pytest.mark.parametrize(
    "word",
    [
        StopMessage(True, "stale: readings no longer arrive"),
        StopMessage(True, "push + fault: compensation: open line"),
        StopMessage(True, "push + latched: push"),
        StopMessage(True, "latched: push"),
        StopMessage(True, ""),
    ],
)
def test_every_stop_but_a_push_alone_is_zero_at_once(word):
    led = Led()
    led.hold(1.0, (40.0, 0.0, 0.0))
    motion = led.push((40.0, 0.0, 0.0), word=word)
    assert is_zero(motion)
    assert motion.reason == (word.reason or "stop")


def test_below_the_stops_threshold_it_is_led_as_well():
    assert not is_zero(Led().hold(0.5, (12.0, 0.0, 0.0), word=FREE))


def test_after_a_stop_it_starts_from_rest():
    led = Led()
    fast = led.hold(2.0, (40.0, 0.0, 0.0)).linear[0]
    led.push((40.0, 0.0, 0.0), word=StopMessage(True, "fault: x"))
    assert led.push((40.0, 0.0, 0.0)).linear[0] <= 1.0 * DT < fast


def test_without_a_word_of_the_stop_it_stands():
    led = Led()
    assert led.policy.step(led.t).reason == "no message from the stop"


@pytest.mark.parametrize("reason", ["no reading", "no message from the stop"])
def test_readings_and_words_of_the_stop_that_stay_away_are_zero_at_once(reason):
    """The dead man's switch, also if the stop should miss it."""
    led, push = Led(), (40.0, 0.0, 0.0)
    led.hold(1.0, push)
    for k in (*range(1, 10), *range(11, 20)):
        t = led.t + k * DT
        if reason == "no reading":
            led.policy.stop(t, PUSH)
        else:
            led.policy.touch(t, 40.0, push, (0.0, 0.0, 0.0))
        motion = led.policy.step(t)
        assert is_zero(motion) is (k > 10)
    assert motion.reason == reason


def test_hands_on_several_sides_lead_nowhere():
    """40 N from the left and 30 N from the right: what is between them is not moved."""
    led = Led()
    led.hold(1.0, (0.0, -40.0, 0.0))
    motion = led.push((0.0, -10.0, 0.0), total=70.0)
    assert is_zero(motion)
    assert motion.reason == "pushes from several sides"


def test_light_touches_on_two_sides_do_not_cut_a_release_short():
    led = Led()
    before = led.hold(1.0, (40.0, 0.0, 0.0)).linear[0]
    after = led.push((0.1, 0.0, 0.0), total=1.0).linear[0]
    assert 0.0 < before - after <= 1.0 * DT + 1e-12


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_wrench_that_is_no_number_is_zero(bad):
    led = Led()
    led.hold(1.0, (40.0, 0.0, 0.0))
    assert is_zero(led.push((bad, 0.0, 0.0), total=40.0))
    assert is_zero(led.push((40.0, 0.0, 0.0), total=bad))
    assert not is_zero(led.push((40.0, 0.0, 0.0)))


def test_stamps_from_the_future_and_old_ones_prove_nothing():
    led = Led()
    led.policy.stop(led.t, PUSH)
    led.policy.touch(led.t + 100.0, 40.0, (40.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert led.policy.step(led.t).reason == "no reading"


def test_a_pause_of_the_program_is_no_time_to_speed_up():
    """A second without a step, and the next velocity is what a tenth of it allows."""
    led = Led()
    led.hold(0.1, (60.0, 0.0, 0.0))
    before = led.push((60.0, 0.0, 0.0)).linear[0]
    after = led.push((60.0, 0.0, 0.0), dt=1.0).linear[0]
    assert after - before <= 1.0 * 0.1 + 1e-9


def test_a_clock_that_is_set_back_does_not_make_it_deaf_to_touches():
    led = Led(start=5000.0)
    led.hold(1.0, (40.0, 0.0, 0.0))
    led.t = 1400.0
    led.policy.stop(led.t, PUSH)
    assert is_zero(led.policy.step(led.t))
    assert led.hold(1.0, (40.0, 0.0, 0.0)).linear[0] > 0.1
