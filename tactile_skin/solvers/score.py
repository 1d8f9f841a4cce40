"""What a change of the circuit would do to a frame, past what its cells can take.

An ohm more of r_par, or a short between two lines, changes the readings by a pattern. A part of it
the cells can take: those that a fit leaves free, as far as its prior lets them; or, if no prior is
to be believed, those that something touches, while the others rest. What is left is compared with
what is left of the misfit (docs/derivation.md). calibration/evidence.py gathers it over frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs, lapack
from scipy.ndimage import binary_dilation

from ..physics.circuit import Circuit
from .estimate import Estimate
from .fixed_point import last_guess
from .reading import Linearised, Reading, r_par_pattern, rest_reading, rest_shift
from .suspect import NormalEquations, model_variance, rounded

# Standard deviations of the scores of a short and of r_par beyond which a frame is suspect. Chosen
# on valid frames of blobs, rects and random loads so that all tests together call less than 2 % of
# them suspect; scored on others (tests/yardsticks/solvers.py, detection). A score's spread on valid
# frames is above 1, since the prior is not Gaussian.
_SHORT_LIMIT, _R_PAR_LIMIT = 3.7, 5.5
# Equal readings that are rounded to whole steps err equally, and do not average out: factor by
# which a score may then be larger. Without it one valid frame in 5 is suspect.
_ROUNDED = 2.8
# ADC steps at full scale that a valid reading may be off, where so little is known of the ADC that
# not even its noise is given: is it 2^bits or one less? Chosen as the least that keeps frames over
# 1024 below 2 % suspect (seed 11), scored on others.
_GAIN = 0.5
# Share of a fault's squared pattern, of a short and of r_par, below which a fit takes it; and that
# the touched cells must leave of r_par's.
_ABSORBED, _MIN_LEFT = (1e-3, 1e-4), 1e-3
# Chosen on simulated boards with the right r_par and with one 5 and 10 % off, under blobs, rects
# and palms; scored on others (tests/yardsticks/solvers.py, "another board", "R_par in a frame").
_LIFTED = 5.0  # times its conductance at rest that a touched cell has: 8 g on the shipped curve
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
_RIDGE = 1e-5  # of the touched cells' precision: the readings may not determine all of them
_MAX_CELLS = 400  # touched cells up to which to ask: the time is that of a Cholesky factor
_FEW = 0.3  # of the readings: fewer cells at rest confirm no short (pictures of seed 45100)
_LIGHTLY = 1.02  # times its conductance at rest from which on a cell counts as lightly touched
_MANY = 4  # lightly touched cells from which on r_par may be the cause
BESIDE = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)

Fit = Callable[[Reading, np.ndarray], Estimate]


def past(columns: np.ndarray, jacobian: np.ndarray, factor=None) -> tuple[np.ndarray, np.ndarray]:
    """What unknowns leave of a change of the readings, in standard deviations.

    Args:
        columns: (readings, k).
        jacobian: (readings, n) d model / d x of the unknowns, x = log of a conductance.
        factor: (n, n) U of U^T U = J^T J + curvature of a prior on x; None: there is none.

    Returns:
        (readings, k) what is left, (n, k) the change of x that takes the rest.
    """
    along = jacobian.T @ columns
    if factor is None:
        precision = jacobian.T @ jacobian
        precision.reshape(-1)[:: len(precision) + 1] *= 1.0 + _RIDGE
        taken = solve(precision, along)
    else:
        taken = lapack.spotrs(factor.T, along, lower=1)[0]
    return columns - jacobian @ taken, taken


def solve(precision: np.ndarray, b: np.ndarray) -> np.ndarray:
    """precision^-1 b, of a matrix that is positive definite, or hardly."""
    (posv,) = get_lapack_funcs(("posv",), (precision,))
    _, x, bad = posv(precision, b)
    return np.linalg.lstsq(precision, b, rcond=None)[0] if bad else x


class RParShift(NamedTuple):
    """By how much r_par would have to be larger, to first order.

    Attributes:
        shift, std: [ohm].
        chi2: a reading, that is left then.
        at_rest: share of the readings, whose cells nothing touches.
    """

    shift: float
    std: float
    chi2: float
    at_rest: float

    def exceeds(self, limit: float) -> bool:
        return abs(self.shift) > limit * self.std


def series_scale(circuit: Circuit) -> float:
    """Series resistance [ohm] that errors of r_par are compared with: r_par may be given as 0."""
    return max(circuit.r_par, _MIN_SCALE * circuit.r_ref)


def r_par_shift(
    reading: Reading, g: np.ndarray, neighbours: bool = True, lifted: float = _LIFTED
) -> RParShift | None:
    """Of a frame with conductances g (rows, cols) [S]; None: the readings do not determine it.

    Newton's step for r_par past what the touched cells take, with no prior on these.

    Args:
        neighbours: whether cells next to touched ones may be touched too, and the readings differ
            from the model by its own error; without, it takes half the time, but fabric and cover
            must carry nothing from cell to cell.
        lifted: times its conductance at rest from which on a cell counts as touched.
    """
    touched, g = _hold_rest(reading, g, neighbours, lifted)
    cells, n = np.flatnonzero(touched), reading.n_informative
    if cells.size >= min(n, _MAX_CELLS if neighbours else 0.75 * n):
        return None
    variance = reading.spread**2 + (model_variance(reading) if neighbours else 0.0)
    model = reading.linearised(g, np.sqrt(variance))
    both = np.stack([r_par_pattern(reading, model).ravel(), model.misfit.ravel()], 1)
    jacobian = model.jacobian(np.arange(g.size, dtype=np.int32), cells)
    jacobian *= g.ravel()[cells].astype(np.float32)
    left = past(both.astype(np.float32), jacobian)[0] if cells.size else both
    (information, score), (_, square) = (left.T @ left).tolist()
    if information <= _MIN_LEFT * np.square(both[:, 0]).sum():
        return None
    slack = _ROUNDED if rounded(reading) else 1.0
    chi2 = (square - score**2 / information) / n
    at_rest = 1.0 - cells.size / n
    return RParShift(-score / information, slack * information**-0.5, chi2, at_rest)


def by_score(
    reading: Reading,
    model: Linearised,
    equations: NormalEquations,
    pull: np.ndarray,
    broad: bool = False,
    rough: bool = False,
) -> str:
    """What the scores of a short between neighbouring lines and of a wrong r_par tell of a fit.

    Empty: nothing. A palm presses less and less towards its rim. A prior that prefers touches with
    an edge then leaves misfits that look like a short, or like another r_par. So what a score with
    the prior finds, the readings around the touch must confirm without it.

    Args:
        model: of the fit.
        pull: (n,) - d cost / d x of the unknowns: what is left to the fit's minimum.
        broad: whether the whole skin is loaded, and the prior that of an even load.
        rough: whether each cell is so independently: then the prior is to be believed.
    """
    found = _candidates(reading, model, equations, pull)
    if broad:  # the level prior pulls a fit along r_par's pattern on a valid board too
        found = [(text, way) for text, way in found if not way]
    if rough or not found:
        return found[0][0] if found else ""
    around = r_par_shift(reading, model.g)
    if around is None or around.chi2 > _CHI2_REST:
        too_small = next((text for text, way in found if way > 0), "")
        return too_small if too_small and _beside_rim(reading, model.g) else ""
    for text, way in found:
        # a fit hides another r_par along neighbouring lines, which looks like a short
        off = _way(reading, around, alone=way != 0)
        if off and way in (0, off):
            return _r_par_text(reading, off)
        if not way and around.at_rest >= _FEW:
            return text
    return ""


def _way(reading: Reading, around: RParShift, alone: bool) -> int:
    """Which way r_par is off by a relevant amount: 1 too small, -1 too large, 0 neither."""
    # Cells that are lightly touched make r_par seem smaller than it is, never larger. If that is
    # alone what a frame is suspect for, more is asked of it.
    limit = _R_PAR_LIMIT if alone and around.shift < 0.0 else _SETTLED
    possible = reading.circuit.r_par + around.shift + _SETTLED * around.std > 0.0
    relevant = abs(around.shift) > _RELEVANT * series_scale(reading.circuit)
    return int(np.sign(around.shift)) if possible and relevant and around.exceeds(limit) else 0


def _beside_rim(reading: Reading, g: np.ndarray) -> bool:
    """Whether r_par is too small, a palm's rim touched: it can only make r_par seem smaller."""
    rim = r_par_shift(reading, g, lifted=_RIM)
    least = _RIM_SHARE * series_scale(reading.circuit)
    return rim is not None and rim.exceeds(_R_PAR_LIMIT) and rim.shift > least


def _candidates(
    reading: Reading, model: Linearised, equations: NormalEquations, pull: np.ndarray
) -> list[tuple[str, int]]:
    """What may be wrong by the scores of a fit with its prior, the likelier first.

    Each with which way r_par would have to move: 1 larger, -1 smaller, 0 if it is not about r_par.
    With p the pattern, m the misfit, and what is left of p past the unknowns, the score is
    p.m - (what takes p).pull over the root of p.left.
    """
    rows, network, readings = len(model.weight), model.network, equations.readings
    equal = _equal_lines(reading, reading.steps)
    if reading.curve.offset is not None and equal.any():  # lines that differ at rest are two
        rest = rest_reading(reading.circuit, reading.curve) * reading.circuit.full_scale
        equal &= _equal_lines(reading, rest)
    pairs = np.flatnonzero(equal)
    pairs += pairs >= rows - 1  # the last row and the first column are no neighbours
    # a short is a conductance between the two lines of a pair, r_par one before every reading
    p = np.empty((readings.size, pairs.size + 1), np.float32)
    lines = pairs.astype(np.int32)
    p[:, :-1] = network.sensitivity(model.weight, readings, lines, lines + np.int32(1))
    p[:, -1] = r_par_pattern(reading, model).ravel()[readings]
    left, taken = past(p, equations.jacobian, equations.factor)
    score = p.T @ model.misfit.ravel()[readings].astype(np.float32) - taken.T @ pull
    if not reading.noise_given:  # what a gain that is off by _GAIN adds
        gain = (reading.steps / reading.spread).ravel()[readings].astype(np.float32)
        gain = _GAIN / reading.circuit.full_scale * (left.T @ gain)
        score = np.sign(score) * np.maximum(np.abs(score) - np.abs(gain), 0.0)
    least = np.append(np.full(pairs.size, _ABSORBED[0]), _ABSORBED[1]) * np.square(p).sum(0)
    score /= np.sqrt(np.maximum((p * left).sum(0), least) + 1e-30)
    score /= _ROUNDED if rounded(reading) else 1.0
    found = []
    # of so many pairs that read alike one exceeds the limit by chance
    limit = (_SHORT_LIMIT**2 + 2.0 * np.log(max(pairs.size, 1))) ** 0.5
    if pairs.size and score[:-1].max() > limit:
        line = pairs[score[:-1].argmax()]
        name, i = ("rows", line) if line < rows - 1 else ("columns", line - rows)
        text = f"{name} {i} and {i + 1} have equal readings: are they shorted?"
        found.append((score[:-1].max() / limit, text, 0))
    if abs(score[-1]) > _R_PAR_LIMIT:
        way = 1 if score[-1] < 0 else -1
        found.append((abs(score[-1]) / _R_PAR_LIMIT, _r_par_text(reading, way), way))
    return [(text, way) for _, text, way in sorted(found, reverse=True)]


def _r_par_text(reading: Reading, way: int) -> str:
    word = "low" if way > 0 else "high"
    return f"r_par = {reading.circuit.r_par:g} ohm is too {word} for this reading: measure it"


def _equal_lines(reading: Reading, steps: np.ndarray) -> np.ndarray:
    """Which neighbouring lines read alike, to the frame's noise.

    Args:
        steps: (rows, cols) [ADC steps].

    Returns:
        (rows - 1 + cols - 1,) bool, of rows, then of columns.
    """
    noise, found = reading.fitted_noise, []
    for values, known in ((steps, reading.known), (steps.T, reading.known.T)):
        pair = known[1:] & known[:-1]
        n = np.maximum(pair.sum(1), 1)
        step = (values[1:] - values[:-1]) * pair
        apart = np.einsum("ij,ij->i", step, step) / n
        found.append(apart < 2.0 * noise**2 * (1.0 + 3.0 * np.sqrt(2.0 / n)))
    return np.concatenate(found)


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
    if relevant and first.exceeds(_R_PAR_LIMIT) and first.chi2 < chi2:
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
    if left.exceeds(_SETTLED) or irrelevant or not off.exceeds(_R_PAR_LIMIT):
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
    message = f"r_par = {circuit.r_par:g} ohm: the readings fit {estimate.r_par:.0f} ohm better"
    return replace(
        estimate,
        residual=reading.residual(reading.model(last_guess(reading, estimate))),
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


def _max_r_par(reading: Reading) -> float:
    """The largest r_par [ohm] that the largest reading allows."""
    r_ref = reading.circuit.r_ref
    return r_ref / max(reading.adc.max(), 1e-9) - r_ref


def _count_lightly_touched(reading: Reading, g: np.ndarray) -> int:
    """Number of cells that seem touched, but so lightly that a wrong r_par may be the cause."""
    touched, _ = _hold_rest(reading, g)
    return np.count_nonzero((g > _LIGHTLY * reading.bounds[0]) & ~touched)


def _hold_rest(
    reading: Reading, g: np.ndarray, neighbours=True, lifted=_LIFTED
) -> tuple[np.ndarray, np.ndarray]:
    """(rows, cols) bool, the touched cells and their neighbours, and g with the others at rest.

    Fabric and cover carry a little of a touch to the cells around it.
    """
    touched = g >= lifted * reading.bounds[0]
    if neighbours:
        touched = binary_dilation(touched, BESIDE)
    touched &= reading.circuit.populated
    return touched, np.where(touched, g, reading.bounds[0]) * reading.circuit.populated
