# SPDX-License-Identifier: Apache-2.0
"""The literature's fixed point g <- g * rho(g) / rho_measured, accelerated; the naive method."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import correlate

from ..physics import kernel, readouts
from ..physics.arrays import frozen
from ..physics.curve import PressureCurve
from .estimate import Estimate
from .reading import Reading
from .suspect import estimate_from_force

MAX_STEPS = 60
START_STEPS = 10  # by which other methods begin: a step costs a sixth of one of theirs, or less
# ADC steps RMS at which to stop, or by which a closed form may miss a driven line: below rounding.
_TARGET = 0.25


def naive(reading: Reading) -> Estimate:
    """Return the paper's naive picture (section V): each reading is taken for its own cell's.

    It sees ghosts where parallel paths cross.
    """
    reading.need_all_cells("naive")
    circuit = reading.circuit
    force = reading.curve.force(circuit.two_terminal(reading.adc)) * circuit.populated
    return estimate_from_force(force, reading, "naive")


def fixed_point(reading: Reading) -> Estimate:
    """Iterate the fixed point until the reading is met to the ADC's rounding."""
    reading.need_all_cells("fixed_point")
    if (found := closed_form(reading, _TARGET / reading.circuit.full_scale)) is not None:
        g, iterations, done = found
    else:
        g, iterations = iterate(reading, first_guess(reading), MAX_STEPS, _TARGET)
        done = iterations == MAX_STEPS
    cut_off = not done and reading.late() and reading.residual(reading.model(g)) > _TARGET
    with np.errstate(divide="ignore"):
        force = reading.curve.force(1.0 / g) * reading.circuit.populated
    return estimate_from_force(force, reading, "fixed_point", iterations, converged=not cut_off)


def first_guess(reading: Reading) -> np.ndarray:
    """Conductance [S] whose products with the measured rho are all alike: `Readout.guess`."""
    circuit, adc = reading.circuit, reading.adc + reading.supposed
    return circuit.readout_class.guess(circuit, adc, reading.rho, reading.bounds)


def closed_form(reading: Reading, target: float) -> tuple[np.ndarray, int, bool] | None:
    """`Readout.closed_form` of the reading."""
    circuit, of_reading = reading.circuit, (reading.adc, reading.rho, reading.bounds)
    return circuit.readout_class.closed_form(circuit, *of_reading, target, reading.late)


def last_guess(reading: Reading, start: Estimate) -> np.ndarray:
    """Conductance [S] of an earlier estimate; read-only."""
    g = _conductance(start, reading.curve)
    return g if reading.circuit.mask is None else g * reading.circuit.mask


@lru_cache(maxsize=16)
def _conductance(estimate: Estimate, curve: PressureCurve) -> np.ndarray:
    """(rows, cols) [S]; kept, as a frame asks for its own and the last one's a few times."""
    return frozen(1.0 / curve.resistance(estimate.force))


def fill(reading: Reading, g: np.ndarray) -> np.ndarray:
    """Start cells whose own reading is missing from the mean of their read neighbours' log g.

    From rest, the prior would take them for holes in a touch.
    """
    unread = reading.circuit.populated & ~reading.informative
    if not unread.any():
        return g
    read = reading.circuit.populated & ~unread
    log = np.where(read, np.log(np.where(read, g, 1.0)), 0.0)
    count, total = correlate(np.array([read, log]), np.ones((1, 3, 3)), mode="constant")
    return np.where(unread & (count > 0.0), np.exp(total / np.maximum(count, 1.0)), g)


def iterate(reading: Reading, g, steps: int, target: float) -> tuple[np.ndarray, int]:
    """`kernel.fixed_point` over the cells that were read, until the RMS misfit is `target` steps.

    Args:
        target: [ADC steps].

    Returns:
        g (rows, cols) [S], within the curve's bounds, and the steps taken.
    """
    circuit = reading.circuit
    # nothing to iterate: g is the closed form, or near it
    if circuit.has_ideal_drivers or not circuit.has_cross_talk:
        return g, 0
    cells = np.flatnonzero(circuit.populated & reading.known).astype(np.int32)  # others stay
    low, high = (np.log(bound.ravel()[cells]) for bound in reading.bounds)
    rho, goal = reading.rho.ravel()[cells], cells.size * (target / circuit.full_scale) ** 2
    given: dict[str, Any] = {"goal": goal, "steps": steps, "deadline": reading.deadline}
    if circuit.readout_class.two_terminal:
        given |= {"r_ref": circuit.r_ref, "r_par": circuit.r_par}
        return kernel.fixed_point(g, cells, rho, low, high, **given)

    def read(g):
        return reading.rho_of(readouts.solve(circuit, g))

    scale, offset = reading.apparent  # of a divider whose supply is not 1
    r_ref = np.broadcast_to(circuit.r_ref * scale, circuit.shape).ravel()[cells]
    given |= {"r_ref": r_ref, "r_par": offset - r_ref, "read": read}
    return kernel.fixed_point(g, cells, rho, low, high, **given)
