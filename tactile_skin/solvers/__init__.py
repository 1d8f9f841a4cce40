"""From a reading to the force on each cell: one entry, `compensate`, and a file per method."""

from __future__ import annotations

from ..circuit import Circuit
from ..curve import PressureCurve
from .estimate import Estimate
from .fixed_point import fixed_point
from .map import map_estimate
from .naive import naive
from .newton import newton
from .reading import check_reading

METHODS = {
    "naive": naive,
    "fixed_point": fixed_point,
    "newton": newton,
    "map": map_estimate,
}

__all__ = ["METHODS", "Estimate", "check_reading", "compensate"]


def compensate(
    adc,
    circuit: Circuit,
    curve: PressureCurve,
    method: str = "auto",
    *,
    weights=None,
    start: Estimate | None = None,
    prior: tuple | None = None,
    noise: float | None = None,
    missing: bool = False,
    threshold: float = 0.0,
    time_limit: float | None = None,
) -> Estimate:
    if method not in METHODS:
        raise ValueError(f"method {method!r}: must be one of {', '.join(METHODS)}")
    reading = check_reading(
        adc,
        circuit,
        curve,
        missing=missing,
        threshold=threshold,
        noise=noise,
        time_limit=time_limit,
    )
    return METHODS[method](reading, weights=weights, start=start, prior=prior)
