"""The literature's fixed point g <- g * rho(g) / rho_measured, accelerated."""

from __future__ import annotations

import numpy as np

from ..physics import kernel, numpy_kernel, readouts
from .estimate import Estimate
from .reading import Reading
from .suspect import estimate_from_force

MAX_STEPS = 60
_TARGET = 0.25  # ADC steps RMS at which to stop: below rounding to whole steps
BOUND = 1.0 + 1e-9  # factor within which a conductance is on a bound, but for rounding


def fixed_point(reading: Reading) -> Estimate:
    """The fixed point until the reading is met to the ADC's rounding."""
    reading.need_all_cells("fixed_point")
    if reading.circuit.has_closed_form:
        g, iterations = closed_form(reading), 0
    else:
        g, iterations = iterate(reading, first_guess(reading), MAX_STEPS, _TARGET)
    with np.errstate(divide="ignore"):
        force = reading.curve.force(1.0 / g) * reading.circuit.populated
    return estimate_from_force(force, reading, "fixed_point", iterations)


def first_guess(reading: Reading) -> np.ndarray:
    """Conductance [S] whose products with the measured rho are all alike.

    Floating, they keep Foster's sum: that of g*rho is rows + cols - 1. Otherwise they are 1: equal
    cells send no current from one sense line to another.
    """
    if reading.circuit.readout == "grounded":
        return _within_bounds(reading)
    populated, share = reading.circuit.populated, 1.0
    if reading.circuit.readout == "floating":
        share = (sum(reading.circuit.shape) - 1) / np.count_nonzero(populated)
    guess = np.where(reading.known, share / reading.rho, 0.0)
    return populated * np.clip(guess, *reading.bounds)


def _within_bounds(reading: Reading) -> np.ndarray:
    """Conductance [S] of a grounded matrix by ideal drivers; cells are held within their bounds.

    With v = adc (r_ref + r_par) / r_ref, a sense line's cells have g = v G / (1 - sum v), where G
    is what leads from it to ground: its divider, and the cells that are held.
    """
    circuit, (low, high) = reading.circuit, reading.bounds
    divider, axis = circuit.r_ref + circuit.r_par, circuit.sense_axis
    v = reading.adc * (divider / circuit.r_ref)
    free, held, ground = circuit.populated, 0.0, 1.0 / divider
    while True:  # each round holds more cells
        left = np.maximum(1.0 - (v * free).sum(axis, keepdims=True), readouts.LEAST_SCALE)
        g = np.where(free, v * ground / left, held)
        inside = np.minimum(np.maximum(g, low), high)
        out = free & (np.abs(inside - g) > (BOUND - 1.0) * g)
        if not np.count_nonzero(out):
            return g
        free, held = free & ~out, np.where(out, inside, held)
        ground = 1.0 / divider + held.sum(axis, keepdims=True)


def closed_form(reading: Reading) -> np.ndarray:
    """Conductance [S] of the grounded readout, whose bounds all of a sense line share.

    Hard loads leave nothing but noise of 1 - sum v, and cells beyond their end. With T for all that
    leads to the line, from which n cells at g = v T are not at rest, the largest is then put on its
    end, T = (n end + G) / (1 + sum (max v - v)), and all n readings miss alike.
    """
    (low, high), circuit, g = reading.bounds, reading.circuit, first_guess(reading)
    axis = circuit.sense_axis
    at_end = g >= high
    if not np.count_nonzero(at_end):
        return g
    beyond = at_end.any(axis, keepdims=True) & circuit.populated
    divider = circuit.r_ref + circuit.r_par
    free, v = g > low, reading.adc * (divider / circuit.r_ref)
    ground = 1.0 / divider + (g * ~free).sum(axis, keepdims=True)
    n, used = free.sum(axis, keepdims=True), v * free
    left = 1.0 - used.sum(axis, keepdims=True)
    end = n * high.min(axis, keepdims=True) + ground
    leads = end / (left + n * used.max(axis, keepdims=True))
    spread = v * leads + (left * leads - ground) / np.maximum(n, 1)
    return np.where(beyond & free, np.minimum(np.maximum(spread, low), high), g)


def last_guess(reading: Reading, start: Estimate) -> np.ndarray:
    """Conductance [S] of an earlier estimate."""
    return reading.circuit.populated / reading.curve.resistance(start.force)


def fill(reading: Reading, g: np.ndarray) -> np.ndarray:
    """Start cells whose own reading is missing from the mean of their read neighbours' log g.

    From rest, the prior would take them for holes in a touch.
    """
    unread = reading.circuit.populated & ~reading.known & ~reading.capped
    if not unread.any():
        return g
    read = reading.circuit.populated & ~unread
    count = np.pad(read.astype(float), 1)
    total = np.pad(np.where(read, np.log(np.where(read, g, 1.0)), 0.0), 1)
    count, total = (np.lib.stride_tricks.sliding_window_view(a, (3, 3)) for a in (count, total))
    mean = total.sum((2, 3)) / np.maximum(count.sum((2, 3)), 1.0)
    return np.where(unread & (count.sum((2, 3)) > 0), np.exp(mean), g)


def iterate(reading: Reading, g, steps: int, target: float) -> tuple[np.ndarray, int]:
    """`kernel.fixed_point` over the cells that were read, until the RMS misfit is `target` steps.

    Args:
        target: [ADC steps].

    Returns:
        g (rows, cols) [S], within the curve's bounds, and the steps taken.
    """
    circuit = reading.circuit
    if circuit.has_closed_form:  # nothing to iterate: g is `closed_form`, or near it
        return g, 0
    cells = np.flatnonzero(circuit.populated & reading.known).astype(np.int32)  # others stay
    low, high = (np.log(bound.ravel()[cells]) for bound in reading.bounds)
    rho, goal = reading.rho.ravel()[cells], cells.size * (target / circuit.full_scale) ** 2
    given = {"goal": goal, "steps": steps, "deadline": reading.deadline}
    if circuit.readout == "floating":
        given |= {"r_ref": circuit.r_ref, "r_par": circuit.r_par}
        return kernel.fixed_point(g, cells, rho, low, high, **given)

    def read(g):
        return reading.rho_of(readouts.solve(circuit, g))

    scale, offset = reading.apparent  # of a divider whose supply is not 1
    r_ref = np.broadcast_to(circuit.r_ref * scale, circuit.shape).ravel()[cells]
    given |= {"r_ref": r_ref, "r_par": offset - r_ref, "read": read}
    return numpy_kernel.fixed_point(g, cells, rho, low, high, **given)
