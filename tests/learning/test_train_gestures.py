# SPDX-License-Identifier: Apache-2.0
"""A recogniser learns from a few takes, and names those of people that it has not seen."""

import numpy as np
import pytest

from tactile_skin.learning.gestures import GLANCES, glances, left_out, table_of, train
from tactile_skin.learning.hands import simulated
from tactile_skin.touch.episode import FEATURES
from tactile_skin.touch.model import OTHER
from tactile_skin.touch.take import Take

pytest.importorskip("sklearn")
KNOWN = ("pat", "poke", "stroke", "tickle")
# 10 % and 90 % of a real person's takes (person 0 of benchmarks/gestures/recorded.py)
REAL = {  # most force [N], area of all cells that were touched [m^2]
    "hold": ((19.2, 78.2), (0.027, 0.060)),
    "pat": ((3.8, 21.2), (0.007, 0.013)),
    "poke": ((2.5, 8.6), (0.004, 0.006)),
    "slap": ((18.6, 106.0), (0.018, 0.033)),
    "stroke": ((10.0, 52.7), (0.033, 0.083)),
    "tickle": ((1.0, 6.2), (0.007, 0.051)),
}


@pytest.fixture(scope="module")
def table():
    return table_of(list(simulated(range(12), 3, 12, ("lean", "wall"), KNOWN)))


@pytest.mark.ci
def test_people_that_it_has_not_seen_are_understood(table):
    shares, classes = left_out(table, trees=30), np.unique(table.label)
    right = classes[shares.argmax(1)] == table.label
    said, gesture = classes[shares.argmax(1)], table.label != OTHER
    made, event = table.end & gesture, table.end & ~gesture
    assert right[made].mean() > 0.8 and right[event].mean() > 0.8
    assert (~right & (said != OTHER))[made].mean() < 0.05  # one gesture taken for another
    assert right[~table.end].mean() > 0.6  # some glances come before a gesture is itself


@pytest.mark.ci
def test_probabilities_are_about_as_often_right(table):
    classes = np.unique(table.label)
    model = train(table, {}, trees=30)
    from tactile_skin.touch.model import sharpened

    sure = sharpened(left_out(table, trees=30), model.sharpness)
    right = classes[sure.argmax(1)] == table.label
    for low, high in ((0.5, 0.8), (0.8, 1.01)):
        some = (sure.max(1) >= low) & (sure.max(1) < high)
        weight = table.weight[some]
        as_sure = np.average(sure.max(1)[some], weights=weight)
        assert np.average(right[some], weights=weight) == pytest.approx(as_sure, abs=0.12)


def test_glances_are_those_of_a_gesture_that_goes_on():
    spot = np.zeros((30, 8, 8))
    spot[5:, 3, 3] = 1.0
    (seen,) = glances(Take("hold", "me", spot, 0.04, 0.018))
    early, last = seen.early, seen.last
    assert len(early) == sum(t <= 25 * 0.04 for t in GLANCES)
    durations = np.exp([row[FEATURES.index("duration")] for row in early])
    assert durations == pytest.approx(GLANCES[: len(early)], abs=0.03)
    assert last[FEATURES.index("silence")] == pytest.approx(0.4)


@pytest.mark.ci
def test_one_person_among_many_events_is_left_out_by_takes(table):
    mine = np.isin(table.person, ("simulated 0",)) | (table.label == OTHER)
    shares = left_out(type(table)(*(part[mine] for part in table)), trees=5)
    assert shares.sum(1) == pytest.approx(1.0)


def test_simulated_hands_are_as_hard_and_as_wide_as_real_ones():
    """In the median, but for a third."""
    table = table_of(list(simulated(range(60, 66), 1, 0, gestures=tuple(REAL))))
    for gesture, between in REAL.items():
        rows = table.features[table.end & (table.label == gesture)]
        for name, (low, high) in zip(("force_max", "swept_area"), between, strict=True):
            usual = np.exp(np.median(rows[:, FEATURES.index(name)]))
            assert low / 1.5 < usual < high * 1.5, (gesture, name)


def test_a_take_without_a_touch_is_left_out():
    assert glances(Take("hold", "me", np.zeros((9, 8, 8)), 0.04, 0.018)) == []
    assert len(table_of([Take("hold", "me", np.zeros((9, 8, 8)), 0.04, 0.018)]).label) == 0
