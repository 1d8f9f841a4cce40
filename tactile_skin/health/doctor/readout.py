# SPDX-License-Identifier: Apache-2.0
"""Which readout a board has, by its touches: the one whose network explains them.

What else explains them as well is looked for, too: another series resistance, another width of the
ADC. A setting is only proposed if nothing else explains the touches.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...calibration.rest import REST_SPAN, resting_conductance
from ...findings.finding import Finding, Kind
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN, PASSIVE
from ...solvers import Estimate
from ...solvers.suspect import MODEL_ERROR
from .advice import OFF_END, Change, felt, is_safe, of_other_scale

# Times noise and model error up to which the configured readout may miss touches; times what the
# best explanation misses, that others do between which touches do not decide.
_EXPLAINED = 2.0
BETTER = 0.5  # times what the configured readout misses, that another one may,
FITS = 4.0  # and times the noise
# What no passive network reads, all three. Boards with a virtual ground (seeds 3 and 4, r_ref 100
# to 1000 ohm) were missed by 34 at least, added up to 1.4 and left 0 to 0.66 unmoved.
_NEVER = 20.0  # times the noise by which all of them miss the touches, with r_par and without
_ADDS_UP = 1.2  # full scales, along a row and along a column
# Crossings that a touch raises though nothing presses there: behind a virtual ground none are.
_RAISED = 4
_IDLE = 0.01  # of the force of `_explained` at its end: up to twice the conductance at rest
_UNMOVED = 0.02  # share of the crossings on the lines of a touch that read as at rest
_RISEN = 0.2  # of full scale: a touched crossing
_R_PAR = (0.0, 30.0, 100.0, 300.0)  # ohm that are tried at first: of drivers and multiplexers
_FACTORS = 1.7**0.5 ** np.arange(5)  # by which the most is refined
_NONE = 5.0  # ohm: touches that ask for less than any driver has may be read on another scale


class Touched(NamedTuple):
    """What readouts are judged by."""

    rest: np.ndarray  # (rows, cols) ADC ratio of the untouched skin, NaN: not read
    noise: float  # of a reading [ADC steps], of rounding at least
    touches: np.ndarray  # (n, rows, cols) ADC ratio of hard ones, NaN: not read

    def after(self, change: Change) -> Touched:
        """Return the same as it is read after a change."""
        rest, *touches = change.of(np.concatenate([self.rest[None], self.touches]))
        return Touched(rest, self.noise * change.scale, np.array(touches))


class Fitting(NamedTuple):
    """What explains touches that the configured circuit does not."""

    # each of which explains them, and leaves a skin that feels them; the best first
    changes: list[Change]
    # left, supposed: times noise and model error by which the best other circuit, and the
    # configured one, miss them; of a virtual ground left is what lines add up to, in full scales
    left: float
    supposed: float

    @property
    def of_own_cells(self) -> bool:
        """Whether it is a virtual ground, which no circuit proves: wrong bits add up as far."""
        return any(c.circuit.readout == "virtual_ground" for c in self.changes)

    def finding(self, supposed: Circuit) -> Finding:
        """Return what explains the touches instead of the supposed circuit, if anything does."""
        if not self.changes:
            read = f"the untouched readings do not fit {_wired(supposed)}"
            if np.isfinite(self.supposed):
                read = f"the touches miss {_wired(supposed)} by {self.supposed:.0f} times the noise"
            numbers = {"r_par": supposed.r_par}
            return Finding(Kind.CIRCUIT, "none fits", numbers=numbers, detail=read)
        if self.of_own_cells and supposed.readout != "virtual_ground":
            return Finding(Kind.READOUT, "virtual ground", numbers={"left": self.left})
        first, only = self.changes[0], len(self.changes) == 1
        said: dict[str, float | str] = {"supposed": self.supposed}
        kind, form = Kind.CIRCUIT, "one of"
        if only and first.circuit.r_par != supposed.r_par:
            said["r_par"], only = first.circuit.r_par, False
            form = "r_par at most" if first.circuit.r_par > _NONE else "r_par 0 or scale"
        elif only:
            kind, form = (Kind.READOUT, "") if first.scale == 1.0 else (Kind.BITS, "width")
            form = "raised" if self.supposed <= _EXPLAINED else form
            said["settings"] = entered(first.settings(supposed))
        read = " or ".join(_read(supposed, change) for change in self.changes)
        if form == "raised":
            read = _wired(supposed)
            return Finding(kind, form, numbers=said, detail=read, change=first)
        detail = (
            f"the touches fit {read} to {self.left:.1f} times the noise, and {_wired(supposed)}, "
            f"r_par = {supposed.r_par:g} ohm"
        )
        return Finding(kind, form, numbers=said, detail=detail, change=first if only else None)


def _wired(circuit: Circuit) -> str:
    """Return a matrix as it is read, in words."""
    if circuit.readout == "floating":
        return "a floating matrix"
    return f"a {circuit.readout} matrix with driven {circuit.driven}"


def entered(settings: dict) -> str:
    """Return settings as an owner enters them."""
    return ", ".join(f"{name}: {str(value).lower()}" for name, value in settings.items())


def _read(supposed: Circuit, change: Change) -> str:
    """Return a change, in words."""
    if change.scale != 1.0:
        ((name, value),) = change.settings(supposed).items()
        return f"an ADC of another width ({name.removeprefix('circuit.')} {value})"
    if change.circuit.r_par != supposed.r_par:
        return f"r_par up to {change.circuit.r_par:.0f} ohm"
    return _wired(change.circuit)


def other(supposed: Circuit, seen: Touched) -> Fitting | None:
    """Return what explains the touches instead; None: the supposed circuit does."""
    own = misses(supposed, seen)
    if not len(seen.touches):
        return None
    if own <= _EXPLAINED:
        return None if supposed.has_cross_talk else _raised(supposed, seen, own)
    tried = [(misses(c.circuit, seen.after(c)), c) for c in _others(supposed, seen)]
    if own > FITS:
        tried.append(_with_r_par(supposed, seen))
    tried.sort(key=lambda pair: pair[0])
    left = tried[0][0]
    if left >= min(BETTER * own, FITS):
        if min(left, own) > _NEVER and (sums := _separate(seen, supposed.full_scale)):
            bare = replace(supposed, r_par=0.0)
            others = [c.circuit for c in _others(bare, seen) if c.scale == 1.0]
            if min(misses(c, seen) for c in (bare, *others)) > _NEVER:
                own_cells = supposed.read_as("virtual_ground", supposed.driven)
                return Fitting([Change(own_cells)], sums, own)
        return Fitting([], left, own) if own > FITS else None
    frames = np.concatenate([seen.rest[None], seen.touches])
    quiet, alike = np.arange(len(frames)) == 0, _as_good(left)
    changes = [c for off, c in tried if off <= alike and is_safe(c, frames, quiet, seen.noise)]
    return Fitting(changes, left, own)


def _raised(supposed: Circuit, seen: Touched, own: float) -> Fitting | None:
    """Return the readout by which touches raise crossings where nothing presses; None: none is.

    A virtual ground fits whatever is read, each crossing by its own cell.
    """
    fitting = []
    for change in _others(supposed, seen):
        if change.circuit.has_cross_talk and (off := misses(change.circuit, seen)) <= _EXPLAINED:
            fitting.append((off, change))
    for _, change in fitting:
        idle = [found.force < _IDLE for found in _explained(change.circuit, seen)]
        rose = seen.touches > seen.rest + OFF_END * (seen.noise + 1.0) / supposed.full_scale
        if np.median((rose & idle).sum((1, 2))) < _RAISED:
            return None
    fitting.sort(key=lambda pair: pair[0])
    frames = np.concatenate([seen.rest[None], seen.touches])
    quiet = np.arange(len(frames)) == 0
    changes = [c for _, c in fitting if is_safe(c, frames, quiet, seen.noise)]
    return Fitting(changes, fitting[0][0], own) if changes else None


def _as_good(left: float) -> float:
    """How much explanations may miss, between which and one that misses by `left` none decides."""
    return _EXPLAINED * max(left, 1.0)


def _separate(seen: Touched, full: int) -> float:
    """Return how many times full scale lines add up to, if each reading is of its own cell alone.

    0: they do not, or other readings move with it.
    """
    touches, rest = np.nan_to_num(seen.touches), seen.rest
    risen = touches > np.nan_to_num(rest) + _RISEN
    beside = (risen.any(2)[:, :, None] | risen.any(1)[:, None]) & ~np.isnan(rest)
    stray = OFF_END * (seen.noise + 1.0)
    still = beside & (np.abs(touches - rest) < stray / full)
    sums = np.median(np.minimum(touches.sum(1).max(1), touches.sum(2).max(1)))
    unmoved = np.median(still.sum((1, 2)) / np.maximum(beside.sum((1, 2)), 1))
    return float(sums) if sums > _ADDS_UP and unmoved > _UNMOVED else 0.0


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
    alike = _as_good(min(found)[0])
    most = max((pair for pair in found if pair[0] <= alike), key=lambda pair: pair[1])
    for factor in _FACTORS:
        more = tried(most[1] * factor)
        most = more if more[0] <= alike else most
    return most[0], Change(replace(supposed, r_par=most[1]))


def misses(circuit: Circuit, seen: Touched) -> float:
    """Median over the touches of the RMS misfit, in noise and model error; infinity: no rest."""
    try:
        explained = _explained(circuit, seen)
    except ValueError:  # no cells read so, or one conducts as much as a pressed one
        return np.inf
    left = []
    for touch, found in zip(seen.touches, explained, strict=True):
        error = MODEL_ERROR * circuit.full_scale * np.sqrt(np.nanmean(np.square(touch)))
        missed = found.residual / np.hypot(seen.noise, error)
        left.append(np.inf if found.status == "failed" else missed)
    return float(np.median(left)) if left else 0.0


def _explained(circuit: Circuit, seen: Touched) -> list[Estimate]:
    """Return what each touch is by a circuit, of a fabric from its rest to 1 N; or ValueError."""
    rest = resting_conductance(seen.rest, circuit, seen.noise)
    usual = 1.0 / np.median(rest[circuit.populated])
    rest = np.where(circuit.populated, np.maximum(rest, 2.0 / (usual * REST_SPAN)), 1.0 / usual)
    curve = PressureCurve((0.0, 1.0), (usual, usual / REST_SPAN)).resting_at(1.0 / rest)
    return [felt(touch, circuit, curve, seen.noise) for touch in seen.touches]
