"""Is a light load on all of a floating matrix a hard one on a driven matrix?

All readings of a driven line approach one voltage under a hard load on the whole skin, and a
floating matrix reads so under a light, even one: it explains any such frame. Cells at rest would
show the wrong readout by their misfit (docs/derivation.md, "When to doubt").
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ...findings.finding import Finding, Kind
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN, PASSIVE
from ..estimate import Estimate
from ..fixed_point import last_guess
from ..newton import cells_that_fit, newton
from ..prior import force_of
from ..reading import NEAR_REST, Reading, check_reading, rest_reading

_COVERED = 0.75  # share of the cells that are touched from which on the misfit may tell nothing
# Times nearer to the curve's rest that cells must be by a driven readout. Chosen on even loads
# (8 x 8, seed 9) on fabrics that rest as the curve says; of those that rest 0.7 to 2.2 times so
# none was suspect.
_NEARER = 2.0
_SPAN = 1e3  # times the curve's rest, up and down, within which another readout's cells may rest
_REST_ERROR = 0.05  # ADC steps by which these may miss the untouched skin's readings


def other_readout(reading: Reading, estimate: Estimate, start: Estimate | None) -> Finding | None:
    """Return that a driven readout explains a frame as well, by a harder load.

    Args:
        start: the last frame's estimate, None: there is none. A frame that is one of a touch for
            which it was asked before is not asked again.
    """
    if reading.circuit.readout != "floating" or _covered(reading, estimate) < _COVERED:
        return None
    known = start is not None and start.status == "ok" and _covered(reading, start) >= _COVERED
    if known or reading.late():
        return None
    for circuit, curve in _others(reading.circuit, reading.curve):
        if _off(reading.curve) < _NEARER * _off(curve):
            continue  # light loads alone are those of either
        other = replace(reading, circuit=circuit, curve=curve).above_cut_off()
        hard = cells_that_fit(other)
        if hard is not None and force_of(other, hard)[0].sum() > estimate.force.sum():
            better = f"readout = {circuit.readout}, driven = {circuit.driven}"
            return Finding(Kind.READOUT, "frame", detail=better)
    return None


def _covered(reading: Reading, estimate: Estimate) -> float:
    """Share of the cells that an estimate has touched."""
    touched = last_guess(reading, estimate) > NEAR_REST * reading.bounds[0]
    return float(np.count_nonzero(touched) / np.count_nonzero(reading.circuit.populated))


def _off(curve: PressureCurve) -> float:
    """Factor by which the usual cell's rest differs from the curve's, 1 or more."""
    times = float(np.median(curve.rest_resistance)) / curve.points[0][1]
    return max(times, 1.0 / times)


@lru_cache(maxsize=16)
def _others(circuit: Circuit, curve: PressureCurve) -> list[tuple[Circuit, PressureCurve]]:
    """Driven readouts with which a skin can read at rest what this one does, and its curve then."""
    found, rest, usual = [], rest_reading(circuit, curve), curve.points[0][1]
    wide = PressureCurve((0.0, 1.0), (usual * _SPAN, usual / _SPAN))
    for readout in PASSIVE[1:]:
        for driven in DRIVEN:
            other = circuit.read_as(readout, driven)
            fit = newton(check_reading(rest, other, wide, noise=0.0))
            if fit.residual > _REST_ERROR:
                continue
            with contextlib.suppress(ValueError):  # a cell would rest as one that is pressed
                found.append((other, curve.resting_at(wide.resistance(fit.force))))
    return found
