"""An Estimate for a method that does not know its own error."""

from __future__ import annotations

import numpy as np

from ..circuit import connected_rho
from .estimate import Estimate
from .reading import Reading
from .suspect import by_reading, by_residual

_SIGNS = np.array([1.0, -1.0])[:, None, None]


def judge(
    force,
    reading: Reading,
    method: str,
    iterations=0,
    *,
    converged=True,
    slack=None,
    network=None,
) -> Estimate:
    """Spread and status from the misfit.

    How far would each cell's resistance have to move, alone, to meet its own reading
    (d u / d log R = -g u^2 rho^2 / R_ref)? An impossible reading is always suspect, a misfit only
    after a method that fits.

    Args:
        slack: times the noise by which a method that fits may miss a sound reading; None: it does
            not fit.
        network: `network_of(force, reading)` where it is known already.
    """
    circuit, curve = reading.circuit, reading.curve
    resistance, g, rho = network or network_of(force, reading)
    model = circuit.ratio(rho)
    slope = g * np.square(model * rho) * (circuit.full_scale / circuit.r_ref)  # steps per log R
    misfit = reading.misfit(model)
    shift = np.sqrt(np.square(misfit) + max(reading.noise, 1e-9) ** 2) / np.maximum(slope, 1e-9)
    # both ends at once: half the time
    ends = curve.force_at(_SIGNS * np.minimum(shift, 50.0) - np.log(resistance))
    std = 0.5 * (ends[0] - ends[1])
    message = by_reading(reading)
    if slack and not message:
        message = by_residual(reading, model, slack=slack)
    status = "suspect" if message else "ok"
    if not converged:
        status, message = "failed", f"no convergence in {iterations} steps"
    if circuit.mask is not None:
        std *= circuit.populated
    return Estimate(force, std, reading.rms(misfit), status, message, method, iterations)


def network_of(force, reading: Reading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows, cols) resistance [ohm], conductance [S] and two-terminal resistance [ohm] of cells."""
    resistance = reading.curve.resistance(force)
    g = 1.0 / resistance
    if reading.circuit.mask is not None:
        g *= reading.circuit.populated
    return resistance, g, connected_rho(g)
