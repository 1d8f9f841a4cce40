# SPDX-License-Identifier: Apache-2.0
"""What a standing load gains is measured, and taken out while it stands."""

import numpy as np
import pytest
from support.creep import calibrated, felt
from support.lab.unknown import Creeping
from support.weights import known, objects

from tactile_skin import Creep, PressureCurve, measure_creep, measure_rest
from tactile_skin.calibration.creep import LIMIT, Gained, Standing, as_it_comes, creep_of_presses

CURVE, CREEP = PressureCurve(), Creep(0.05, 1.0)
SHAPE = 8, 8


def reading(load, times, share=0.05, time=1.0):
    """(n, 2, 2) [N] that is found of loads (n,) [N] that came one after the other, on each cell."""
    at_rest = 1.0 / CURVE.points[0][1]
    added = 1.0 / CURVE.resistance(np.asarray(load, dtype=float)) - at_rest
    steps = np.diff(added, prepend=0.0)
    gained = [
        share * steps[: n + 1] @ np.log10(1.0 + (t - times[: n + 1]) / time)
        for n, t in enumerate(times)
    ]
    force = CURVE.force(1.0 / (added + gained + at_rest))
    return np.repeat(force, 4).reshape(-1, 2, 2)


def taken_out(force, times, creep=CREEP):
    standing = Standing(creep, CURVE)
    return np.array([standing.update(t, f)[0, 0] for t, f in zip(times, force, strict=True)])


@pytest.mark.parametrize("time", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("step", [0.02, 0.5])
def test_a_load_that_stands_for_ten_minutes(time, step):
    times = np.append(np.arange(0.0, 20.0, step), np.arange(20.0, 600.0, 5.0))
    force = reading(np.full(times.size, 2.0), times, time=time)
    assert force[-1, 0, 0] > 2.2
    np.testing.assert_allclose(taken_out(force, times, Creep(0.05, time)), 2.0, rtol=0.01)


@pytest.mark.parametrize("course", ["grows", "steps up", "slow push"])
def test_a_load_that_changes_is_felt_as_it_is(course):
    times = np.arange(0.0, 300.0, 0.5)
    load = {
        "grows": 2.0 * (1.0 + 0.05 * times / 60.0),
        "steps up": np.where(times < 100.0, 1.0, 3.0),
        "slow push": 3.0 * times / 300.0,
    }[course]
    found = taken_out(reading(load, times), times)
    np.testing.assert_allclose(found, load, rtol=0.01, atol=0.01)


def test_a_step_passes_in_full_and_at_once():
    times = np.append(np.arange(0.0, 300.0, 0.5), 300.01)
    force = np.full((times.size, 2, 2), 1.0)
    force[-1] = 2.0
    found = taken_out(force, times)
    assert found[-1] - found[-2] > 0.99


def test_what_stands_is_worked_out_as_seldom_as_it_creeps(monkeypatch):
    """A frame costs next to nothing while a load stands; what comes next to it is felt at once."""
    times, looks, update = np.arange(0.0, 3.0, 0.01), [], Gained.update
    monkeypatch.setattr(Gained, "update", lambda self, *a: looks.append(a[0]) or update(self, *a))
    force = reading(np.full(times.size, 2.0), times, 0.1, 0.1)
    np.testing.assert_allclose(taken_out(force, times, Creep(0.1, 0.1)), 2.0, rtol=0.02)
    assert len(looks) < 0.25 * times.size
    force[-1, 0, 1] += 1.0
    standing = Standing(Creep(0.1, 0.1), CURVE)
    found = [standing.update(t, f)[0, 1] for t, f in zip(times, force, strict=True)]
    assert found[-1] - found[-2] == pytest.approx(1.0, abs=0.05)


def test_a_load_that_went_is_nothing_and_the_next_one_is_whole():
    times = np.arange(0.0, 302.0, 0.1)
    force = np.full((times.size, 2, 2), 2.0)
    force[(times > 299.0) & (times <= 301.0)] = 0.0
    found = taken_out(force, times)
    assert (found[(times > 299.1) & (times < 301.0)] == 0.0).all()
    assert found[times > 301.0][0] == pytest.approx(2.0, rel=0.002)


def test_a_part_that_went_takes_its_gain_with_it():
    """What is left is soon felt as a load that had stood by itself for so long."""
    times = np.append(np.arange(0.0, 299.0, 1.0), np.arange(299.0, 309.0, 0.1))
    force = np.where(times < 299.0, 4.0, 1.0).repeat(4).reshape(-1, 2, 2)
    found = taken_out(force, times)[times >= 299.0]
    assert found.min() > 0.8
    assert found[-1] == pytest.approx(taken_out(np.ones((300, 2, 2)), times[:300])[-1], abs=0.05)


def test_one_frame_that_drops_out_does_no_harm():
    times = np.arange(0.0, 300.0, 0.02)
    force = reading(np.full(times.size, 2.0), times)
    force[-10] = 0.0
    assert taken_out(force, times)[-9:] == pytest.approx(2.0, rel=0.02)


def test_loads_that_nobody_saw_are_taken_as_they_are():
    """After a clock that was set back, or a board that was gone."""
    times = np.array([*np.arange(0.0, 300.0, 1.0), 200.0, 201.0, 260.0])
    found = taken_out(np.full((times.size, 2, 2), 2.0), times)
    assert found[299] < 1.8
    assert found[[300, 302]] == pytest.approx(2.0)


def test_it_never_raises_a_force_and_takes_no_more_than_its_limit():
    """Of whatever comes, in whatever order."""
    rng = np.random.default_rng(4)
    standing, t = Standing(Creep(0.1, 0.1), CURVE), 0.0
    for _ in range(2000):
        t += rng.choice([0.01, 0.01, 10.0, 1000.0, -5.0])
        force = rng.exponential(1.0, (4, 4)) * (rng.random((4, 4)) < 0.7)
        found = standing.update(t, force)
        assert (found <= force).all()
        added = [1.0 / CURVE.resistance(f) - 1.0 / 40000.0 for f in (found, force)]
        assert (added[0] >= (1.0 - LIMIT) * added[1] - 1e-12).all()


def test_the_curve_of_a_load_that_just_came():
    """A second measurement does not move it again."""
    once = as_it_comes(CURVE, CREEP)
    added = [1.0 / c.resistance(CURVE.points[5][0]) - 1.0 / 40000.0 for c in (CURVE, once)]
    assert added[0] / added[1] == pytest.approx(CREEP.gain(5.0), rel=1e-6)
    assert once.rest_resistance == CURVE.rest_resistance
    assert as_it_comes(once, CREEP, CREEP).points[4] == pytest.approx(once.points[4])
    assert as_it_comes(CURVE, Creep()).points[4] == pytest.approx(CURVE.points[4])


@pytest.fixture(scope="module")
def record():
    """Two minutes of an object on an unknown board, laid down after 5 s."""
    skin = Creeping(SHAPE, 41, share=0.05, time=1.0)
    force = objects(1, SHAPE, np.random.default_rng(41))[0][0]
    times = np.arange(0.0, 125.0, 0.25)
    frames = skin.standing(times, force, (times >= 5.0) * 1.0)
    circuit = known(skin)
    return frames, times, circuit, measure_rest(skin.at_rest(), circuit)


def test_the_share_is_measured(record):
    frames, times, circuit, rest = record
    creep = measure_creep(frames, times, circuit, rest, CURVE)
    assert creep.share == pytest.approx(0.05, abs=0.003)
    assert creep.std < 0.006 and 0.3 < creep.time < 3.0


def test_a_fabric_that_does_not_creep(record):
    _, times, circuit, rest = record
    skin = Creeping(SHAPE, 41, share=0.0, time=1.0)
    force = objects(1, SHAPE, np.random.default_rng(41))[0][0]
    frames = skin.standing(times[::4], force, np.ones(times[::4].size))
    assert measure_creep(frames, times[::4], circuit, rest, CURVE).share < 0.001


@pytest.mark.parametrize(
    ("part", "why"),
    [
        (slice(0, 100), "30 s or more"),
        (slice(0, 20), "nothing stands"),
        ("taken off", "taken off after 4. s"),
        ("times", "must be 500 that rise"),
        ("pressed", "jumps by"),
        ("lifted", "falls by"),
    ],
)
def test_what_tells_no_creep_is_said(record, part, why):
    frames, times, circuit, rest = record
    if part == "taken off":
        frames = np.where((times > 50.0)[:, None, None] & (times < 60.0)[:, None, None],
                          frames[0], frames)  # fmt: skip
    elif part == "pressed":
        frames = frames + 0.15 * (frames - frames[0]) * (times > 60.0)[:, None, None]
    elif part == "lifted":
        lift = 1.0 - 0.1 * np.log10(1.0 + np.maximum(times - 5.0, 0.0))
        frames = frames[0] + (frames - frames[0]) * lift[:, None, None]
    elif part == "times":
        times = times[::-1]
    else:
        frames, times = frames[part], times[part]
    with pytest.raises(ValueError, match=why):
        measure_creep(frames, times, circuit, rest, CURVE)


def test_from_the_board_to_ten_minutes():
    """Circuit, curve and creep as they were measured, on another object."""
    skin, still = (Creeping(SHAPE, 42, share, 1.0) for share in (0.05, 0.0))
    circuit, rest, curve, creep = calibrated(skin, 10, 0, 42)
    force = objects(1, SHAPE, np.random.default_rng(43))[0][0]
    times = np.append(np.arange(0.0, 10.0, 0.5), np.arange(10.0, 600.0, 10.0))
    frames = skin.standing(times, force, np.ones(times.size))
    raw, found = felt(frames, times, circuit, rest, curve, creep)
    true = felt(
        still.standing(times[:20], force, np.ones(20)), times[:20], circuit, rest, curve, creep
    )
    first = true[0].mean()
    assert raw[-5:].mean() > 1.09 * first
    assert np.abs(found[-20:].mean() / first - 1.0) < 0.03


def test_the_cells_gains_stay_when_creep_is_taken_out():
    gain = np.array([[0.9, 1.1]])
    came = as_it_comes(PressureCurve().with_gain(gain), Creep(0.05, 1.0))
    np.testing.assert_array_equal(came.gain, gain)


def test_a_cell_at_the_end_of_the_curve_gains_nothing():
    """A hard edge may weigh any more: it must not sink below what is a push, however long."""
    end = CURVE.max_force
    times = np.append(np.arange(0.0, 20.0, 0.02), np.arange(20.0, 600.0, 5.0))
    force = np.full((times.size, 2, 2), end)
    np.testing.assert_array_equal(taken_out(force, times, Creep(0.1, 1.0)), end)
    own = CURVE.with_gain([[0.5, 1.0], [1.0, 2.0]])
    standing = Standing(Creep(0.1, 1.0), own)
    for t in times:
        found = standing.update(t, end * own.gain)
    np.testing.assert_array_equal(found, end * own.gain)


def test_what_a_load_may_be_is_never_less_than_what_is_felt_and_does_not_creep_up():
    """As a touch comes nothing is taken out of the bound; a minute later it has not grown."""
    creep = Creep(0.2, 0.1)
    times = np.arange(0.0, 60.0, 0.02)
    force = reading(np.full(times.size, 2.0), times, 0.2, 0.1)
    standing, bound = Standing(creep, CURVE), []
    for t, found in zip(times, force, strict=True):
        felt = standing.update(t, found)
        bound.append(standing.most[0, 0])
        assert (bound[-1] >= felt).all() and (bound[-1] <= found).all()
    bound = np.array(bound)
    assert bound[times < 0.3] == pytest.approx(force[times < 0.3, 0, 0], rel=0.03)
    assert bound[-1] < 1.1 * bound[times < 1.0][-1] < 0.9 * force[-1, 0, 0]


def test_a_second_after_its_release_a_hard_touch_is_nothing():
    standing = Standing(Creep(0.4, 0.03), CURVE)
    for t in np.arange(0.0, 60.0, 0.02):
        standing.update(t, np.full((2, 2), 9.0))
    assert (standing.update(60.02, np.full((2, 2), 0.01)) <= 0.01).all()
    assert (standing.update(61.0, np.zeros((2, 2))) == 0.0).all()
    assert standing.update(62.1, np.full((2, 2), 2.0)) == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.35])
def test_five_presses_show_the_share(record, share):
    """Down at once, five seconds there, off for three."""
    _, _, circuit, rest = record
    skin = Creeping(SHAPE, 41, share=share, time=0.1)
    force = objects(1, SHAPE, np.random.default_rng(41))[0][0]
    times = np.arange(0.0, 42.0, 0.1)
    frames = skin.standing(times, force, (times % 8.0 > 3.0) * 1.0)
    creep = creep_of_presses(frames, times, circuit, rest, CURVE)
    assert creep.share == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("comes", [0.5, 1.0])
def test_what_is_still_being_laid_on_is_no_creep(record, comes):
    """Down within a second, as it is asked for."""
    _, _, circuit, rest = record
    skin = Creeping(SHAPE, 41, share=0.2, time=0.03)
    force = objects(1, SHAPE, np.random.default_rng(41))[0][0]
    times = np.arange(0.0, 42.0, 0.1)
    course = np.clip((times % 8.0 - 3.0) / comes, 0.0, 1.0)
    frames = skin.standing(times, force, course)
    creep = creep_of_presses(frames, times, circuit, rest, CURVE)
    assert creep.share == pytest.approx(0.2, abs=0.1)


def test_presses_of_a_hand_show_no_creep(record):
    _, _, circuit, rest = record
    skin = Creeping(SHAPE, 41, share=0.1, time=0.1)
    force = objects(1, SHAPE, np.random.default_rng(41))[0][0]
    times = np.arange(0.0, 42.0, 0.1)
    rate = np.array([0.6, -0.15, 0.1, -0.1, 0.5, 0.0])[(times // 8.0).astype(int)]
    course = (times % 8.0 > 3.0) * (1.0 + rate * (times % 8.0 - 3.0))
    frames = skin.standing(times, force, course)
    with pytest.raises(ValueError, match="do not show creep"):
        creep_of_presses(frames, times, circuit, rest, CURVE)
    with pytest.raises(ValueError, match="1 things stood"):
        creep_of_presses(frames[:80], times[:80], circuit, rest, CURVE)
