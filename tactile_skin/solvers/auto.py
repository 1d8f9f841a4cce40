"""Model no more than the frame needs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from .estimate import Estimate
from .map import map_estimate
from .newton import newton
from .reading import Reading, rest_reading, spread_of
from .suspect import by_residual, judge

_IDLE_PEAK = 4.5  # standard deviations: one reading in 150,000 exceeds it by chance
_EXACTLY_IDLE = 1e-9  # ADC steps, of an exact reading


def auto(reading: Reading, start: Estimate | None = None, prior=None) -> Estimate:
    """Nothing where nothing touches, `newton` for exact readings that it explains, else `map`.

    `map` sizes itself: its unknowns are the touched cells alone, and it stops at the noise.
    """
    circuit, curve = reading.circuit, reading.curve
    rest = rest_reading(circuit, curve)
    if not reading.given:
        misfit = reading.misfit(rest)
        quiet = reading.with_noise(spread_of(np.abs(misfit)))
        if (found := _at_rest(quiet, rest, prior)) is not None:
            return found
        return map_estimate(reading, start, prior)
    if (found := _at_rest(reading, rest, prior)) is not None:
        return found
    if reading.noise == 0.0 and reading.whole and prior is None:
        estimate = newton(reading, start)
        if estimate.status == "ok":
            return estimate
    return map_estimate(reading, start, prior)


def _at_rest(reading: Reading, rest: np.ndarray, prior) -> Estimate | None:
    """The estimate of an untouched skin, if this is one."""
    peak = np.abs(reading.misfit(rest)).max()
    at_rest = prior is None and peak <= max(_IDLE_PEAK * reading.noise, _EXACTLY_IDLE)
    if at_rest and not (reading.noise and by_residual(reading, rest)):
        idle = _idle(reading.circuit, reading.curve, reading.noise)
        return replace(idle, residual=reading.residual(rest))
    return None


@lru_cache(maxsize=16)
def _idle(circuit, curve, noise: float) -> Estimate:
    """The estimate of an untouched skin."""
    everywhere = np.ones(circuit.shape, bool)
    reading = Reading(
        rest_reading(circuit, curve), everywhere, ~everywhere, 0.0, noise, np.inf, circuit, curve
    )
    return judge(np.zeros(circuit.shape), reading, "rest")
