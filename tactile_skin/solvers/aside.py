"""Readings that no skin can give beside the others: set aside, a few, where a contact was bad.

Whatever its cell does, a reading is at least what the paths through the other cells let through.
One that lies below that was taken while a contact of its line was bad, the multiplexer had not
settled, or the recorder lost it. It says nothing about the skin, and the others determine the
picture without it. A line that is open or leads badly does not pass for that: too many of its
readings miss, or what presses on it is read by it alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..physics import laplacian
from .estimate import Estimate
from .fixed_point import last_guess
from .reading import Reading
from .suspect import model_variance

_MOST = 0.08  # of the readings of a frame that carry a value
# Of the readings of a line from which on its contact is bad throughout, share of the whole force
# that may then press on it, and of its readings that may be set aside at all.
_LINE, _LIGHT, _OPEN = 0.5, 0.08, 0.9
_OFF = 4.0  # standard deviations below the model
_AT_REST = 1.05  # times its conductance at rest: such a cell cannot explain less
_ROUNDS = 3

Fit = Callable[[Reading, np.ndarray], Estimate]


def without_bad_contacts(reading: Reading, fit: Fit, estimate: Estimate) -> Estimate | None:
    """The estimate of a suspect frame without the readings that are impossible beside the others.

    None: there are none, or too many, or the others are not explained either.
    """
    aside = np.zeros(reading.adc.shape, bool)
    usable, values = reading.known | reading.capped, np.count_nonzero(reading.known)
    for _ in range(_ROUNDS):
        found = usable & ~aside & _impossible(reading, estimate)
        aside |= found
        if not found.any() or np.count_nonzero(aside) > _MOST * values:
            return None
        left = replace(
            reading,
            known=reading.known & ~aside,
            capped=reading.capped & ~aside,
            adc=np.where(aside, 0.0, reading.adc),
        )
        estimate = fit(left, last_guess(left, estimate))
        if estimate.status == "ok":
            bad = any(_bad_line(aside, usable, estimate.force, axis) for axis in (0, 1))
            return None if bad else replace(estimate, aside=aside)
        if estimate.status == "failed" or reading.late():
            return None
    return None


def _bad_line(aside: np.ndarray, usable: np.ndarray, force: np.ndarray, axis: int) -> bool:
    """Whether a line is open, or one whose contact is bad carries what presses."""
    share = aside.sum(axis) / np.maximum(usable.sum(axis), 1)
    on_bad = force.sum(axis)[share > _LINE].sum()
    return bool((share > _OPEN).any() or on_bad > _LIGHT * force.sum())


def _impossible(reading: Reading, estimate: Estimate) -> np.ndarray:
    """(rows, cols) bool: readings of cells at rest that lie below what the others let through."""
    g = last_guess(reading, estimate)
    at_rest = g <= _AT_REST * reading.bounds[0]
    misfit = reading.misfit(reading.circuit.ratio(laplacian.solve(g).rho))
    noise = np.sqrt(np.square(reading.spread) + model_variance(reading))
    return at_rest & (misfit < -_OFF * noise)
