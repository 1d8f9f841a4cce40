# SPDX-License-Identifier: Apache-2.0
"""Takes of simulated people, on mats of several sizes, and of what is no gesture."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from ..simulation.people.anything import anything
from ..simulation.people.events import EVENTS, happen
from ..simulation.people.hands import GESTURES, Person, perform
from ..simulation.people.mat import Mat
from ..touch.episode import LIMIT
from ..touch.model import OTHER
from ..touch.take import Take

MATS = (Mat(16, 16, 0.018), Mat(20, 12, 0.014), Mat(16, 24, 0.025))
PERIODS = (0.04, 0.08, 0.08)  # s between pictures: of the recogniser, and of a slow board
PEOPLE = 40
REPETITIONS = 3
HAPPENINGS = 120  # of each kind of event
_COVERS = (0.0, 0.018)  # m, standard deviations by which covers spread pressure
ANYTHING = 8  # contacts of any kind, times as many as events of one kind


def simulated(
    people: range = range(PEOPLE),
    repetitions: int = REPETITIONS,
    happenings: int = HAPPENINGS,
    events: tuple[str, ...] = tuple(EVENTS),
    gestures: tuple[str, ...] = tuple(GESTURES),
) -> Iterator[Take]:
    """Yield takes of simulated people, one after the other, then of events that are no gesture.

    Args:
        people: their numbers; the same one is the same person.
        repetitions: of each gesture by each person.
        happenings: of each event; of contacts of any kind ANYTHING times as many.
    """
    for number in people:
        person = Person(number)
        for gesture, repetition in product(gestures, range(repetitions)):
            seed = number * 10_000 + list(GESTURES).index(gesture) * 100 + repetition
            makes: Callable = functools.partial(perform, gesture, person)
            yield _take(gesture, f"simulated {number}", makes, seed)
    times = dict.fromkeys(events, happenings) | {"anything": ANYTHING * happenings}
    for kind, n in times.items():
        makes = anything if kind == "anything" else functools.partial(happen, kind)
        for number in range(people.start * 10_000, people.start * 10_000 + n):
            yield _take(OTHER, f"{kind} {number}", makes, number)


def _take(label: str, person: str, makes: Callable, seed: int) -> Take:
    """Return what is made on a mat under a cover, read at some rate: the seed picks all three."""
    from scipy.ndimage import gaussian_filter  # here: most simulated boards feel no hands

    mat, period = MATS[seed % 3], PERIODS[(seed // 3) % 3]
    spread = np.random.default_rng([seed, 13]).uniform(*_COVERS) / mat.pitch
    pictures = gaussian_filter(makes(mat, seed, period), (0.0, spread, spread))
    return Take(label, person, np.where(pictures > LIMIT, pictures, 0.0), period, mat.pitch)
