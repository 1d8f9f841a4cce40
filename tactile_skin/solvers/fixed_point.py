"""The literature's fixed point g <- g * rho(g) / rho_measured, accelerated."""

from __future__ import annotations

import numpy as np

from ..circuit import network_inverse, rho_of
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
    low, high = np.log(reading.bounds)
    x = np.log(g[cells])  # (cells,)
    rho_measured = reading.rho[cells]
    adc = circuit.ratio(rho_measured)
    d_misfit = np.zeros((_HISTORY, x.size))
    d_image = np.zeros((_HISTORY, x.size))
    g = g.copy()
    last_misfit, last_image = None, None
    for step in range(steps):
        rho = rho_of(network_inverse(g))[cells]
        error = (circuit.ratio(rho) - adc) * circuit.full_scale
        if error @ error <= error.size * target**2 or reading.late():
            return g, step
        misfit = np.log(rho / rho_measured)
        image = x + misfit  # the plain step
        new = image
        if step:
            d_misfit[step % _HISTORY] = misfit - last_misfit
            d_image[step % _HISTORY] = image - last_image
            used = min(step, _HISTORY)
            rows = d_misfit if used == _HISTORY else d_misfit[1 : used + 1]
            images = d_image if used == _HISTORY else d_image[1 : used + 1]
            gram = rows @ rows.T
            gram.flat[:: used + 1] += 1e-10 * gram.trace() + 1e-30
            new = image - np.linalg.solve(gram, rows @ misfit) @ images
        last_misfit, last_image = misfit, image
        x = np.clip(new, low, high)
        g[cells] = np.exp(x)
    return g, steps
