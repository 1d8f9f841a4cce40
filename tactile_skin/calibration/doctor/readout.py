"""Which readout a board has, by its touches: the one whose network explains them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN, READOUTS
from ...solvers import compensate
from ..rest import REST_SPAN, resting_conductance
from .recorded import Recorded

_EXPLAINED = 2.0  # times noise and model error up to which the configured readout may miss touches
_BETTER, _FITS = 0.5, 4.0  # times what the configured one misses, and times the noise, of another
_MODEL = 0.003  # of a reading, that real skins are off the circuit's model (solvers/suspect.py)
_TIME = 0.1  # s for a touch that no cells explain


class Fitting(NamedTuple):
    """Another readout that explains the touches.

    Attributes:
        circuit: with it.
        left, supposed: times noise and model error by which it, and the configured one, miss them.
    """

    circuit: Circuit
    left: float
    supposed: float


def other(seen: Recorded, touches: np.ndarray) -> Fitting | None:
    """None: the configured readout explains (n, rows, cols) touches, or no other does."""
    if not len(touches):
        return None
    own = _misses(seen, touches, seen.circuit)
    if own <= _EXPLAINED:
        return None
    found = []
    for readout in READOUTS:
        for driven in DRIVEN[:1] if readout == "floating" else DRIVEN:
            circuit = replace(seen.circuit, readout=readout, driven=driven, r_line=0.0)
            same = readout == "floating" == seen.circuit.readout
            if not (same or circuit == seen.circuit):
                found.append((_misses(seen, touches, circuit), circuit))
    left, circuit = min(found, key=lambda pair: pair[0])
    return Fitting(circuit, left, own) if left < min(_BETTER * own, _FITS) else None


def _misses(seen: Recorded, touches: np.ndarray, circuit: Circuit) -> float:
    """Median over the touches of the RMS misfit, in noise and model error; infinity: no rest."""
    full, noise = circuit.full_scale, max(seen.usual_noise, 0.3)
    base = np.where(seen.read, seen.base / full, np.nan)
    try:
        rest = resting_conductance(base, circuit, noise)
    except ValueError:
        return np.inf
    usual = 1.0 / np.median(rest[circuit.populated])
    curve = PressureCurve((0.0, 1.0), (usual, usual / REST_SPAN))
    rest = np.where(circuit.populated, np.maximum(rest, 2.0 / (usual * REST_SPAN)), 1.0 / usual)
    try:
        curve = curve.resting_at(1.0 / rest)
    except ValueError:  # a cell conducts as much as a pressed one
        return np.inf
    left = []
    for touch in touches:
        adc = np.where(seen.read, touch, np.nan)
        found = compensate(adc, circuit, curve, "map", noise=noise, missing=True, time_limit=_TIME)
        scale = np.hypot(noise, _MODEL * full * np.sqrt(np.square(touch[seen.read]).mean()))
        left.append(np.inf if found.status == "failed" else found.residual / scale)
    return float(np.median(left))
