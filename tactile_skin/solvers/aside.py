# SPDX-License-Identifier: Apache-2.0
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

from .estimate import Estimate
from .fit import Fit
from .prior import force_of
from .reading import NEAR_REST, Reading
from .suspect import model_variance, saturation

# Share of the readings of a frame that carry a value. Chosen on the first halves of recordings of
# real insoles, scored on their second halves (benchmarks/accuracy/boards.py).
_MOST = 0.1
# Share of a column's readings, from one of its ends on, that miss what a touch that moves while the
# rows are read in turn has left: at least half, where that errs above 30 g (16 x 16 and 8 x 12,
# seeds 11 and 12); the insoles' frames have at most 0.2.
_LEFT = 0.45
_LINE = 0.5  # of the readings of a line, from which on its contact is bad throughout
_LIGHT = 0.18  # share of all force that may then press on it
_OPEN = 0.9  # of its readings that may be set aside at all
_OFF = 4.0  # standard deviations below the model
_CHI = 2.2  # of a reading that carries a value, on average, without those that are set aside
_WORST = 0.5  # of the worst one's, from which on others are set aside in the same round
_ROUNDS = 6

Refit = Callable[[Reading, np.ndarray], Fit]


def without_bad_contacts(reading: Reading, fit: Refit, g: np.ndarray) -> Estimate | None:
    """Return the estimate of a suspect frame without readings that contradict the others.

    None: there are none, or too many, or the others are not explained either; or the input is
    saturated: readings beside a touch that is cut off seem too low, and are not.

    Args:
        fit: of a reading, from a guess (rows, cols) [S].
        g: (rows, cols) that explains the frame best [S].
    """
    if saturation(reading):
        return None
    usable, values = reading.known | reading.capped, np.count_nonzero(reading.known)
    aside = np.zeros(reading.adc.shape, bool)
    for _ in range(_ROUNDS):
        found = usable & _impossible(reading, g, aside)
        if (found == aside).all() or np.count_nonzero(found) > _MOST * values:
            return None
        aside = found
        left = replace(
            reading,
            known=reading.known & ~aside,
            capped=reading.capped & ~aside,
            adc=np.where(aside, 0.0, reading.adc),
        )
        refit = fit(left, g)
        g = refit.g
        if refit.status == "ok":
            force = force_of(left, g)[0]
            bad = any(_bad_line(aside, usable, force, axis) for axis in (0, 1))
            # of readings below a threshold most say nothing, and would make up for a misfit
            chi = np.square(_misfit(left, g))[left.known].mean()
            bad = bad or _moved(aside, usable) or not chi <= _CHI
            return None if bad else replace(refit.estimate(), aside=aside)
        if refit.status == "failed" or reading.late():
            return None
    return None


def _bad_line(aside: np.ndarray, usable: np.ndarray, force: np.ndarray, axis: int) -> bool:
    """Whether a line is open, or one whose contact is bad carries what presses."""
    share = aside.sum(axis) / np.maximum(usable.sum(axis), 1)
    on_bad = force.sum(axis)[share > _LINE].sum()
    return bool((share > _OPEN).any() or on_bad > _LIGHT * force.sum())


def _moved(aside: np.ndarray, usable: np.ndarray) -> bool:
    """Whether a touch moved while the rows were read, one after the other.

    Then the first or the last readings of a column miss what was there at the others.
    """
    least = _LEFT * np.maximum(usable.sum(0), 1)
    for missed, read in ((aside, usable), (aside[::-1], usable[::-1])):
        run = np.logical_and.accumulate(missed | ~read) & read
        if (run.sum(0) >= least).any():
            return True
    return False


def _impossible(reading: Reading, g: np.ndarray, aside: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: readings that lie below what the others let through.

    Those of cells at rest, and of them the worst: a reading that is far off draws the fit away
    from others that are sound. One that was set aside, and agrees with the fit without it, is not.
    """
    off = -_misfit(reading, g)
    new = np.where((g <= NEAR_REST * reading.bounds[0]) & ~aside, off, 0.0)
    return (aside & (off > _OFF)) | (new > max(_OFF, _WORST * new.max()))


def _misfit(reading: Reading, g: np.ndarray) -> np.ndarray:
    """(rows, cols) reading minus model of cells g [S], in standard deviations."""
    variance = np.square(reading.fitted_noise) + model_variance(reading)
    return reading.misfit(reading.model(g)) / np.sqrt(variance)
