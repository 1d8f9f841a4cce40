"""What a change of the circuit would do to a frame, past what its cells can take.

An ohm more of r_par, or a short between two lines, changes the readings by a pattern. A part of it
the cells can take: those that a fit leaves free, as far as its prior lets them; or, if no prior is
to be believed, those that something touches, while the others rest. What is left is compared with
what is left of the misfit (docs/derivation.md). calibration/evidence.py gathers it over frames.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs, lapack
from scipy.ndimage import binary_dilation

from ..findings.finding import Finding, Kind
from ..findings.finding import lines as lines_of
from ..physics.circuit import Circuit
from .reading import Linearised, Reading, r_par_pattern, rest_reading
from .suspect import NormalEquations, model_variance, rounded

# Standard deviations of the scores of a short and of r_par beyond which a frame is suspect. Chosen
# on valid frames of blobs, rects and random loads so that all tests together call less than 2 % of
# them suspect; scored on others (tests/yardsticks/solvers.py, detection). A score's spread on valid
# frames is above 1, since the prior is not Gaussian.
_SHORT_LIMIT, R_PAR_LIMIT = 3.7, 5.5
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
# Standard deviations by which a cell that is held at rest must want to conduct more to be touched,
# and how often such cells are sought: a palm's soft rim is some cells wide.
_Z, _SEARCHES = 3.5, 6
# RMS of log conductance of the cells of a sound fabric at rest, where it was not measured: 0.03 to
# 0.05 (health/rest_picture.py has the least).
_REST_SCATTER = 0.05
_RIM = 1.1  # times its conductance at rest: the rim of a palm is above
_RIM_SHARE = 0.05  # of `series_scale` by which r_par is too small beside such a rim
_RIM_AGREES = 2.0  # standard deviations by which r_par is too large beside such a rim
MIN_SCALE = 0.15  # of r_ref: what a board's r_par may be where none is configured
_MOST_PARTS = 300.0  # ohm, the same whatever r_ref is: two CD4051 have 250 at 5 V, and more below
RELEVANT = 0.025  # of `series_scale`: less moves hard touches by 8 (blobs) to 25 g (rects) a cell
SETTLED = 3.5  # standard deviations that may be left with the right r_par: 1 in 2000
# chi^2 a reading that may be left beside a shift of r_par around a touch, where the skin rests:
# below 3 beside a short or an r_par 10 % off, above 20 around nearly all palms (16 x 16, 8 x 12).
_CHI2_REST = 5.0
# Standard deviations of chi^2 that a smaller r_par may leave of the cells that are held at rest:
# around palms of sound grounded boards it leaves more, where r_par is too large 1 (seed 77300).
_CHI2_HELD = 2.0
_RIDGE = 1e-5  # of the touched cells' precision: the readings may not determine all of them
_MAX_CELLS = 400  # touched cells up to which to ask: the time is that of a Cholesky factor
FEW = 0.3  # of the readings: fewer cells at rest confirm no short (pictures of seed 45100)
BESIDE = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)


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

    def leaves_noise(self, readings: int) -> bool:
        """Whether the cells that nothing touches then read as at rest, of so many readings."""
        held = max(self.at_rest * readings, 1.0)
        return self.chi2 * readings < held + _CHI2_HELD * (2.0 * held) ** 0.5


def series_scale(circuit: Circuit) -> float:
    """Series resistance [ohm] that errors of r_par are compared with: r_par may be given as 0."""
    scale = MIN_SCALE * circuit.r_ref
    if circuit.readout != "grounded":  # whose readings tell only the sum of both, to a share
        scale = min(scale, _MOST_PARTS)
    return max(circuit.r_par, scale)


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
    touched, _ = hold_rest(reading, g, neighbours, lifted)
    if reading.curve.offset is None and not touched.any():
        return None  # another fabric reads so, too
    most = min(reading.n_informative, _MAX_CELLS if neighbours else 0.75 * reading.n_informative)
    for _ in range(1 + _SEARCHES if neighbours else 1):
        if np.count_nonzero(touched) >= most:
            return None
        shift, lightly = _shift(reading, g, touched, neighbours)
        if shift is None or not lightly.any():
            break
        touched |= lightly
    return shift


def _shift(
    reading: Reading, g: np.ndarray, touched: np.ndarray, own_error: bool
) -> tuple[RParShift | None, np.ndarray]:
    """With these cells touched; and (rows, cols) which others are, whatever r_par is."""
    held, n = reading.circuit.populated & ~touched, reading.n_informative
    g = np.where(touched, g, reading.bounds[0]) * reading.circuit.populated
    variance = reading.spread**2 + (model_variance(reading) if own_error else 0.0)
    model = reading.linearised(g, np.sqrt(variance))
    both = np.stack([r_par_pattern(reading, model).ravel(), model.misfit.ravel()], 1)
    cells = np.flatnonzero(touched)
    jacobian = model.jacobian(np.arange(g.size, dtype=np.int32), cells)
    jacobian *= g.ravel()[cells].astype(np.float32)
    left = past(both.astype(np.float32), jacobian)[0] if cells.size else both
    (information, score), (_, square) = (left.T @ left).tolist()
    if information <= _MIN_LEFT * np.square(both[:, 0]).sum():
        return None, held
    slack, shift = _ROUNDED if rounded(reading) else 1.0, -score / information
    chi2 = (square - score**2 / information) / n
    by_no_r_par = (left[:, 1] + shift * left[:, 0]).reshape(g.shape)
    wants, own = model.network.pull(model.weight * by_no_r_par), model.network.own * model.weight
    by_scatter = _wanted_by_scatter(reading, model, held & (own > 0.0))
    limit = np.hypot(slack, np.where(binary_dilation(touched, BESIDE), 0.0, by_scatter))
    lightly = held & (own > 0.0) & (wants > _Z * limit * own)
    return RParShift(shift, slack * information**-0.5, chi2, 1.0 - cells.size / n), lightly


def _wanted_by_scatter(reading: Reading, model: Linearised, held: np.ndarray) -> float:
    """RMS by which held cells (rows, cols) want another conductance since their rest scatters, in
    what one standard deviation of their own reading makes them want; 0 where it was measured.

    All cells of two lines add to it. Of one fabric, which stands for all. Away from touched cells
    they must want more than that: with those taken out that scatter upwards, the others make r_par
    seem 20 ohm larger.
    """
    if reading.curve.offset is not None or not reading.noise or not held.any():
        return 0.0
    scatter = _REST_SCATTER * np.random.default_rng(0).standard_normal(held.shape) * held
    misfit = model.weight * model.network.change(scatter * model.g)
    wants = model.network.pull(model.weight * misfit)[held]
    return float(np.square(wants / (model.network.own * model.weight)[held]).mean() ** 0.5)


def by_score(
    reading: Reading,
    model: Linearised,
    equations: NormalEquations,
    pull: np.ndarray,
    broad: bool = False,
    rough: bool = False,
) -> Finding | None:
    """Return what the scores of a short of two lines and of a wrong r_par tell of a fit.

    A palm presses less and less towards its rim. A prior that prefers touches with
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
        found = [(finding, way) for finding, way in found if not way]
    if rough or not found:
        return found[0][0] if found else None
    around = r_par_shift(reading, model.g)
    if around is None or around.chi2 > _CHI2_REST:
        too_small = next((finding for finding, way in found if way > 0), None)
        return too_small if too_small and _beside_rim(reading, model.g, 1) else None
    for finding, way in found:
        # a fit hides another r_par along neighbouring lines, which looks like a short
        off = _way(reading, model.g, around, alone=way != 0)
        if off and way in (0, off):
            return _wrong_r_par(reading, off)
        if not way and around.at_rest >= FEW:
            return finding
    return None


def _way(reading: Reading, g: np.ndarray, around: RParShift, alone: bool) -> int:
    """Which way r_par is off by a relevant amount: 1 too small, -1 too large, 0 neither."""
    # Cells that are lightly touched make r_par seem smaller than it is, never larger. If that is
    # alone what a frame is suspect for, more is asked of it.
    limit = R_PAR_LIMIT if alone and around.shift < 0.0 else SETTLED
    possible = reading.circuit.r_par + around.shift + SETTLED * around.std > 0.0
    relevant = abs(around.shift) > RELEVANT * series_scale(reading.circuit)
    if not (possible and relevant and around.exceeds(limit)):
        return 0
    if around.shift > 0.0:
        return int(alone or around.at_rest >= FEW)
    at_rest = around.leaves_noise(reading.n_informative)
    return -1 if at_rest and _beside_rim(reading, g, -1) else 0


def _beside_rim(reading: Reading, g: np.ndarray, way: int) -> bool:
    """Whether r_par is off that way if the rim of a palm is touched, which lowers what r_par seems.

    Less is at rest then, and tells of r_par. So if r_par is too large, it need only say so too.
    """
    rim = r_par_shift(reading, g, lifted=_RIM)
    if rim is None:
        return False
    if way < 0:
        return rim.shift < -_RIM_AGREES * rim.std
    return rim.exceeds(R_PAR_LIMIT) and rim.shift > _RIM_SHARE * series_scale(reading.circuit)


def _candidates(
    reading: Reading, model: Linearised, equations: NormalEquations, pull: np.ndarray
) -> list[tuple[Finding, int]]:
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
        axis, i = (0, line) if line < rows - 1 else (1, line - rows)
        short = Finding(Kind.SHORT, "frame", **lines_of(axis, i, i + 1))
        found.append((score[:-1].max() / limit, short, 0))
    if abs(score[-1]) > R_PAR_LIMIT:
        way = 1 if score[-1] < 0 else -1
        found.append((abs(score[-1]) / R_PAR_LIMIT, _wrong_r_par(reading, way), way))
    found.sort(key=lambda of: -of[0])
    return [(finding, way) for _, finding, way in found]


def _wrong_r_par(reading: Reading, way: int) -> Finding:
    form = "r_par too low" if way > 0 else "r_par too high"
    return Finding(Kind.CIRCUIT, form, numbers={"r_par": reading.circuit.r_par})


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


def hold_rest(
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
