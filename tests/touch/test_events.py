# SPDX-License-Identifier: Apache-2.0
"""Each push and each stroke is one event, and says where and how strong."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_skin.touch.events import Pushed, PushEvents, Released, StrokeEvents

FORCE, CENTRE = np.array([0.0, -30.0, 0.0]), np.array([0.0, 0.15, 0.0])


def kinds(events) -> list[type]:
    return [type(event) for event in events]


def test_a_push_is_told_once_with_its_force_and_centre():
    events = PushEvents()
    assert events.touch(1.00, FORCE, CENTRE) == []
    (pushed,) = events.stop(1.00, True)
    np.testing.assert_array_equal(pushed.force, FORCE)
    np.testing.assert_array_equal(pushed.centre, CENTRE)
    assert events.touch(1.01, FORCE, CENTRE) == events.stop(1.01, True) == []


def test_a_push_waits_for_the_wrench_of_its_own_reading():
    """The stop hears of the contacts before anybody hears of the wrench."""
    events = PushEvents()
    events.touch(0.99, FORCE / 100, CENTRE)
    assert events.stop(1.00, True) == []
    (pushed,) = events.touch(1.00, FORCE, CENTRE)
    np.testing.assert_array_equal(pushed.force, FORCE)


def test_a_wrench_that_never_comes_does_not_keep_the_push_back():
    events = PushEvents()
    assert events.stop(1.00, True) == []
    (pushed,) = events.stop(1.00, True)  # the heartbeat
    assert not pushed.force.any()
    assert events.touch(1.00, FORCE, CENTRE) == []


def test_a_release_says_how_long_the_push_lasted():
    events = PushEvents()
    events.touch(1.0, FORCE, CENTRE)
    events.stop(1.0, True)
    assert events.stop(3.5, False) == [Released(2.5)]
    assert events.stop(3.6, False) == []


def test_no_release_comes_without_its_push():
    """Also of one that was over before its wrench came."""
    events = PushEvents()
    assert events.stop(0.5, False) == []
    events.stop(1.0, True)
    assert kinds(events.stop(1.1, False)) == [Pushed, Released]


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=80))
def test_pushes_and_releases_take_turns(steps):
    events, told = PushEvents(), []
    for k, (pushed, seen) in enumerate(steps):
        told += events.touch(float(k), FORCE, CENTRE) if seen else []
        told += events.stop(float(k), pushed)
    told += events.stop(float(len(steps)), False)
    assert kinds(told) == [Pushed, Released] * (len(told) // 2)
    starts = sum(
        now and not before
        for (before, _), (now, _) in zip([(False, 0), *steps], steps, strict=False)
    )
    assert len(told) == 2 * starts


def test_a_stroke_is_told_once_until_its_confidence_has_sunk():
    events, velocity = StrokeEvents(), (0.1, 0.0, 0.0)
    told = [len(events.update(velocity, c)) for c in (0, 0.7, 0.8, 0.95, 0.6, 0.9, 0.3, 0.7, 0.9)]
    assert told == [0, 0, 1, 0, 0, 0, 0, 0, 1]
    (event,) = StrokeEvents().update(velocity, 0.9)
    np.testing.assert_array_equal(event.velocity, velocity)
    assert event.confidence == 0.9
