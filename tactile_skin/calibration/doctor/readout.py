"""Which readout a board has, by its touches: the one whose network explains them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN, PASSIVE
from ...solvers import compensate
from ..rest import REST_SPAN, resting_conductance

_EXPLAINED = 2.0  # times noise and model error up to which the configured readout may miss touches
_BETTER, FITS = 0.5, 4.0  # times what the configured one misses, and times the noise, of another
_MODEL = 0.003  # of a reading, that real skins are off the circuit's model (solvers/suspect.py)
# What no passive network reads, all three. Boards with a virtual ground (seeds 3 and 4, r_ref 100
# to 1000 ohm) were missed by 34 at least, added up to 1.4 and left 0 to 0.66 unmoved.
_NEVER = 20.0  # times the noise by which all of them miss the touches, with r_par and without
_ADDS_UP = 1.2  # full scales, along a row and along a column
_UNMOVED = 0.02  # share of the crossings on the lines of a touch that read as at rest
_RISEN = 0.2  # of full scale: a touched crossing
_AT_REST = 3.0, 1.0  # times the noise, and ADC steps, by which a reading at rest may stray
_TIME = 0.1  # s for a touch that no cells explain
_LEAST_NOISE = 0.3  # ADC steps: of rounding


class Fitting(NamedTuple):
    """What explains touches that the configured circuit does not.

    Attributes:
        circuit: of another readout; None: no network explains them, either.
        left, supposed: times noise and model error by which the best other readout, and the
            configured one, miss them; of a virtual ground left is what lines add up to, in full
            scales.
    """

    circuit: Circuit | None
    left: float
    supposed: float


class Touched(NamedTuple):
    """What readouts are judged by.

    Attributes:
        rest: (rows, cols) ADC ratio of the untouched skin, NaN: not read.
        noise: of a reading [ADC steps].
        touches: (n, rows, cols) ADC ratio of hard ones, NaN: not read.
    """

    rest: np.ndarray
    noise: float
    touches: np.ndarray


def other(supposed: Circuit, seen: Touched) -> Fitting | None:
    """None: the supposed readout explains the touches."""
    own = misses(supposed, seen)
    if own <= _EXPLAINED or not len(seen.touches):
        return None
    left, circuit = min(_others(supposed, seen), key=lambda pair: pair[0])
    if left < min(_BETTER * own, FITS):
        return Fitting(circuit, left, own)
    if min(left, own) > _NEVER and (sums := _separate(seen, supposed.full_scale)):
        bare = replace(supposed, r_par=0.0)
        if min(misses(bare, seen), *(m for m, _ in _others(bare, seen))) > _NEVER:
            return Fitting(supposed.read_as("virtual_ground", supposed.driven), sums, own)
    return Fitting(None, left, own) if own > FITS else None


def _separate(seen: Touched, full: int) -> float:
    """Return how many times full scale lines add up to, if each reading is of its own cell alone.

    0: they do not, or other readings move with it.
    """
    sums, unmoved = [], []
    limit = (_AT_REST[0] * max(seen.noise, _LEAST_NOISE) + _AT_REST[1]) / full
    for touch in np.nan_to_num(seen.touches):
        risen = touch > np.nan_to_num(seen.rest) + _RISEN
        beside = (risen.any(1)[:, None] | risen.any(0)) & ~np.isnan(seen.rest)
        still = beside & (np.abs(touch - seen.rest) < limit)
        sums.append(min(touch.sum(0).max(), touch.sum(1).max()))
        unmoved.append(np.count_nonzero(still) / max(np.count_nonzero(beside), 1))
    adds_up = np.median(sums) > _ADDS_UP and np.median(unmoved) > _UNMOVED
    return float(np.median(sums)) if adds_up else 0.0


def _others(supposed: Circuit, seen: Touched) -> list[tuple[float, Circuit]]:
    found = []
    for readout in PASSIVE:
        for driven in DRIVEN[:1] if readout == "floating" else DRIVEN:
            circuit = supposed.read_as(readout, driven)
            same = readout == "floating" == supposed.readout
            if not (same or circuit == supposed):
                found.append((misses(circuit, seen), circuit))
    return found


def misses(circuit: Circuit, seen: Touched) -> float:
    """Median over the touches of the RMS misfit, in noise and model error; infinity: no rest."""
    at_rest, noise, touches = seen
    full, noise = circuit.full_scale, max(noise, _LEAST_NOISE)
    try:
        unread = list(zip(*np.nonzero(np.isnan(at_rest) & circuit.populated), strict=True))
        rest = resting_conductance(at_rest, circuit, noise, unread)
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
        found = compensate(
            touch, circuit, curve, "map", noise=noise, missing=True, time_limit=_TIME
        )
        scale = np.hypot(noise, _MODEL * full * np.sqrt(np.nanmean(np.square(touch))))
        left.append(np.inf if found.status == "failed" else found.residual / scale)
    return float(np.median(left)) if left else 0.0
