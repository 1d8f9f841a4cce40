"""An Estimate for a method that does not know its own error."""

from __future__ import annotations

import numpy as np

from ..circuit import two_terminal_resistance
from .estimate import Estimate
from .reading import Reading
from .suspect import by_reading, by_residual


def judge(
    force, reading: Reading, method: str, iterations=0, *, converged=True, slack=None, rho=None
) -> Estimate:
    """Spread and status from the misfit.

    How far would each cell's resistance have to move, alone, to meet its own reading
    (d u / d log R = -g u^2 rho^2 / R_ref)? An impossible reading is always suspect, a misfit only
    after a method that fits.

    Args:
        slack: times the noise by which a method that fits may miss a sound reading; None: it does
            not fit.
        rho: (rows, cols) two-terminal resistances [ohm] of `force` where they are known already.
    """
    circuit, curve = reading.circuit, reading.curve
    resistance = curve.resistance(force)
    g = np.where(circuit.populated, 1.0 / resistance, 0.0)
    if rho is None:
        rho = two_terminal_resistance(g)
    model = circuit.ratio(rho)
    slope = g * np.square(model * rho) / circuit.r_ref * circuit.full_scale  # steps per log R
    misfit = reading.misfit(model)
    shift = np.sqrt(misfit**2 + max(reading.noise, 1e-9) ** 2) / np.maximum(slope, 1e-9)
    factor = np.exp(np.minimum(shift, 50.0))
    ends = curve.force(resistance * np.stack([1.0 / factor, factor]))  # both at once: half the time
    std = 0.5 * (ends[0] - ends[1])
    message = by_reading(reading)
    if slack and not message:
        message = by_residual(reading, model, slack=slack)
    status = "suspect" if message else "ok"
    if not converged:
        status, message = "failed", f"no convergence in {iterations} steps"
    std *= circuit.populated
    return Estimate(force, std, reading.residual(model), status, message, method, iterations)
