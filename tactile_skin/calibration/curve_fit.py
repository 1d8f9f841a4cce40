# SPDX-License-Identifier: Apache-2.0
"""The curve of a skin's fabric, from objects of known weight laid anywhere (docs/derivation.md).

The circuit's inverse gives what each cell conducts, whatever the curve. Force is a sum of ramps in
what a load adds to that, an octave each; so each total is linear in the slopes. Besides, each cell
has a gain, where the totals tell it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..physics.circuit import Circuit
from ..physics.creep import NO_CREEP, Creep
from ..physics.curve import PressureCurve
from ..solvers import compensate
from ..solvers.evidence import HARDEST
from .identify import FEWEST
from .rest import Rest, check_frames, supposing
from .totals import LEAST, Totals

_LIGHTLY = 0.25  # times its conductance at rest that the first knot adds to a cell
_ODD = 1.3  # factor by which the others say another weight of an odd object,
_ODD_STD = 4.0  # and standard deviations that they have
_CANDIDATES = 3  # for the odd ones, the worst, that are tried
_ODD_SHARE = 1.0 / 3.0  # of the objects at most can be odd
# What objects that lie cannot show, and what limits allow for (docs/calibrate.md)
_LOW_AT_FIRST = 0.25
_FACTOR = 1.5
# RMS error of a total, and standard deviation of its logarithm from one skin to the next: 0.026 on
# simulated boards (benchmarks.calibration.curve_fit, seeds 2200 to 2269), 0.08 to 0.15 on real.
_USUAL_ERROR = 0.05
_USUAL_SPREAD = 0.5
_ERRORS = np.geomspace(0.005, 1.0, 500)  # that are tried: better than any skin, and useless
_NARROW = 2.0  # largest over smallest weight up to which the shape is hardly told
FIRST = 0.3  # s of a touch in which a stop needs its force
POOR = 0.1  # error from which on a word is due


class Off(NamedTuple):
    """By how much totals of presses that were left out are off, relative."""

    median: float
    p90: float  # nine of ten are off by less

    def __str__(self) -> str:
        return f"half are within {self.median:.1%}, nine of ten within {self.p90:.1%}"


@dataclass(frozen=True, eq=False)
class FittedCurve:
    """A curve by known weights.

    Attributes:
        curve: with each cell's gain, 1 as far as the weights do not tell it;
            `curve.resting_at(1 / rest.conductance)` is that of each cell's rest, too.
        error: RMS relative error to expect of the total force of a new object, where it lies
            within those of the frames that were used. That of lighter objects is several times
            that, since no frame determines the first slopes.
        first: the same of the first 0.3 s of touches, as quantiles; None: no frame shows it.
        holds: of what stands longer.
        off: (n,) relative error of each frame's total, its object left out of the fit.
        odd: frames that were not used, since their weight contradicts the others'.
        unexplained: number of frames whose readings are not those of this circuit.
        message: for a person.
        creep: what is taken out of a standing load with this curve, which then is that of a load
            that has just come; a share of 0: it is that of objects that have lain for `LAID` s.
    """

    curve: PressureCurve
    error: float
    first: Off | None
    holds: Off | None
    off: np.ndarray
    odd: tuple[int, ...]
    unexplained: int
    message: str
    creep: Creep = NO_CREEP


def fit_curve(
    frames, weights, circuit: Circuit, rest: Rest, *, ends: tuple[float, float] = (0.0, 1.0)
) -> FittedCurve:
    """Find the curve by frames of objects of known weight.

    Objects that load many cells, and light as well as heavy ones, tell most of the curve; thirty or
    more all over the skin tell the cells' gains, too. A frame may be the mean of several. Frames of
    the same weight are taken for the same object, laid again.

    Args:
        frames: (n, rows, cols) ADC ratio; NaN where a crossing was not read.
        weights: (n,) total load of each [N], in any order.
        circuit: with r_par and r_line as `identify` found them.
        rest: `measure_rest` of the same skin.
        ends: ADC ratios at which the converter ends: readings there are bounds.

    Raises:
        ValueError: fewer than 3 weights, a weight that is not above 0 and finite, shapes that
            differ, a frame without a touch or that no cells explain.
    """
    frames = rest.quiet(check_frames(frames, circuit))
    weights = _check_weights(weights, len(frames))
    at_rest = supposing(rest, circuit).conductance
    usual = float(np.median(at_rest[circuit.populated]))  # S
    knots = Knots.of(circuit, usual)
    added, doubts = added_conductance(frames, circuit, at_rest, usual, knots, ends)
    untouched = np.flatnonzero(added.sum((1, 2)) <= 0.0)
    if untouched.size:
        k = untouched[0]
        raise ValueError(f"frame {k} shows no touch, its weight is {weights[k]:.3g} N")
    return explained(added, weights, _objects(weights), circuit, usual, doubts)


def explained(
    added, weights, objects, circuit: Circuit, usual: float, doubts: int, since=None
) -> FittedCurve:
    """Return the curve by what cells conduct under known loads.

    Args:
        added: (n, rows, cols) beyond their rest [S].
        weights: (n,) total load of each [N].
        objects: (n,) to which each belongs: frames of one are left out together.
        usual: what the usual cell conducts at rest [S].
        doubts: how many frames the circuit does not explain.
        since: (n,) for how long each load has been there [s]; None: it stood.
    """
    knots = Knots.of(circuit, usual)
    ramps = knots.ramps(added)
    totals = Totals.of(ramps, weights)
    odd = _odd(totals, objects)
    used = ~np.isin(objects, odd)
    fit = totals.only(used).explained()
    totals = Totals.of(ramps, weights, fit.slope)
    fit = totals.only(used).solve(fit.noise, fit.scatter, fit.step)
    off, alike, std = np.empty((3, len(weights)))  # with the cells' gains, and without
    for k in np.unique(objects):
        mine = objects == k
        own = totals.only(mine)
        others = totals.only(used & ~mine).solve(fit.noise, fit.scatter, fit.step)
        off[mine], std[mine] = others.of(own) - 1.0, others.std(own)
        alike[mine] = own.data @ others.slope - 1.0
    error, without = (_error(of[used], std[used], objects[used]) for of in (off, alike))
    early = np.zeros(len(off), bool) if since is None else since <= FIRST
    usual_off = np.abs(off) / std * np.sqrt(np.square(std).mean())
    first, holds = (_quantiles(usual_off[used & at]) for at in (early, ~early))
    gain = fit.gain.reshape(circuit.shape)
    curve = knots.curve(fit.slope, usual).with_gain(gain)
    hardest = float(knots.ramps(added[used].max()) @ fit.slope)  # N
    kept = weights[used]
    message = [
        f"{len(np.unique(kept))} weights from {kept.min():.3g} to {kept.max():.3g} N: of new loads "
        f"in this range that stand {holds or first}, of lighter ones by several times that "
        f"({error:.1%} RMS); cells were loaded up to {hardest:.2g} N, beyond that the curve "
        "is a guess",
        f"in the first {FIRST:g} s of a touch {first}"
        if first
        else f"in the first {FIRST:g} s a touch may read {_LOW_AT_FIRST:.0%} low: a scale shows it",
        f"thresholds in newtons: allow for a factor of {_FACTOR:g}",
        f"the cells' gains are {gain.min():.2f} to {gain.max():.2f}, as far as the weights tell "
        f"them: with all of them 1 it would be {without:.1%}",
    ]
    message += _words(weights, used, off, objects, odd)
    if circuit.readout == "loaded" and error > POOR:
        message.append("if the lines are driven through diodes, enter circuit.diode")
    if doubts:
        remedy = "find what lies in series by touches first"
        if not circuit.readout_class.two_terminal:
            remedy = f"check r_ref = {circuit.r_ref:g} ohm, r_par = {circuit.r_par:g} ohm"
            if circuit.readout_class.knows_r_drive:
                remedy += f", r_drive = {circuit.r_drive:g} ohm"
        message.append(
            f"the circuit does not explain {doubts} of {len(added)} frames: {remedy}, and check "
            "the wiring"
        )
    indices = tuple(np.flatnonzero(~used).tolist())
    return FittedCurve(curve, error, first, holds, off, indices, doubts, "; ".join(message))


def _check_weights(weights, n: int) -> np.ndarray:
    weights = np.asarray(weights, dtype=float)
    if weights.shape != (n,):
        raise ValueError(f"weights have shape {weights.shape}: must be one for each of {n} frames")
    if n < FEWEST:
        raise ValueError(f"{n} weights: {FEWEST} or more are needed, 10 are good")
    bad = np.flatnonzero(~((weights > 0.0) & (weights < np.inf)))
    if bad.size:
        raise ValueError(f"weight {bad[0]} = {weights[bad[0]]:g} N: must be above 0 and finite")
    return weights


def added_conductance(
    frames, circuit: Circuit, at_rest, usual: float, knots: Knots, ends=(0.0, 1.0)
):
    """(n, rows, cols) [S] that the cells conduct beyond their rest; how many frames are suspect."""
    cells = circuit.populated
    soft = knots.curve(circuit.r_ref, usual)  # any slope: what the cells conduct is looked for
    soft = soft.resting_at(1.0 / np.where(cells, at_rest, usual))
    half = 0.5 / circuit.full_scale  # of a step: frames are means
    low, high = ends[0] and ends[0] + half, ends[1] - half if ends[1] < 1.0 else 1.0
    found = compensate(frames, circuit, soft, "map", missing=True, threshold=low, ceiling=high)
    failed = np.flatnonzero(found.status == "failed")
    if failed.size:
        raise ValueError(f"frame {failed[0]}: {found.message[failed[0]]}")
    added = np.where(found.force > 0.0, 1.0 / soft.resistance(found.force) - at_rest, 0.0)
    return np.maximum(added, 0.0) * cells, int(np.count_nonzero(found.status == "suspect"))


class Knots(NamedTuple):
    """Between which the ramps rise, an octave each."""

    at: np.ndarray  # (k + 1,) [S] that a cell conducts beyond its rest, the first 0

    @classmethod
    def of(cls, circuit: Circuit, usual: float) -> Knots:
        """From a share of what the usual cell conducts at rest [S] to the hardest cell."""
        hardest = 1.0 / (HARDEST * circuit.r_ref)
        octaves = max(int(np.ceil(np.log2(hardest / (_LIGHTLY * usual)))), 1)
        return cls(np.append(0.0, hardest * 2.0 ** np.arange(-octaves, 1.0)))

    def ramps(self, added) -> np.ndarray:
        """(...) [S] -> (..., k) [S] how far cells rise along each ramp."""
        return np.clip(np.expand_dims(added, -1) - self.at[:-1], 0.0, np.diff(self.at))

    def curve(self, slope, usual: float) -> PressureCurve:
        """Of a cell that rests at `usual` [S], by (k,) slopes [N/S] or one."""
        rise = np.diff(self.at) * slope
        return PressureCurve(np.append(0.0, np.cumsum(rise)), 1.0 / (usual + self.at))


def _objects(weights: np.ndarray) -> np.ndarray:
    """(n,) the object of each frame; of a single one, each frame counts as one."""
    objects = np.unique(weights, return_inverse=True)[1]
    return objects if objects.any() else np.arange(len(weights))


def _quantiles(off: np.ndarray) -> Off | None:
    """Return those of (n,) relative errors; None: there are none."""
    return Off(*(float(q) for q in np.quantile(off, (0.5, 0.9)))) if off.size else None


def _error(off: np.ndarray, std: np.ndarray, objects: np.ndarray) -> float:
    """Return the RMS error of a new total, by those (n,) left out; totals of one object are one.

    Each counts by what it was predicted with: an object that is harder than all others worst. The
    mean of what is probable: boards mostly err as usual, one may by any factor (Cauchy's prior).
    """
    usual = np.square(off / std) * np.square(std).mean()  # if all were predicted alike
    squares = np.array([usual[objects == k].mean() for k in np.unique(objects)])
    log = np.log(_ERRORS / _USUAL_ERROR)
    probable = -0.5 * squares.sum() / np.square(_ERRORS) - len(squares) * log
    probable -= np.log1p(np.square(log / _USUAL_SPREAD))
    return float(np.average(_ERRORS, weights=np.exp(probable - probable.max())))


def _odd(totals: Totals, objects: np.ndarray) -> list[int]:
    """Objects whose weight contradicts the others', the worst first."""
    odd: list[int] = []
    names = np.unique(objects)
    while len(odd) + 1 <= _ODD_SHARE * len(names):
        used = ~np.isin(objects, odd)
        stiff = totals.only(used).stiff()
        misfit = np.abs(np.log(totals.data @ stiff.slope))
        left = [k for k in names if k not in odd]
        worst = sorted(left, key=lambda k: -misfit[objects == k].mean())[:_CANDIDATES]
        found = [(_contradiction(totals, objects == k, used), k) for k in worst]
        most, k = max(found)
        if most < 1.0:
            break
        odd.append(k)
    return odd


def _contradiction(totals: Totals, mine: np.ndarray, used: np.ndarray) -> float:
    """By how much the used objects but one contradict its weight; 1: it is odd.

    Each fit of theirs that may be true must: the most probable one of a few knows the rest of the
    curve too well.
    """
    own = totals.only(mine)
    contradicts = []
    for fit in totals.only(used & ~mine).probable():
        total = max(float(fit.of(own).mean()), LEAST)
        limit = max(np.log(_ODD), _ODD_STD * fit.std(own) / total)
        contradicts.append(float(abs(np.log(total)) / limit))
    return min(contradicts)


def _words(weights, used, off, objects, odd) -> list[str]:
    """Return what a person should know besides."""
    words = []
    for k in odd:
        mine = np.flatnonzero(objects == k)
        said = weights[mine[0]] * (1.0 + off[mine].mean())
        words.append(
            f"object {', '.join(str(i + 1) for i in mine)} is left out: its weight is given as "
            f"{weights[mine[0]]:.3g} N, the others say {said:.3g} N"
        )
    kept = weights[used]
    if kept.max() <= kept.min():
        words.append(
            f"all weights are equal ({kept[0]:.3g} N): they tell the level, not the shape, which "
            "is the shipped curve's: add lighter and heavier objects"
        )
    elif kept.max() < _NARROW * kept.min():
        words.append("the weights are close together: add lighter and heavier objects")
    if np.sqrt(np.mean(np.square(off[used]))) > POOR:
        worst = np.flatnonzero(used)[np.abs(off[used]).argmax()]
        words.append(
            f"the weights contradict one another: object {worst + 1}, {weights[worst]:.3g} N, is "
            f"off by {off[worst]:+.0%} from what the others say: check it, or add more objects"
        )
    return words
