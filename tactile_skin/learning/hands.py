# SPDX-License-Identifier: Apache-2.0
"""Takes of simulated people, on mats of several sizes, and of what is no gesture."""

from __future__ import annotations

import functools
from collections.abc import Iterator
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
PERIODS = (0.04, 0.04, 0.08)  # s between pictures: of the recogniser, and of a slow board
PEOPLE = 40
REPETITIONS = 4
HAPPENINGS = 240  # of each kind of event
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
            mat, period = MATS[seed % 3], PERIODS[(seed // 3) % 3]
            pictures = perform(gesture, person, mat, seed, period)
            yield _take(gesture, f"simulated {number}", pictures, period, mat)
    times = dict.fromkeys(events, happenings) | {"anything": ANYTHING * happenings}
    first = people.start * 10_000
    for kind, n in times.items():
        makes = anything if kind == "anything" else functools.partial(happen, kind)
        for number in range(first, first + n):
            mat, period = MATS[number % 3], PERIODS[(number // 3) % 3]
            yield _take(OTHER, f"{kind} {number}", makes(mat, number, period), period, mat)


def _take(label: str, person: str, pictures: np.ndarray, period: float, mat: Mat) -> Take:
    felt = np.where(pictures > LIMIT, pictures, 0.0)
    return Take(label, person, felt, period, mat.pitch)
