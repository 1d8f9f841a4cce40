"""Does another r_par than the circuit's explain a frame? (docs/derivation.md, "Which R_par")"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...findings.finding import Finding, Kind
from ..estimate import Estimate
from ..fixed_point import last_guess
from ..reading import Reading, rest_shift
from ..score import FEW, R_PAR_LIMIT, RELEVANT, SETTLED, hold_rest, r_par_shift, series_scale

# Chosen with those of score.py.
_MAX_FITS = 4  # with another r_par; two are usual
_TOLERANCE = 0.25  # of `series_scale` that r_par may be off; more is another fault
_UNCHECKED = 8.0  # standard deviations beside a network's force, which no further fit checks
# chi^2 a reading that may be left: of a suspect frame, of several steps the first; of one that is
# not suspect.
_CHI2_FIRST, _CHI2_VALID = 30.0, 4.0
_LIGHTLY = 1.02  # times its conductance at rest from which on a cell counts as lightly touched
_MANY = 4  # lightly touched cells from which on r_par may be the cause

Fit = Callable[[Reading, np.ndarray], Estimate]


def find_r_par(reading: Reading, fit: Fit, nominal: Estimate) -> Estimate:
    """The frame with another r_par, if that explains it better than the circuit's own.

    Args:
        fit: the estimate of a reading from conductances (rows, cols) [S].
        nominal: that with the circuit's r_par, which is returned if nothing better is found.
    """
    g = last_guess(reading, nominal)
    before = _count_lightly_touched(reading, g)
    if nominal.status == "failed" or (nominal.status == "ok" and before < _MANY):
        return nominal
    own, limit, first = reading.circuit.r_par, _max_r_par(reading), r_par_shift(reading, g)
    chi2 = _CHI2_VALID if nominal.status == "ok" else _CHI2_FIRST
    relevant = first is not None and abs(first.shift) > RELEVANT * series_scale(reading.circuit)
    enough = nominal.status == "suspect" or (relevant and first.at_rest >= FEW)
    if relevant and enough and first.exceeds(R_PAR_LIMIT) and first.chi2 < chi2:
        r_par = own + first.shift
    elif limit < own:
        r_par = limit
    else:
        return nominal
    found = fit_r_par(reading, fit, g, r_par)
    if found is None:
        return nominal
    if nominal.status == "ok":  # what that explains, the other must explain with fewer cells
        fewer = before - _count_lightly_touched(reading, last_guess(reading, found))
        n = reading.n_informative
        worse = n * (found.residual**2 - nominal.residual**2) / reading.fitted_noise**2  # chi^2
        worth = fewer * np.log(n)  # Schwarz' criterion
        better = found.status == "ok" and 2 * fewer > before and worse < worth
    else:
        left, before = (e.residual**2 - reading.fitted_noise**2 for e in (found, nominal))
        better = found.status == "ok" or 2 * left < before  # of what noise does not explain
    if not better:
        return nominal
    found = replace(found, iterations=nominal.iterations + found.iterations)
    return report_r_par(found, reading)


def fit_r_par(reading: Reading, fit: Fit, g: np.ndarray, r_par: float) -> Estimate | None:
    """The frame with an r_par near a guess [ohm], as a board with that r_par would see it.

    None: no r_par there fits best, or the circuit's own does as well.

    Args:
        g: (rows, cols) conductance [S] of each cell from which to begin.
    """
    circuit, iterations = reading.circuit, 0
    for _ in range(_MAX_FITS):
        r_par = min(r_par, _max_r_par(reading))
        if r_par < 0.0 or abs(r_par - circuit.r_par) > _TOLERANCE * series_scale(circuit):
            return None
        trial = _with_r_par(reading, r_par)
        estimate = fit(trial, hold_rest(reading, g)[1])
        iterations += estimate.iterations
        g = last_guess(reading, estimate)
        if not reading.noise_given:  # what was measured with another r_par contains its misfit
            trial = replace(trial, noise=estimate.noise)
        left = r_par_shift(trial, g)
        if left is None or reading.late():
            return None
        if not left.exceeds(SETTLED):
            break
        r_par += left.shift
    off = left._replace(shift=r_par + left.shift - circuit.r_par)
    irrelevant = abs(off.shift) < RELEVANT * series_scale(circuit)
    if left.exceeds(SETTLED) or irrelevant or not off.exceeds(R_PAR_LIMIT):
        return None
    return replace(estimate, iterations=iterations, r_par=r_par)


def _with_r_par(reading: Reading, r_par: float) -> Reading:
    """The frame as one of a board with this r_par [ohm], whose rest was measured with it."""
    circuit, curve = reading.circuit, reading.curve
    if curve.offset is not None:
        shift = (r_par - circuit.r_par) * rest_shift(circuit, curve)
        rest = np.where(circuit.populated, 1.0 / curve.rest_resistance + shift, 1.0)
        # the shift is a first order one
        ends = 0.1 / curve.rest_resistance, 0.9 / curve.points[-1][1]
        curve = curve.resting_at(1.0 / np.clip(rest, *ends))
    return replace(reading, circuit=replace(circuit, r_par=r_par), curve=curve)


def report_r_par(estimate: Estimate, reading: Reading) -> Estimate:
    """An estimate with an r_par other than the circuit's, as a suspect one that says so."""
    circuit = reading.circuit
    finding = Finding(
        Kind.CIRCUIT,
        "fits better",
        numbers={"r_par": circuit.r_par, "better": estimate.r_par},
        detail=f"; {estimate.message}" if estimate.message else "",
    )
    residual = reading.residual(reading.model(last_guess(reading, estimate)))
    return replace(estimate, residual=residual).doubted(finding)


def guess_r_par(reading: Reading, g: np.ndarray) -> float | None:
    """The r_par [ohm] by a reading and approximate conductances (rows, cols) [S] alone.

    None: the circuit's own, or the readings do not determine it.
    """
    found = r_par_shift(reading, g, neighbours=False)
    if found is None or not found.exceeds(_UNCHECKED) or found.chi2 > _CHI2_VALID:
        return None
    off = abs(found.shift) > _TOLERANCE * series_scale(reading.circuit)
    return None if off else reading.circuit.r_par + found.shift


def _max_r_par(reading: Reading) -> float:
    """The largest r_par [ohm] that the largest reading allows."""
    r_ref = reading.circuit.r_ref
    return r_ref / max(reading.adc.max(), 1e-9) - r_ref


def _count_lightly_touched(reading: Reading, g: np.ndarray) -> int:
    """Number of cells that seem touched, but so lightly that a wrong r_par may be the cause."""
    touched, _ = hold_rest(reading, g)
    return np.count_nonzero((g > _LIGHTLY * reading.bounds[0]) & ~touched)
