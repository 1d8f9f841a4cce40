# SPDX-License-Identifier: Apache-2.0
"""A simulated fabric does in time what recordings of real ones show."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation.living import Habits, Living
from tactile_skin.simulation.matrix import Fabric

SHAPE = 2, 2
FABRIC = Fabric.resting(Circuit(*SHAPE), PressureCurve(), 0)
LOAD = np.full(SHAPE, 2.0)
NONE = np.zeros(SHAPE)


def course(habits, loads, seed=0):
    """(n, 2, 2) factors of (t, force) in turn."""
    living = Living(habits, SHAPE, np.random.default_rng(seed))
    return np.array([living.factor(t, force, FABRIC) for t, force in loads])


def test_the_defaults_are_nothing():
    loads = [(0.0, NONE), (1.0, LOAD), (10.0, LOAD), (11.0, NONE), (12.0, LOAD)]
    np.testing.assert_allclose(course(Habits(), loads), 1.0)


def test_creep_turns_after_a_second_and_a_half():
    habits = Habits(creep=0.28, late=0.12 / 0.28)
    found = course(habits, [(0.0, LOAD), (0.15, LOAD), (1.5, LOAD), (15.0, LOAD), (150.0, LOAD)])
    grows = np.diff(found[:, 0, 0])
    assert grows[1] == pytest.approx(0.28, abs=0.03)
    assert grows[2:] == pytest.approx(0.12, abs=0.01)


def test_rest_undershoots_after_a_release_and_returns():
    found = course(Habits(undershoot=0.3), [(0.0, LOAD), (1.0, NONE), (1.5, NONE), (7.0, NONE)])
    assert found[1:, 0, 0] == pytest.approx([0.7, 0.77, 0.985], abs=0.01)


def test_an_unloaded_cell_conducts_more():
    found = course(Habits(hysteresis=0.1), [(0.0, LOAD), (1.0, 2.0 * LOAD), (2.0, LOAD)])
    assert found[2, 0, 0] == pytest.approx(1.05, abs=0.005)


def test_days_and_places_differ():
    drift = [course(Habits(drift=0.3), [(0.0, LOAD)], k)[0, 0, 0] for k in range(200)]
    assert np.log(drift).std() == pytest.approx(0.3, abs=0.05)
    place = [course(Habits(place=1.5), [(0.0, LOAD)], k)[0, 0, 0] for k in range(50)]
    assert 1.3 < max(place) <= 1.5 and 1 / 1.5 <= min(place) < 0.75
