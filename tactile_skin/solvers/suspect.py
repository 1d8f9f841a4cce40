# SPDX-License-Identifier: Apache-2.0
"""Does the circuit model explain the reading? Tests on a fitted frame (docs/derivation.md)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..findings.finding import Finding, Kind, Where, at, lines
from ..physics import readouts
from .estimate import Estimate, spread
from .reading import ROUNDING_NOISE, Reading, rest_reading

# Standard deviations of chi^2 beyond which a frame is suspect: chosen so that 2 % of valid frames
# (blobs, rects, random loads) are; scored on others (benchmarks/accuracy/solvers.py, detection).
CHI2_LIMIT = 2.8
# Equal readings that are rounded to whole steps err equally, and do not average out: factor by
# which a residual may then be larger.
_ROUNDED_RESIDUAL = 1.2
_ROUNDED_NOISE = 1.3  # times the noise of rounding up to which noise is rounding alone
# Share of a reading by which a valid skin may differ from the model: 0.5 % of a touch that fabric
# and cover carry to the next cells (paper section IV), some ohm of the stripes, rows read in turn.
# Chosen on streams of damaged boards (benchmarks.faults, seeds 3 and 4), scored on others.
MODEL_ERROR = 0.003
MEASURED_NOISE = 1.1  # factor to which noise that was measured in the same frame is known
_MEAN_LIMIT = 6.0  # standard deviations of the mean misfit, where the noise was measured
BEYOND = 5.0  # standard deviations of noise: once in 3 million readings
BELOW_REST = 0.5  # times the reading at rest, below which no sound cell reads
# Quantile of a sense line's readings, over those at rest, by which a cell that was not read lowers
# all of them; an open driven line lowers one of them, which lies below.
_USUAL = 0.25
LINE_OPEN = 0.1  # the same, of an open line
_UPSIDE_DOWN = 0.1  # of the readings that are too low, on no one line: more than some bad contacts
LIGHTER = "lighter"  # number of a misfit that cells explain which conduct less than at rest
EXACT_NOISE = 0.02  # ADC steps that an exact reading may miss
# A saturated input (docs/derivation.md, "When to doubt", 2).
_GAP = 3.0  # times as far below the largest reading there are few others:
_FLAT = 8  # readings at it at least,
_FLAT_OTHERS = 0.25  # and others in the gap for each of them
_EQUAL = 1.01  # ADC steps within which readings are equal, though noise would spread them,
_MANY = 30  # and of how many of a touch: no flat one leaves so many


def by_reading(reading: Reading) -> Finding | None:
    """Return readings that no skin can give, whatever presses on it.

    A load only raises a reading, from that at rest to that of a short circuit behind r_par. Where
    lines are driven it may lower others, all of a line alike. Noise spreads even a flat touch's
    readings.
    """
    circuit, steps, known = reading.circuit, reading.steps, reading.known
    margin = BEYOND * reading.noise + 1.0
    rest = _least_rest(reading)
    short_circuit = circuit.ratio(0.0) * circuit.full_scale
    low = known & (steps < BELOW_REST * rest - margin)
    if np.count_nonzero(low):
        line, numbers, bad = _place(low, known)
        numbers |= {"most": steps[bad].max(), "usual": np.median(rest[bad])}
        if line and numbers["most"] <= LINE_OPEN * numbers["usual"] + margin:
            return Finding(Kind.OPEN, "frame", **line, numbers=numbers)
        many = np.count_nonzero(low) > _UPSIDE_DOWN * np.count_nonzero(known)
        form = "mostly low" if many else "low"
        return Finding(Kind.MISFIT, form, **at(np.argwhere(bad)[0]), numbers=numbers)
    if steps.max() > short_circuit + margin:  # of a crossing that was not read 0
        high = steps > short_circuit + margin
        line, numbers, bad = _place(high, known)
        numbers |= {"most": short_circuit, "r_ref": circuit.r_ref, "r_par": circuit.r_par}
        where = line or at(np.argwhere(bad)[0])
        return Finding(Kind.MISFIT, "high" if line else "high cells", **where, numbers=numbers)
    spreads = reading.noise > 0.0 and not rounded(reading)
    if spreads and (ends := saturation(reading, _EQUAL, _MANY)):
        return Finding(Kind.SATURATION, "frame", numbers=ends)
    return None


def _least_rest(reading: Reading) -> np.ndarray:
    """(rows, cols) the least that cells at rest may read [ADC steps].

    A cell that was not read may draw what lowers all others of its sense line, and of its driven
    line where the drivers yield. One that is lower than the others is still too low.
    """
    circuit, rest = reading.circuit, _least_steps(reading.circuit, reading.curve)
    unread = circuit.populated & ~reading.informative
    if not (circuit.readout_class.shares_sum and unread.any()):
        return rest * reading.apparent[0]
    axis = circuit.sense_axis
    read = reading.known & circuit.populated
    share = np.divide(reading.steps, rest, out=np.full(rest.shape, np.inf), where=read)
    usual = np.quantile(share, _USUAL, axis, method="higher", keepdims=True)
    least = np.minimum(reading.apparent[0], usual)
    scale = np.where(unread.any(axis, keepdims=True), least, reading.apparent[0])
    if circuit.r_drive:
        scale = np.where(unread.any(1 - axis, keepdims=True), 0.0, scale)
    return rest * scale


@lru_cache(maxsize=16)
def _rest_steps(circuit, curve) -> np.ndarray:
    """(rows, cols) reading of an untouched skin [ADC steps] over its scale of `apparent`."""
    rest = rest_reading(circuit, curve)
    return rest * circuit.full_scale / readouts.apparent(circuit, rest)[0]


@lru_cache(maxsize=16)
def _least_steps(circuit, curve) -> np.ndarray:
    """(rows, cols) the least that loads elsewhere leave of it."""
    return circuit.readout_class.least(circuit, _rest_steps(circuit, curve))


def _place(bad: np.ndarray, known: np.ndarray) -> tuple[Where, dict, np.ndarray]:
    """Return the line that most of the bad readings are on, as `Finding` takes it; empty: none.

    count, of: of so many readings; and (rows, cols) bool, which are meant.
    """
    count = int(np.count_nonzero(bad))
    for axis, turned, there in ((0, bad, known), (1, bad.T, known.T)):
        on, n = turned.sum(1), there.sum(1)
        k = int(on.argmax())
        if 2 * on[k] > count and on[k] > 1 and 2 * on[k] > n[k]:
            mine = np.zeros(bad.shape, bool)
            np.moveaxis(mine, axis, 0)[k] = True
            return lines(axis, k), {"count": on[k], "of": n[k]}, bad & mine
    return {}, {"count": count, "of": known.sum()}, bad


def saturation(
    reading: Reading, thick: float | None = None, fewest: int = _FLAT
) -> dict[str, float] | None:
    """Return count and height [ADC steps] of the largest readings, where they lie at one height.

    A saturated input does so. A flat touch, too, but the circuit explains that. None: they do not.

    Args:
        thick: ADC steps within which they do; None: as noise spreads them.
        fewest: how many are enough.
    """
    top, circuit = reading.steps.max(), reading.circuit
    if reading.topped.any():  # it ends there, and what that means is known
        return None
    spreads = BEYOND * reading.noise + 1.0
    thick = spreads if thick is None else thick
    below = (top - reading.steps)[reading.known]
    count = np.count_nonzero(below < thick)
    if count < fewest or np.count_nonzero(below < _GAP * thick) > (1.0 + _FLAT_OTHERS) * count:
        return None
    rest = _rest_steps(circuit, reading.curve) * reading.apparent[0]
    hardest = circuit.ratio(np.max(reading.curve.least_resistance)) * circuit.full_scale
    if abs(top - rest.max()) <= max(thick, spreads) or top >= hardest:  # cells there read alike
        return None
    return {"count": count, "steps": top}


def by_residual(
    reading: Reading, adc: np.ndarray, floor: float = EXACT_NOISE, slack: float = 1.0
) -> Finding | None:
    """Return that the misfit to the model's ADC ratio (rows, cols) is beyond noise.

    Args:
        floor: noise [ADC steps] that the method assumes at least.
        slack: times the noise by which the method may miss a valid reading.
    """
    misfit = reading.misfit(adc)
    n = max(reading.n_informative, 1)
    noise = slack * max(reading.noise, floor) * (_ROUNDED_RESIDUAL if rounded(reading) else 1.0)
    noise *= 1.0 if reading.noise_given else MEASURED_NOISE
    square = np.square(misfit)
    variance = noise**2 + model_variance(reading)
    chi2 = (square / variance).sum() / n
    if chi2 <= 1.0 + CHI2_LIMIT * (2.0 / n) ** 0.5:
        if reading.noise_given or abs(misfit.sum()) <= _MEAN_LIMIT * np.sqrt(variance.sum()):
            return None
        return Finding(Kind.MISFIT, "mean", numbers={"steps": misfit.sum() / n})
    numbers = {"residual": (square.sum() / n) ** 0.5, "times": chi2**0.5}
    where: Where = {}
    for axis, of_lines in enumerate((square.sum(1), square.sum(0))):
        if of_lines.max() > 0.5 * square.sum():
            where |= lines(axis, int(of_lines.argmax()))
    if where:
        return Finding(Kind.MISFIT, "in lines", **where, numbers=numbers)
    if ends := saturation(reading):
        return Finding(Kind.MISFIT, "saturated", numbers=numbers | ends)
    form = "fabric" if reading.curve.offset is None else ""
    return Finding(Kind.MISFIT, form, numbers=numbers)


def model_variance(reading: Reading) -> np.ndarray:
    """(rows, cols) [ADC steps squared] of what every real skin reads off the circuit's model.

    None of an exact reading, which comes from a simulation or a laboratory.
    """
    return np.square(MODEL_ERROR * reading.steps) if reading.noise else np.zeros(reading.adc.shape)


def beside_sums(reading: Reading, misfit: np.ndarray) -> np.ndarray:
    """Return a fit's misfit (rows, cols) without the mean of lines whose readings share a sum.

    Of a line that is loaded hard the readings' sum hardly changes. So the prior, which pulls all of
    its cells one way, leaves some of the sum, which is no noise.
    """
    if not reading.circuit.readout_class.shares_sum:
        return misfit
    axis, known = reading.circuit.sense_axis, reading.known
    lines = (misfit * known).sum(axis, keepdims=True)
    return (misfit - lines / np.maximum(known.sum(axis, keepdims=True), 1)) * known


def rounded(reading: Reading) -> bool:
    """Whether rounding to whole steps is the only known noise of the readings."""
    return 0.0 < reading.noise <= _ROUNDED_NOISE * ROUNDING_NOISE


def estimate_from_force(
    force,
    reading: Reading,
    method: str,
    iterations=0,
    *,
    converged=True,
    slack=None,
    network=None,
) -> Estimate:
    """Return the estimate of a method that finds forces only; std and status by the misfit.

    The standard deviation is what each cell's resistance would have to change by, alone, to meet
    its own reading. An impossible reading is always suspect,
    a misfit only after a method that fits.

    Args:
        slack: times the noise by which a method that fits may miss a valid reading; None: it does
            not fit.
        network: `network_of(force, reading)` where it is known already.
    """
    circuit, curve = reading.circuit, reading.curve
    log_g, g, model = network or network_of(force, reading)
    slope = g * model.own * circuit.full_scale  # steps per log g
    misfit = reading.misfit(model.adc)
    shift = np.sqrt(np.square(misfit) + max(reading.noise, 1e-9) ** 2) / np.maximum(slope, 1e-9)
    std = spread(curve, log_g, shift) * circuit.populated
    finding = by_reading(reading)
    if slack and not finding:
        finding = by_residual(reading, model.adc, slack=slack)
    failure = "" if converged else no_convergence(reading, iterations)
    said = (*status_of(finding, failure), method, iterations, reading.noise)
    return Estimate(force, std, reading.rms(misfit), *said, finding=finding)


def status_of(finding: Finding | None, failure: str = "") -> tuple[str, str]:
    """Return status and message of an estimate."""
    if failure:
        return "failed", failure
    return ("suspect", str(finding)) if finding else ("ok", "")


def no_convergence(reading: Reading, iterations: int) -> str:
    why = ", the time limit (time_limit) was reached" if reading.late() else ""
    return f"no convergence after {iterations} steps{why}"


def network_of(force, reading: Reading):
    """(rows, cols) log of cells' conductance; conductance [S], 0 where there is none; network."""
    g = 1.0 / reading.curve.resistance(force)
    log_g = np.log(g)
    g *= reading.circuit.populated
    return log_g, g, readouts.solve(reading.circuit, g, derivatives=False)
