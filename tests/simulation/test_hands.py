# SPDX-License-Identifier: Apache-2.0
"""Simulated hands: the same person is the same hand; performances begin and end untouched."""

import numpy as np
import pytest

from tactile_skin.simulation.people.anything import anything
from tactile_skin.simulation.people.events import EVENTS, happen
from tactile_skin.simulation.people.hands import GESTURES, Hand, Person, perform, pressed, pulse
from tactile_skin.simulation.people.mat import Mat

MAT = Mat(16, 16, 0.018)
PERIOD = 0.04


@pytest.mark.parametrize("gesture", GESTURES)
def test_a_performance_begins_and_ends_untouched_and_is_the_persons_own(gesture):
    pictures = perform(gesture, Person(3), MAT, 5, PERIOD)
    assert pictures.shape[1:] == (16, 16) and np.isfinite(pictures).all()
    assert (pictures >= 0.0).all() and pictures.max() > 0.05
    assert not pictures[0].any() and pictures[-1].sum() < 0.1 * pictures.sum((1, 2)).max()
    assert np.array_equal(pictures, perform(gesture, Person(3), MAT, 5, PERIOD))
    assert not np.array_equal(pictures, perform(gesture, Person(4), MAT, 5, PERIOD))


@pytest.mark.parametrize("event", EVENTS)
def test_an_event_presses_and_is_the_same_again(event):
    pictures = happen(event, MAT, 2, PERIOD)
    assert np.isfinite(pictures).all() and (pictures >= 0.0).all() and pictures.max() > 0.0
    assert np.array_equal(pictures, happen(event, MAT, 2, PERIOD))


def test_contacts_of_any_kind_are_finite_differ_and_are_the_same_again():
    made = [anything(MAT, seed, PERIOD) for seed in range(30)]
    assert all(np.isfinite(pictures).all() and (pictures >= 0.0).all() for pictures in made)
    assert np.array_equal(made[4], anything(MAT, 4, PERIOD))
    peaks = [force for pictures in made if (force := pictures.sum((1, 2)).max()) > 0.0]
    assert len(peaks) > 20 and max(peaks) > 20.0 * min(peaks)


def test_a_hand_presses_with_its_force_where_it_is():
    t = np.arange(0.0, 1.0, PERIOD)
    force, at = 7.0 * pulse(t, 0.1, 0.8), np.repeat([[0.1, 0.2]], len(t), 0)
    person = Person(1)
    person.unsteady = 0.0
    pictures = pressed(MAT, Hand("tip", force, at, 0.0), person, np.random.default_rng(0), PERIOD)
    assert pictures.sum((1, 2)) == pytest.approx(force, abs=1e-9)
    rows, cols = np.indices((16, 16))
    total = pictures.sum()
    centre = (pictures * (cols + 0.5)).sum() / total, (pictures * (rows + 0.5)).sum() / total
    assert np.array(centre) * MAT.pitch == pytest.approx([0.1, 0.2], abs=0.006)


def test_a_force_that_is_held_varies_about_its_mean_as_the_person_is_unsteady():
    for period in (0.01, 0.04):
        force = np.full(round(60.0 / period), 7.0)
        hand = Hand("tip", force, np.full((len(force), 2), 0.1), 0.0)
        person = Person(1)
        held = pressed(MAT, hand, person, np.random.default_rng(0), period).sum((1, 2))
        assert held.mean() == pytest.approx(7.0, rel=0.01)
        assert held.std() == pytest.approx(7.0 * person.unsteady, rel=0.2)


def test_people_differ_in_size_strength_and_tempo():
    people = [Person(number) for number in range(60)]
    broad = {"size": 0.05, "strength": 0.25, "tempo": 0.1, "tremor": 1e-4, "unsteady": 0.004}
    for name, least in broad.items():
        assert np.std([getattr(person, name) for person in people]) > least
