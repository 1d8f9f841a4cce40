# SPDX-License-Identifier: Apache-2.0
"""Model no more than the frame needs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from .estimate import Estimate, where_unread
from .fixed_point import fixed_point
from .map import map_estimate
from .newton import EXACT, newton
from .reading import Reading, check_reading, rest_reading, robust_std
from .suspect import BEYOND, by_residual, estimate_from_force


def auto(reading: Reading, start: Estimate | None = None, hurry: bool = False) -> Estimate:
    """Nothing where nothing touches, `newton` for exact readings that it explains, else `map`.

    In a hurry, `fixed_point` stands for both: it takes a tenth of the time of a fit under a palm,
    errs by twice as much, and says nothing of the circuit. Where two pictures may explain a frame,
    only `map` says so.
    """
    circuit, curve = reading.circuit, reading.curve
    rest = rest_reading(circuit, curve)
    quiet = reading
    if not reading.noise_given:
        quiet = reading.with_noise(robust_std(np.abs(reading.misfit(rest))))
    if (idle := _idle_estimate(quiet, rest)) is not None:
        return idle
    if reading.may_fit_two:
        return map_estimate(reading, start)
    if hurry and reading.all_cells_read:
        return fixed_point(reading)
    if reading.noise == 0.0 and reading.all_cells_read:
        estimate = newton(reading, start)
        if estimate.status == "ok":
            return estimate
    return map_estimate(reading, start)


def _idle_estimate(reading: Reading, rest: np.ndarray) -> Estimate | None:
    """Return the estimate of an untouched skin if this is one, else None."""
    misfit = reading.misfit(rest)
    most = max(BEYOND * reading.noise, EXACT * reading.circuit.full_scale)
    if max(misfit.max(), -misfit.min()) > most or (reading.noise and by_residual(reading, rest)):
        return None
    read = (reading.informative | ~reading.circuit.populated).tobytes()
    idle = _idle(reading.circuit, reading.curve, reading.noise, read)
    return replace(idle, residual=reading.rms(misfit))


@lru_cache(maxsize=16)
def _idle(circuit, curve, noise: float, read: bytes) -> Estimate:
    """Return the estimate of an untouched skin of which these readings, (rows, cols) bool, came."""
    came = np.frombuffer(read, bool).reshape(circuit.shape)
    adc = np.where(came, rest_reading(circuit, curve), np.nan)
    reading = check_reading(adc, circuit, curve, noise=noise, missing=True)
    idle = estimate_from_force(np.zeros(circuit.shape), reading, "rest")
    if reading.all_cells_read:
        return idle
    g = reading.bounds[0] * circuit.populated
    model = reading.linearised(g, reading.fitted_noise)
    return replace(idle, std=where_unread(reading, model, idle.force, idle.std))
