"""Which readout a board has, by its touches: the one whose network explains them.

What else explains them as well is looked for, too: another series resistance, another width of the
ADC. A setting is only proposed if nothing else explains the touches.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...calibration.rest import REST_SPAN, resting_conductance
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN, PASSIVE
from ...solvers import compensate
from .advice import Change, is_safe, of_other_scale

_EXPLAINED = 2.0  # times noise and model error up to which the configured readout may miss touches
_BETTER = 0.5  # times what the configured readout misses, that another one may,
FITS = 4.0  # and times the noise
# Explanations between which touches do not decide: times what the best one misses, and times the
# noise, that they miss at most.
_AS_GOOD = 2.0
_WITHIN_NOISE = 1.5
_MODEL = 0.003  # of a reading, that real skins are off the circuit's model (solvers/suspect.py)
# What no passive network reads, all three. Boards with a virtual ground (seeds 3 and 4, r_ref 100
# to 1000 ohm) were missed by 34 at least, added up to 1.4 and left 0 to 0.66 unmoved.
_NEVER = 20.0  # times the noise by which all of them miss the touches, with r_par and without
_ADDS_UP = 1.2  # full scales, along a row and along a column
_UNMOVED = 0.02  # share of the crossings on the lines of a touch that read as at rest
_RISEN = 0.2  # of full scale: a touched crossing
_AT_REST = 3.0  # times the noise by which a reading at rest may stray, and
_AT_REST_STEPS = 1.0  # ADC steps
_TIME = 0.1  # s for a touch that no cells explain
_LEAST_NOISE = 0.3  # ADC steps: of rounding
_R_PAR = (0.0, 30.0, 100.0, 300.0)  # ohm that are tried at first: of drivers and multiplexers
_ROUNDS = 5  # in which the most is refined,
_FACTOR = 1.7  # at first by this factor


class Fitting(NamedTuple):
    """What explains touches that the configured circuit does not.

    Attributes:
        changes: each of which explains them, and leaves a skin that feels them; the best first.
        left, supposed: times noise and model error by which the best other circuit, and the
            configured one, miss them; of a virtual ground left is what lines add up to, in full
            scales.
    """

    changes: list[Change]
    left: float
    supposed: float

    @property
    def of_own_cells(self) -> bool:
        """Whether it is a virtual ground, which no circuit proves: wrong bits add up as far."""
        return any(c.circuit.readout == "virtual_ground" for c in self.changes)


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

    def after(self, change: Change) -> Touched:
        """Return the same as it is read after a change."""
        rest, *touches = change.of(np.concatenate([self.rest[None], self.touches]))
        return Touched(rest, self.noise * change.scale, np.array(touches))


def other(supposed: Circuit, seen: Touched) -> Fitting | None:
    """Return what explains the touches instead; None: the supposed circuit does."""
    own = misses(supposed, seen)
    if own <= _EXPLAINED or not len(seen.touches):
        return None
    tried = [(misses(c.circuit, seen.after(c)), c) for c in _others(supposed, seen)]
    if own > FITS:
        tried.append(_with_r_par(supposed, seen))
    tried.sort(key=lambda pair: pair[0])
    left = tried[0][0]
    if left >= min(_BETTER * own, FITS):
        if min(left, own) > _NEVER and (sums := _separate(seen, supposed.full_scale)):
            bare = replace(supposed, r_par=0.0)
            others = [c.circuit for c in _others(bare, seen) if c.scale == 1.0]
            if min(misses(c, seen) for c in (bare, *others)) > _NEVER:
                own_cells = supposed.read_as("virtual_ground", supposed.driven)
                return Fitting([Change(own_cells)], sums, own)
        return Fitting([], left, own) if own > FITS else None
    alike = max(_AS_GOOD * left, _WITHIN_NOISE)
    frames = np.concatenate([seen.rest[None], seen.touches])
    quiet = np.arange(len(frames)) == 0
    changes = [c for off, c in tried if off <= alike and is_safe(c, frames, quiet, seen.noise)]
    return Fitting(changes, left, own)


def _separate(seen: Touched, full: int) -> float:
    """Return how many times full scale lines add up to, if each reading is of its own cell alone.

    0: they do not, or other readings move with it.
    """
    sums, unmoved = [], []
    limit = (_AT_REST * max(seen.noise, _LEAST_NOISE) + _AT_REST_STEPS) / full
    for touch in np.nan_to_num(seen.touches):
        risen = touch > np.nan_to_num(seen.rest) + _RISEN
        beside = (risen.any(1)[:, None] | risen.any(0)) & ~np.isnan(seen.rest)
        still = beside & (np.abs(touch - seen.rest) < limit)
        sums.append(min(touch.sum(0).max(), touch.sum(1).max()))
        unmoved.append(np.count_nonzero(still) / max(int(np.count_nonzero(beside)), 1))
    adds_up = np.median(sums) > _ADDS_UP and np.median(unmoved) > _UNMOVED
    return float(np.median(sums)) if adds_up else 0.0


def _others(supposed: Circuit, seen: Touched) -> list[Change]:
    """Return other readouts, and other widths of the ADC whose range the readings do not leave."""
    found = []
    for readout in PASSIVE:
        for driven in DRIVEN[:1] if readout == "floating" else DRIVEN:
            circuit = supposed.read_as(readout, driven)
            same = readout == "floating" == supposed.readout
            if not (same or circuit == supposed):
                found.append(Change(circuit))
    most, end = float(np.nanmax(seen.touches)), float(supposed.ratio(0.0))
    return found + [c for c in of_other_scale(supposed) if c.scale * most <= end]


def _with_r_par(supposed: Circuit, seen: Touched) -> tuple[float, Change]:
    """Return the most series resistance that explains the touches, and by how much it misses.

    Of less the cells take up what is lacking, down to 0 ohm.
    """

    def tried(r_par: float) -> tuple[float, float]:
        return misses(replace(supposed, r_par=r_par), seen), r_par

    found = [tried(r_par) for r_par in _R_PAR]
    alike = max(_AS_GOOD * min(found)[0], _WITHIN_NOISE)
    most = max((pair for pair in found if pair[0] <= alike), key=lambda pair: pair[1])
    factor = _FACTOR
    for _ in range(_ROUNDS):
        more = tried(most[1] * factor)
        most = more if more[0] <= alike else most
        factor **= 0.5
    return most[0], Change(replace(supposed, r_par=most[1]))


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
