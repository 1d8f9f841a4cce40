"""A series resistance that is not the circuit's: the cells that nothing touches reveal it.

r_par lies before every reading. A wrong one moves each cell of a hard touch. It raises the cells at
rest a little, which a fit takes for light touches, or would have them read less than nothing. Held
at rest, they reveal it (docs/derivation.md, "Which R_par").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas, lapack

from ..physics.circuit import Circuit
from .estimate import Estimate
from .fixed_point import last_guess
from .reading import Reading, r_par_pattern, rest_shift
from .suspect import LIFTED, R_PAR_LIMIT, ROUNDED_SCORE, model_variance, network_of, rounded

# Chosen on simulated boards with the right r_par and with one 5 and 10 % off, under blobs, rects
# and palms; scored on others (tests/yardsticks/solvers.py, "another board", "R_par in a frame").
_MAX_FITS = 4  # with another r_par; two are usual
_RIM = 1.1  # times its conductance at rest: the rim of a palm is above
_RIM_SHARE = 0.05  # of `series_scale` by which r_par is too small beside such a rim
_MIN_SCALE = 0.15  # of r_ref: what a board's r_par may be where none is configured
_RELEVANT = 0.025  # of `series_scale`: less moves hard touches by 8 (blobs) to 25 g (rects) a cell
_TOLERANCE = 0.25  # of `series_scale` that r_par may be off; more is another fault
_SETTLED = 3.5  # standard deviations that may be left with the right r_par: 1 in 2000
_UNCHECKED = 8.0  # standard deviations beside a network's force, which no further fit checks
# chi^2 a reading that may be left beside a shift of r_par: of a suspect frame, of several steps the
# first; of one that is not suspect; around a touch, where the skin is at rest. The last is below 3
# beside a short or an r_par 10 % off, above 20 around nearly all palms (16 x 16, 8 x 12).
_CHI2_FIRST, _CHI2_VALID, _CHI2_REST = 30.0, 4.0, 5.0
_MIN_LEFT = 1e-3  # share of r_par's squared pattern that the touched cells must leave
_RIDGE = 1e-5  # of the touched cells' precision: the readings may not determine all of them
_MAX_CELLS = 400  # touched cells up to which to ask: the time is that of a Cholesky factor
_LIGHTLY = 1.02  # times its conductance at rest from which on a cell counts as lightly touched
_MANY = 4  # lightly touched cells from which on r_par may be the cause

Fit = Callable[[Reading, np.ndarray], Estimate]


class RParShift(NamedTuple):
    """By how much r_par would have to be larger, to first order.

    Attributes:
        shift, std: [ohm].
        chi2: a reading, that is left then.
    """

    shift: float
    std: float
    chi2: float

    def exceeds(self, limit: float) -> bool:
        return abs(self.shift) > limit * self.std


def series_scale(circuit: Circuit) -> float:
    """Series resistance [ohm] that errors of r_par are compared with: r_par may be given as 0."""
    return max(circuit.r_par, _MIN_SCALE * circuit.r_ref)


def r_par_shift(
    reading: Reading, g: np.ndarray, neighbours: bool = True, lifted: float = LIFTED
) -> RParShift | None:
    """Of a frame with conductances g (rows, cols) [S]; None: the readings do not determine it.

    Args:
        neighbours: whether cells next to touched ones may be touched too, and the readings differ
            from the model by its own error; without, it takes half the time, but fabric and cover
            must carry nothing from cell to cell.
        lifted: times its conductance at rest from which on a cell counts as touched.

    Newton's step for r_par, beyond what the touched cells absorb of its pattern p: with the misfit
    m and the Jacobian J of the touched cells, in standard deviations of noise and model error, and
    R = 1 - J J^+, it is - p.R m / p.R p.
    """
    touched, g = _hold_rest(reading, g, neighbours, lifted)
    variance = reading.spread**2 + (model_variance(reading) if neighbours else 0.0)
    model = reading.linearised(g, np.sqrt(variance))
    pattern = r_par_pattern(reading, model)
    both = np.array([pattern.ravel(), model.misfit.ravel()])
    gram = both @ both.T
    size = gram[0, 0]
    cells, n = np.flatnonzero(touched), reading.n_informative
    if cells.size >= min(n, _MAX_CELLS if neighbours else 0.75 * n):
        return None
    if cells.size:
        jacobian = model.jacobian(np.arange(g.size, dtype=np.int32), cells)
        jacobian *= g.ravel()[cells].astype(np.float32)
        precision = blas.ssyrk(1.0, jacobian.T, lower=1)
        diagonal = precision.T.reshape(-1)[:: cells.size + 1]
        diagonal *= 1.0 + _RIDGE
        factor, bad = lapack.spotrf(precision, lower=1, clean=0, overwrite_a=1)
        if bad:
            return None
        pull = both.astype(np.float32) @ jacobian
        absorbed = lapack.strtrs(factor, pull.T, lower=1)[0]
        gram -= absorbed.T @ absorbed
    (left, score), (_, square) = gram.tolist()
    if left <= _MIN_LEFT * size:
        return None
    slack = ROUNDED_SCORE if rounded(reading) else 1.0
    return RParShift(-score / left, slack * left**-0.5, (square - score**2 / left) / n)


def confirms(reading: Reading, g: np.ndarray, way: int) -> bool:
    """Whether a fault that a score test of a fit found is there without the fit's prior, too.

    A palm presses less and less towards its rim. A prior that prefers touches with an edge then
    leaves misfits that look like a short, or like another r_par. So the skin around the touch must
    be at rest, and r_par off by a relevant amount, the same way.

    Args:
        g: (rows, cols) conductance [S] that the fit found.
        way: that r_par would have to move, 1 or -1; 0 for another test.
    """
    scale = series_scale(reading.circuit)
    found = r_par_shift(reading, g)
    if found is not None and found.chi2 <= _CHI2_REST:
        # cells that are lightly touched make r_par seem smaller than it is, never larger
        limit = _SETTLED if found.shift > 0.0 else R_PAR_LIMIT
        if not way:
            return True
        possible = reading.circuit.r_par + found.shift + _SETTLED * found.std > 0.0
        return possible and way * found.shift > _RELEVANT * scale and found.exceeds(limit)
    rim = r_par_shift(reading, g, lifted=_RIM)
    if rim is None or way <= 0:
        return False
    # what is left of a rim can only make r_par seem smaller than it is
    return rim.exceeds(R_PAR_LIMIT) and rim.shift > _RIM_SHARE * scale


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
    relevant = first is not None and abs(first.shift) > _RELEVANT * series_scale(reading.circuit)
    if relevant and first.exceeds(R_PAR_LIMIT) and first.chi2 < chi2:
        r_par = own + first.shift
    elif limit < own:
        r_par = limit
    else:
        return nominal
    found = fit_r_par(reading, fit, g, r_par)
    if found is None:
        return nominal
    if nominal.status == "ok":  # what that explains, the other must explain with fewer cells
        after = _count_lightly_touched(reading, last_guess(reading, found))
        better = found.status == "ok" and 2 * after < before
    else:
        left, before = (_unexplained(reading, estimate) for estimate in (found, nominal))
        better = found.status == "ok" or 2 * left < before
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
        estimate = fit(trial, _hold_rest(reading, g)[1])
        iterations += estimate.iterations
        g = last_guess(reading, estimate)
        if not reading.noise_given:  # what was measured with another r_par contains its misfit
            trial = replace(trial, noise=estimate.noise)
        left = r_par_shift(trial, g)
        if left is None or reading.late():
            return None
        if not left.exceeds(_SETTLED):
            break
        r_par += left.shift
    off = left._replace(shift=r_par + left.shift - circuit.r_par)
    irrelevant = abs(off.shift) < _RELEVANT * series_scale(circuit)
    if left.exceeds(_SETTLED) or irrelevant or not off.exceeds(R_PAR_LIMIT):
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
    _, _, network = network_of(estimate.force, reading)
    message = f"r_par = {circuit.r_par:g} ohm: the readings fit {estimate.r_par:.0f} ohm better"
    return replace(
        estimate,
        residual=reading.residual(network.adc),
        status="suspect",
        message="; ".join(filter(None, (message, estimate.message))),
    )


def guess_r_par(reading: Reading, g: np.ndarray) -> float | None:
    """The r_par [ohm] by a reading and approximate conductances (rows, cols) [S] alone.

    None: the circuit's own, or the readings do not determine it.
    """
    found = r_par_shift(reading, g, neighbours=False)
    if found is None or not found.exceeds(_UNCHECKED) or found.chi2 > _CHI2_VALID:
        return None
    off = abs(found.shift) > _TOLERANCE * series_scale(reading.circuit)
    return None if off else reading.circuit.r_par + found.shift


def with_nominal_r_par(reading: Reading, r_par: float) -> Reading:
    """What a board with the circuit's r_par would read, from one whose r_par is another [ohm]."""
    circuit = reading.circuit
    with np.errstate(divide="ignore"):
        adc = circuit.r_ref / (circuit.r_ref / reading.adc + circuit.r_par - r_par)
    return replace(reading, adc=np.minimum(adc, 1.0))


def _max_r_par(reading: Reading) -> float:
    """The largest r_par [ohm] that the largest reading allows."""
    r_ref = reading.circuit.r_ref
    return r_ref / max(reading.adc.max(), 1e-9) - r_ref


def _unexplained(reading: Reading, estimate: Estimate) -> float:
    """chi^2 a reading beyond what noise explains."""
    return (estimate.residual / reading.fitted_noise) ** 2 - 1.0


def _count_lightly_touched(reading: Reading, g: np.ndarray) -> int:
    """Number of cells that seem touched, but so lightly that a wrong r_par may be the cause."""
    touched, _ = _hold_rest(reading, g)
    return np.count_nonzero((g > _LIGHTLY * reading.bounds[0]) & ~touched)


def _hold_rest(
    reading: Reading, g: np.ndarray, neighbours=True, lifted=LIFTED
) -> tuple[np.ndarray, np.ndarray]:
    """(rows, cols) bool, the touched cells and their neighbours, and g with the others at rest.

    Fabric and cover carry a little of a touch to the cells around it.
    """
    lift = g >= lifted * reading.bounds[0]
    touched = lift.copy()
    if neighbours:
        touched[1:] |= lift[:-1]
        touched[:-1] |= lift[1:]
        touched[:, 1:] |= lift[:, :-1]
        touched[:, :-1] |= lift[:, 1:]
    touched &= reading.circuit.populated
    return touched, np.where(touched, g, reading.bounds[0]) * reading.circuit.populated
