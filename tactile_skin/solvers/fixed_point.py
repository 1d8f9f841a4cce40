"""The literature's fixed point g <- g * rho(g) / rho_measured, accelerated."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from ..circuit import compiled, connected_rho
from .estimate import Estimate
from .judge import judge
from .reading import Reading

STEPS = 60
_HISTORY = 6  # earlier steps that the acceleration combines


def fixed_point(reading: Reading, **_) -> Estimate:
    """The fixed point until the reading is met to the ADC's rounding."""
    reading.need_whole("fixed_point")
    g, iterations = iterate(reading, first_guess(reading), STEPS, 0.25)
    with np.errstate(divide="ignore"):
        force = reading.curve.force(1.0 / g) * reading.circuit.populated
    return judge(force, reading, "fixed_point", iterations)


def first_guess(reading: Reading) -> np.ndarray:
    """Conductance [S] whose products with the measured rho are all alike and keep Foster's sum.

    Foster's theorem: the sum of g*rho is rows + cols - 1.
    """
    populated = reading.circuit.populated
    share = (sum(reading.circuit.shape) - 1) / np.count_nonzero(populated)
    guess = np.where(reading.known, share / reading.rho, 0.0)
    return populated * np.clip(guess, *reading.bounds)


def last_guess(reading: Reading, start: Estimate) -> np.ndarray:
    """Conductance [S] of an earlier estimate."""
    return reading.circuit.populated / reading.curve.resistance(start.force)


def iterate(reading: Reading, g, steps: int, target: float) -> tuple[np.ndarray, int]:
    """Anderson-accelerated fixed point in log g, until the RMS misfit is `target` ADC steps.

    Plain steps converge linearly, and slowly under a broad load. Each accelerated step combines
    the last few such that their misfits of log rho cancel best (Walker & Ni 2011).

    Returns:
        g (rows, cols) [S], within the curve's bounds, and the steps taken.
    """
    circuit = reading.circuit
    cells = circuit.populated & reading.known  # the others stay at rest
    cells = np.flatnonzero(cells)
    low, high = (np.log(bound.ravel()[cells]) for bound in reading.bounds)
    rho_measured = reading.rho.ravel()[cells]
    goal = cells.size * (target / circuit.full_scale) ** 2
    if fast := compiled(circuit.shape):
        there, at = g.copy(), cells.astype(np.int32)
        divider = circuit.r_ref, circuit.r_par
        taken = fast.iterate(
            *circuit.shape, there, at, rho_measured, low, high, *divider, goal, steps
        )
        if taken >= 0:
            return there, taken
    g = g.copy()
    flat = g.reshape(-1)
    x = np.log(flat[cells])  # (cells,)
    adc = circuit.ratio(rho_measured)
    d_misfit = np.empty((_HISTORY, x.size))
    d_image = np.empty((_HISTORY, x.size))
    last_misfit, last_image = None, None
    for step in range(steps):
        rho = connected_rho(g).ravel()[cells]
        error = circuit.ratio(rho) - adc
        if error @ error <= goal or reading.late():
            return g, step
        misfit = np.log(rho / rho_measured)
        image = x + misfit  # the plain step
        new = image
        if step:
            slot = (step - 1) % _HISTORY
            np.subtract(misfit, last_misfit, out=d_misfit[slot])
            np.subtract(image, last_image, out=d_image[slot])
            used = min(step, _HISTORY)
            gram = d_misfit[:used] @ d_misfit[:used].T
            gram.flat[:: used + 1] += 1e-10 * gram.trace() + 1e-30
            share = lapack.dposv(gram, d_misfit[:used] @ misfit)[1]
            new = image - share @ d_image[:used]
        last_misfit, last_image = misfit, image
        x = np.minimum(np.maximum(new, low), high)
        flat[cells] = np.exp(x)
    return g, steps
