# SPDX-License-Identifier: Apache-2.0
"""Touches over time: ids, velocity, state, merge and split; a hundred frames a second."""

import numpy as np
import pytest
from support.marks import ci

from tactile_skin.simulation.scenes import finger
from tactile_skin.touch import features, tracking
from tactile_skin.touch.geometry import make_geometry
from tactile_skin.touch.tracking import HELD, NEW, RELEASED, Course, Tracker

PLANE = make_geometry("plane", 16, 16)
PITCH = PLANE.pitch
DT = 0.01  # s


class Skin:
    """Feeds a tracker with the sum of the fingers pressed, a frame at a time."""

    def __init__(self):
        self.tracker, self.t = Tracker(PITCH), 0.0

    def feel(self, *fingers, dt=DT):
        """One frame: fingers as (row, col, newtons) [cells]; returns the touches."""
        self.t += dt
        return self.analyse_frame(sum((tip(*f) for f in fingers), np.zeros((16, 16))))

    def analyse_frame(self, force):
        self.frame = features.analyse_frame(force, PLANE, 0.2)
        return self.tracker.update(self.t, self.frame)


def tip(row, col, newtons=5.0):
    """A fingertip of 40 mm."""
    return finger(16, 16, row, col, newtons, width=0.45)


def there(touches):
    return [touch for touch in touches if touch.state != RELEASED]


def ids(touches):
    return [touch.id for touch in there(touches)]


def column(touch):
    return touch.contact.position[1] / PITCH + 7.5


@pytest.fixture
def skin():
    return Skin()


def test_a_released_touch_tells_its_last_contact_and_the_next_has_another_id(skin):
    (last,) = skin.feel((5, 5, 5.0))
    released = next(touches for touches in (skin.feel() for _ in range(10)) if touches)
    assert released[0].id == last.id == 1
    assert released[0].contact is last.contact
    assert ids(skin.feel((5, 5, 5.0))) == [2]


@pytest.mark.parametrize("frames", [1, 4])
def test_a_touch_out_of_sight_for_a_moment_keeps_its_id(skin, frames):
    """A touch that flickers about the threshold, or a frame that failed: 0.05 s."""
    before = ids(skin.feel((5, 5, 5.0)))
    for _ in range(frames):
        assert skin.feel() == []
    assert ids(skin.feel((5, 5.3, 5.0))) == before


@pytest.mark.parametrize("speed", [0.05, 0.5, 1.5])
def test_a_stroke_keeps_its_id_and_has_the_fingers_velocity(skin, speed):
    """So slow that its centre stands on a cell, and goes on, its usual error is twice as large."""
    step, errors = speed * DT / PITCH, []  # cells
    for k in range(int(12 / step)):
        touches = skin.feel((7.5, 2 + step * k, 5.0))
        errors.append(np.linalg.norm(touches[0].velocity - [0, speed, 0]) / speed)
        assert ids(touches) == [1]
        if k == 3:
            np.testing.assert_allclose(touches[0].velocity, [0, speed, 0], atol=0.3 * speed)
    (touch,) = touches
    usual, last = (0.1, 0.15) if speed < 0.1 else (0.05, 0.05)
    assert np.median(errors[len(errors) // 4 :]) < usual
    assert errors[-1] < last
    assert touch.confidence > (0.75 if speed < 0.1 else 0.9) * min(1.0, 12 / step / 12)
    velocity, confidence = tracking.stroke(touches)
    assert (velocity == touch.velocity).all()
    assert confidence == touch.confidence


def test_a_turn_is_followed_within_less_than_the_places_that_a_line_may_have():
    course = Course(PITCH)
    for k in range(47):
        y = 0.003 * (k if k <= 40 else 80 - k)  # m: 0.3 m/s, and back
        course.add(k * DT, np.array([0.0, y, 0.0]), 3.0)
    np.testing.assert_allclose(course.velocity, [0.0, -0.3, 0.0], atol=0.06)
    assert 0.05 < course.span < 0.1


@pytest.mark.parametrize(("cells", "right"), [(1.0, True), (3.0, False)])
def test_a_touch_of_one_cell_goes_on_while_its_centre_stands(cells, right):
    """The centre of a larger one that moves so goes and stands, and is not taken for a line."""
    course, off = Course(PITCH), []
    for k in range(200):
        y = PITCH * round(0.1 * k * DT / PITCH)
        course.add(k * DT, np.array([0.0, y, 0.0]), cells)
        off.append(abs(course.velocity[1] - 0.1))
    assert bool(np.median(off[30:]) < 0.03) == right


def test_a_touch_that_stands_still_is_no_stroke(skin):
    rng = np.random.default_rng(1)
    for _ in range(30):
        touches = skin.feel((7.5 + 0.01 * rng.standard_normal(), 5.0, 5.0))
    assert tracking.stroke(touches)[1] < 0.1


def test_two_touches_are_no_stroke(skin):
    for k in range(20):
        touches = skin.feel((3, 3 + 0.2 * k, 5.0), (12, 3 + 0.2 * k, 5.0))
    assert all(touch.confidence > 0.9 for touch in touches)
    assert tracking.stroke(touches)[1] == 0.0
    assert tracking.stroke([]) == (pytest.approx(np.zeros(3)), 0.0)


def test_a_touch_that_jumps_did_not_move(skin):
    """Another finger, set down beside at the moment that one is lifted."""
    for _ in range(20):
        skin.feel((7, 5, 5.0))
    for _ in range(3):
        (touch,) = skin.feel((7, 6.8, 5.0))
        assert not touch.velocity.any()
        assert touch.confidence == 0.0


@pytest.mark.parametrize("apart", [3.0, 2.5])
def test_two_touches_that_pass_keep_their_ids(skin, apart):
    rows = {}
    for k in range(60):
        touches = there(skin.feel((7, 2 + 0.2 * k, 5.0), (7 + apart, 14 - 0.2 * k, 6.0)))
        for touch in touches if len(touches) == 2 else ():
            row = 7.5 - touch.contact.position[2] / PITCH
            assert abs(row - rows.setdefault(touch.id, row)) < 0.3
    assert sorted(rows) == [1, 2]


def palm(row, col, newtons=40.0, width=1.2):
    return finger(16, 16, row, col, newtons, width)


def test_two_palms_that_pass_as_one_contact_keep_their_ids(skin):
    """Longer than it takes to be nearer to where the other was: they are thought to go on."""
    rows, joined = {}, 0
    for k in range(66):
        skin.t += DT
        touches = there(skin.analyse_frame(palm(6.5, 1 + 0.2 * k) + palm(9, 14 - 0.2 * k)))
        joined += len(touches) == 1
        for touch in touches if len(touches) == 2 else ():
            row = 7.5 - touch.contact.position[2] / PITCH
            assert abs(row - rows.setdefault(touch.id, row)) < 0.5
    assert joined * 0.2 > 2.5  # cells that each went meanwhile, as many as they are apart
    assert sorted(rows) == [1, 2]


def test_two_palms_joined_by_an_arm_between_keep_their_ids(skin):
    """The centre of both is far from each: the cells tell."""
    arm = np.zeros((16, 16))
    arm[7:10, 4:13] = 3.0
    for k in range(60):
        skin.t += DT
        both = palm(8, 3, 30.0) + palm(8, 13, 40.0)
        touches = there(skin.analyse_frame(np.maximum(both, arm if 20 <= k < 40 else 0.0)))
        assert len(touches) == (1 if 20 <= k < 40 else 2)
        if k == 0:
            before = {touch.id: round(column(touch)) for touch in touches}
        elif k >= 40:
            assert {touch.id: round(column(touch)) for touch in touches} == before
        elif k >= 20:
            assert ids(touches) == [1]


def join(skin, start=6.0, end=2.0):
    """Two fingers, set down one after the other, drawn together until they are one contact."""
    skin.feel((7, 5, 5.0))
    for apart in np.arange(start, end, -0.2):
        touches = skin.feel((7, 5, 5.0), (7, 5 + apart, 5.0))
    return touches


def test_touches_that_join_are_one_with_the_older_ones_id(skin):
    (touch,) = join(skin, end=1.0)
    assert touch.id == 1
    assert touch.state == HELD
    assert touch.contact.force == pytest.approx(10.0, rel=0.05)


def test_the_older_one_keeps_its_id_also_where_the_younger_is_stronger(skin):
    skin.feel((7, 4, 2.0))
    for apart in np.arange(6.0, 1.0, -0.2):
        touches = skin.feel((7, 4, 2.0), (7, 4 + apart, 20.0))
    assert ids(touches) == [1]


@pytest.mark.parametrize("pause", [0, 50])
def test_touches_that_part_again_have_their_ids_again(skin, pause):
    """Whether they stop or not: one finger does not pass through another."""
    join(skin, end=1.0)
    for _ in range(pause):
        skin.feel((7, 5, 5.0), (7, 6.1, 5.0))
    for apart in np.arange(1.1, 6.0, 0.2):
        touches = skin.feel((7, 5, 5.0), (7, 5 + apart, 5.0))
    assert {t.id: round(column(t)) for t in touches} == {1: 5, 2: 11}
    assert all(t.state == HELD for t in touches)


def test_touches_that_go_far_as_one_part_as_who_they_were(skin):
    """Two fingers, one behind the other, are drawn over the skin; then the first turns off."""
    for apart in np.arange(5.0, 1.0, -0.1):
        skin.feel((6, 3, 5.0), (6, 3 + apart, 5.0))
    for k in range(91):
        assert ids(skin.feel((6, 3 + 0.1 * k, 5.0), (6, 4.1 + 0.1 * k, 5.0))) == [1]
    for aside in np.arange(0.0, 5.0, 0.1):
        touches = skin.feel((6, 12, 5.0), (6 + aside, 13.1, 5.0))
    rows = {t.id: round(7.5 - t.contact.position[2] / PITCH) for t in touches}
    assert rows == {1: 6, 2: 11}


def test_touches_that_joined_on_their_way_and_then_stopped_part_as_who_they_were(skin):
    """What both did together does not go on in each."""
    for k in range(40):
        skin.feel((6, 10 - 0.1 * k, 5.0), (6, 15 - 0.2 * k, 5.0))
    for _ in range(40):
        assert ids(skin.feel((6, 6, 5.0), (6, 7.1, 5.0))) == [1]
    for aside in np.arange(0.0, 5.0, 0.1):
        touches = skin.feel((6, 6, 5.0), (6 + aside, 7.1, 5.0))
    rows = {t.id: round(7.5 - t.contact.position[2] / PITCH) for t in touches}
    assert rows == {1: 6, 2: 11}


def test_a_touch_that_joined_is_forgotten_after_two_seconds(skin):
    """And told as released; whoever parts then is a new touch."""
    join(skin, end=1.0)
    told = []
    for _ in range(250):
        told += [t for t in skin.feel((7, 5, 5.0), (7, 6.1, 5.0)) if t.state == RELEASED]
    assert [t.id for t in told] == [2]
    for apart in np.arange(1.1, 6.0, 0.2):
        touches = skin.feel((7, 5, 5.0), (7, 5 + apart, 5.0))
    assert sorted(ids(touches)) == [1, 3]


def test_touches_that_joined_are_released_together(skin):
    join(skin, end=1.0)
    released = [t for _ in range(10) for t in skin.feel()]
    assert sorted(t.id for t in released) == [1, 2]
    assert {t.state for t in released} == {RELEASED}


def test_a_finger_that_lifts_beside_a_palm_did_not_join_it(skin):
    """Although the palm's rim spreads on its cells; it is told as released, and soon."""
    told = []
    for k in range(30):
        skin.t += DT
        palm = finger(16, 16, 8, 5, 40.0, width=1.2 if k < 10 else 1.5)
        force = palm + (tip(8, 9.5) if k < 10 else 0.0)
        told += [(k, t.id) for t in skin.analyse_frame(force) if t.state == RELEASED]
    assert told == [(15, 2)]


def test_a_touch_that_parts_keeps_the_id_of_the_part_that_stays(skin):
    """A hand of which a finger moves away, never seen apart before."""
    for apart in np.arange(1.0, 6.0, 0.2):
        touches = skin.feel((7, 4, 9.0), (7, 4 + apart, 3.0))
    assert {t.id: round(column(t)) for t in touches} == {1: 4, 2: 10}


def test_a_clock_that_is_set_back_releases_all(skin):
    skin.feel((5, 5, 5.0), (12, 12, 5.0))
    touches = skin.feel((5, 5, 5.0), dt=-1.0)
    assert sorted((t.id, t.state) for t in touches) == [(1, RELEASED), (2, RELEASED), (3, NEW)]


def test_a_stamp_told_twice_is_no_velocity(skin):
    for k in range(6):
        (touch,) = skin.feel((5, 5 + 0.1 * k, 5.0), dt=0.0)
    assert np.isfinite(touch.velocity).all()
    assert not touch.velocity.any()


def test_ids_stay_exact_in_a_point_cloud(skin):
    """They begin anew before a float32 cannot tell them apart."""
    skin.tracker._ids = 2**24 - 2
    assert ids(skin.feel((5, 5, 5.0))) == [2**24 - 1]
    assert sorted(ids(skin.feel((5, 5, 5.0), (12, 12, 5.0)))) == [1, 2**24 - 1]
    assert np.float32(2**24 - 1) != np.float32(2**24)


@pytest.mark.parametrize("seed", [*range(3), *map(ci, range(3, 6))])
def test_whatever_fingers_do_each_touch_has_one_life(seed):
    """New once, then held, released once and never told again; an id at a time is one touch's."""
    rng = np.random.default_rng(seed)
    skin, lives = Skin(), {}
    fingers = [None, None, None, None]
    for _ in range(400):
        for k, where in enumerate(fingers):
            if where is None and rng.random() < 0.05:
                fingers[k] = rng.uniform(2, 13, 2), rng.normal(0, 0.4, 2), rng.uniform(1, 20)
            elif where is not None:
                place, speed, newtons = where
                speed = 0.9 * speed + rng.normal(0, 0.15, 2) + 0.02 * (7.5 - place)
                fingers[k] = (np.clip(place + speed, 1, 14), speed, newtons)
                if rng.random() < 0.02:
                    fingers[k] = None
        pressed = [(*f[0], f[2]) for f in fingers if f is not None]
        touches = skin.feel(*pressed, dt=0.2 if rng.random() < 0.01 else DT)
        told = [touch.id for touch in touches]
        assert len(set(told)) == len(told)
        states = [touch.state for touch in touches]
        assert states == sorted(states, key=RELEASED.__eq__)  # the released ones last
        for touch in touches:
            lives.setdefault(touch.id, []).append(touch.state)
            assert np.isfinite(touch.velocity).all()
    for _ in range(300):
        touches = skin.feel()
        for touch in touches:
            lives[touch.id].append(touch.state)
    assert len(lives) > 10
    for states in lives.values():
        assert states[0] == NEW
        assert set(states[1:-1]) <= {HELD}
        assert states[-1] == RELEASED
    assert not skin.tracker._tracks
