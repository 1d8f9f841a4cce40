"""From a reading to the force on each cell: one entry, `compensate`, and a file per method.

reading.py      one checked frame           estimate.py   what comes out
naive.py        the paper's naive method    learned.py    the networks
fixed_point.py  the literature's iteration  newton.py     the exact inverse
map.py          noise-aware, with prior.py  auto.py       the cheapest that the frame allows
laplacian.py    the network's algebra       suspect.py, judge.py   whether to believe it
series.py       which r_par explains the reading, where the circuit's does not
"""

from __future__ import annotations

from dataclasses import replace

from ..circuit import Circuit
from ..curve import PressureCurve
from .auto import auto
from .estimate import Estimate
from .fixed_point import fixed_point
from .learned import cnn, physics
from .map import map_estimate
from .naive import naive
from .newton import explained, newton
from .reading import check_prior, check_reading, check_start
from .suspect import piled

METHODS = {
    "naive": naive,
    "fixed_point": fixed_point,
    "newton": newton,
    "map": map_estimate,
    "cnn": cnn,
    "physics": physics,
    "auto": auto,
}

_UNFITTED = "naive", "fixed_point", "cnn", "physics"

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
    """Undo the cross-talk of one frame.

    Args:
        adc: (rows, cols) reading as ADC ratio, in [0, 1]. Where the circuit has no cell, NaN says
            that the crossing was not read.
        method: "naive" (paper section V: each reading taken for its own cell), "fixed_point" (the
            literature's g <- g * rho(g) / rho_measured), "newton" (the exact inverse), "map"
            (least squares in ADC steps with a prior), "cnn" (the paper's network), "physics" (one
            that is fed with the circuit's physics), or "auto" (the cheapest that the frame
            allows; `Estimate.method` names it, "rest" if nothing touches).
        weights: a `network.Weights` for the learned methods; None: those shipped with the package.
        start: the last frame's estimate, from which newton, map and auto then go on.
        prior: (mean, std) of each cell's force [N], arrays (rows, cols) or numbers, joined to the
            built-in prior of map as independent knowledge: a network's output, say. A std of
            infinity says nothing.
        noise: RMS noise of a reading in ADC steps; None: told from the grid that the values lie
            on (whole steps: rounding; fractions of 1/64 step: noise and averaging; else exact).
        missing: whether NaN marks a missing reading (map and auto only).
        threshold: ADC ratio up to which a reading says no more than that it is not higher
            (map and auto only).
        time_limit: seconds after which an iteration gives up; its last estimate is "failed".

    Raises:
        ValueError: wrong shape, NaN where a reading is due, a reading outside [0, 1], an argument
            of another type or outside its range, an unknown method, a method that needs what is
            missing, or weights that were made for another circuit or curve.
    """
    if method not in METHODS:
        raise ValueError(f"method {method!r}: must be one of {', '.join(METHODS)}")
    if start is not None:
        check_start(start, circuit)
    if prior is not None:
        prior = check_prior(prior, circuit)
    reading = check_reading(
        adc,
        circuit,
        curve,
        missing=missing,
        threshold=threshold,
        noise=noise,
        time_limit=time_limit,
    )
    estimate = METHODS[method](reading, weights=weights, start=start, prior=prior)
    if estimate.status == "ok" and method in _UNFITTED and reading.whole:
        # By how much these methods miss a reading says little.
        doubt = piled(reading)
        if doubt and not explained(reading):
            return replace(estimate, status="suspect", message=doubt)
    return estimate
