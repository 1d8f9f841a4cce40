"""Does the circuit model explain the reading? Tests on a fitted frame (docs/derivation.md)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack

from ..physics import laplacian
from ..physics.kernel import connected_rho
from .estimate import Estimate
from .reading import ROUNDING_NOISE, Reading, r_par_pattern, rest_reading

# Thresholds in standard deviations. Chosen so that all tests together call less than 2 % of sound
# frames suspect; a score's spread on sound frames is above 1, since the prior is not Gaussian.
_RESIDUAL = 2.8
_SHORT = 3.7
_R_PAR = 5.5
# Where readings are rounded to whole steps those that are alike err alike, and do not average out:
# times by which a score, and a residual, may then be larger.
ROUNDED = 2.8, 1.2
# Share of a reading that a sound skin's may differ from the model's: 0.5 % of a touch that fabric
# and cover carry to the next cells (paper section IV), some ohm of the stripes, rows read in turn.
# Chosen on streams of damaged boards (bench faults, seeds 3 and 4), scored on others.
_MODEL = 0.003
_ROUNDED_MOST = 1.3  # times the noise of rounding that it may be measured as
_MEASURED = 1.1  # times a noise that was measured in the same frame, which is not exact
_ASIDE = 6.0  # standard deviations of the mean misfit, where the noise was measured
_BEYOND = 5.0  # of noise, past what no skin can read
_OPEN = 0.5  # times the reading at rest: fabrics differ from the curve by less
_EXACT_NOISE = 0.02  # ADC steps that an exact reading may miss
# Share of a fault's pattern, squared, below which the fit can take all of it: a short's, r_par's.
_HIDDEN = 1e-3, 1e-4
_TOLD = 1e-3  # the same, above which the readings alone tell a wrong r_par from the touched cells'
LIFTED = 5.0  # times its conductance at rest: a cell below it is as good as untouched
_SHORT_OF = 1.01  # ADC steps below a ceiling to which noise lets a saturated reading fall
# ADC steps at full scale that a sound reading may be off: is it 2^bits or one less? Chosen as the
# least that keeps frames over 1024 below 2 % suspect (seed 11), scored on others.
_GAIN = 0.5
_GAP = 3.0  # times that: how far below the largest readings others are looked for
_PILE = 8, 0.5  # readings at the largest, others below for each: a ceiling, or a flat touch
_CEILING = 30, 0.25  # the same: more than noise leaves of a flat touch
_UNEQUAL = 0.4  # ADC steps of noise that makes equal readings differ


def by_reading(reading: Reading) -> str:
    """Readings that no skin can give, whatever presses on it; for methods that fit nothing too.

    A load only raises a reading, from that at rest to that of a short circuit behind r_par. Noise
    keeps even a flat touch's readings apart.
    """
    circuit, steps, known = reading.circuit, reading.steps, reading.known
    margin = _BEYOND * reading.noise + 1.0
    rest = rest_reading(circuit, reading.curve) * circuit.full_scale
    low = known & (steps < _OPEN * rest - margin)
    high = known & (steps > circuit.ratio(0.0) * circuit.full_scale + margin)
    if low.any():
        return (
            f"{_place(low, known)}: below half of what an untouched skin reads: is a lead open, or "
            "not connected?"
        )
    if high.any():
        most = circuit.ratio(0.0) * circuit.full_scale
        where = _place(high, known)
        return f"{where}: above {most:.0f} ADC steps, the most that r_ref and r_par allow"
    touched = steps.max() > rest.max() + margin
    return piled(reading, *_CEILING) if touched and reading.noise > _UNEQUAL else ""


def _place(bad: np.ndarray, known: np.ndarray) -> str:
    """The line that most of the bad readings are on, or their number and the first."""
    count = int(np.count_nonzero(bad))
    for name, axis in (("row", 1), ("column", 0)):
        lines = bad.sum(axis)
        k = int(lines.argmax())
        if 2 * lines[k] > count and lines[k] > 1 and 2 * lines[k] > known.sum(axis)[k]:
            return f"{name} {k}, {lines[k]} readings"
    row, col = np.argwhere(bad)[0]
    return f"{count} reading{'s' * (count > 1)}, the first at row {row}, column {col}"


def piled(reading: Reading, least: int = _PILE[0], others: float = _PILE[1]) -> str:
    """Whether the largest readings stand at one height, with few below: a saturated input?

    A flat touch reads like that too: only the circuit tells whether there are cells that read so.
    """
    top = reading.steps.max()
    circuit = reading.circuit
    if top >= circuit.ratio(np.max(reading.curve.least_resistance)) * circuit.full_scale:
        return ""  # cells at the curve's end read alike
    below = (top - reading.steps)[reading.known]
    at_top = np.count_nonzero(below < _SHORT_OF)
    if at_top < least or np.count_nonzero(below < _GAP * _SHORT_OF) > (1.0 + others) * at_top:
        return ""
    return f"{at_top} readings stand at {top:.0f} ADC steps: is the input saturated?"


def by_residual(
    reading: Reading, adc: np.ndarray, floor: float = _EXACT_NOISE, slack: float = 1.0
) -> str:
    """Why the misfit to the model's ADC ratio (rows, cols) is beyond noise; empty if it is not.

    Args:
        floor: noise [ADC steps] that the method supposes at least.
        slack: times the noise by which the method may miss a sound reading.
    """
    misfit = reading.misfit(adc)
    n = max(reading.told, 1)
    noise = slack * max(reading.noise, floor) * (ROUNDED[1] if rounded(reading) else 1.0)
    noise *= 1.0 if reading.given else _MEASURED
    square = np.square(misfit)
    excess = 1.0 if reading.excess is None else np.square(reading.excess)
    variance = noise**2 * excess + model_variance(reading)
    if (square / variance).sum() <= n * (1.0 + _RESIDUAL * (2.0 / n) ** 0.5):
        if reading.given or abs(misfit.sum()) <= _ASIDE * np.sqrt(variance.sum()):
            return ""
        side = "above" if misfit.sum() > 0.0 else "below"
        return f"readings lie {side} the model throughout, by {abs(misfit.sum()) / n:.2f} ADC steps"
    residual = (square.sum() / n) ** 0.5
    noise = np.mean(variance) ** 0.5
    most = {"row": square.sum(1), "column": square.sum(0)}
    lines = [f"{k} {v.argmax()}" for k, v in most.items() if v.max() > 0.5 * square.sum()]
    # a cell that conducts too little lowers its own reading most, then its row's and its column's
    why = "a bad contact?" if len(lines) == 2 else "open, or not connected?"
    where = f", most of it in {', '.join(lines)}: {why}" if lines else ""
    where = where or (f", {why}" if (why := piled(reading)) else "")
    return f"residual of {residual:.2f} ADC steps, noise explains {noise:.2f}{where}"


def model_variance(reading: Reading) -> np.ndarray:
    """(rows, cols) [ADC steps squared] of what every real skin reads off the circuit's model.

    None of an exact reading, which comes from a simulation or a laboratory.
    """
    return np.square(_MODEL * reading.steps) if reading.noise else np.zeros(reading.adc.shape)


def by_cost(reading: Reading, cost: float) -> str:
    """A load on the whole skin whose variation the level prior does not explain.

    With that prior, which is Gaussian, twice the cost follows chi^2 with one degree of freedom a
    reading on a sound frame. A series resistance that the circuit does not have, of all faults,
    leaves no misfit: it makes the load look even.
    """
    n = reading.told
    if abs(2.0 * cost / n - 1.0) <= _RESIDUAL * (2.0 / n) ** 0.5:
        return ""
    kind = "evenly" if 2.0 * cost < n else "unevenly"
    return (
        f"the whole skin reads loaded, more {kind} than a sound one: is r_par = "
        f"{reading.circuit.r_par:g} ohm right?"
    )


def by_score(
    reading: Reading, k, weight, misfit, told, jacobian, factor, ahead, g, broad
) -> list[tuple[str, bool]]:
    """Score tests for a short between neighbouring lines and for a wrong r_par.

    How far does the misfit lie along the change p that the fault would make in the readings, past
    what the fit can hide: z = p.m / sqrt(p.p - q^T H^-1 q), q = J^T p. No second fit is needed.

    Args:
        k: inverse of the Laplacian (lines, lines) [ohm].
        weight, misfit: (rows, cols), -d reading / d rho [1/ohm] and reading - model, both in
            standard deviations.
        told, jacobian, factor: of the fit over its unknowns, see map._Step.
        ahead: what the unknowns still lack to the fit's minimum.
        g: conductances of the unknowns [S].
        broad: the level prior was used; its fit leans on r_par's pattern even when sound.

    Returns:
        what may be wrong, the likelier first, each with whether it is r_par.
    """
    rows = weight.shape[0]
    pairs = np.flatnonzero(np.concatenate([_alike(reading), _alike(reading, turned=True)]))
    pairs += pairs >= rows - 1  # the last row and the first column are no neighbours
    # a short is a conductance between the two lines of a pair, r_par one before every reading
    p = np.empty((told.size, pairs.size + 1), np.float32)
    lines = pairs.astype(np.int32)
    p[:, :-1] = laplacian.sensitivity(k, weight, told, lines, lines + np.int32(1))
    p[:, -1] = (weight * r_par_pattern(reading, k)).ravel()[told]
    size = np.square(p).sum(0)
    along = jacobian.T @ p
    hidden = (along * lapack.spotrs(factor.T, along, lower=1)[0]).sum(0)
    score = p.T @ misfit.ravel()[told].astype(np.float32) - along.T @ ahead
    if reading.noise:
        # what a gain that is off by _GAIN adds, past what the fit takes of it
        gain = (reading.steps / reading.spread).ravel()[told].astype(np.float32)
        taken = lapack.spotrs(factor.T, jacobian.T @ gain, lower=1)[0]
        gain = _GAIN / reading.circuit.full_scale * (p.T @ gain - along.T @ taken)
        score = np.sign(score) * np.maximum(np.abs(score) - np.abs(gain), 0.0)
    least = np.append(np.full(pairs.size, _HIDDEN[0]), _HIDDEN[1])
    score /= np.sqrt(np.maximum(size - hidden, least * size) + 1e-30)
    score /= ROUNDED[0] if rounded(reading) else 1.0
    found = []
    if pairs.size and score[:-1].max() > _SHORT:
        line = pairs[score[:-1].argmax()]
        name, i = ("rows", line) if line < rows - 1 else ("columns", line - rows)
        text = f"{name} {i} and {i + 1} read alike, as if shorted"
        found.append((score[:-1].max() / _SHORT, text, False))
    touched = g > LIFTED / reading.curve.points[0][1]
    if not broad and abs(score[-1]) > _R_PAR and _can_tell(jacobian[:, touched], p[:, -1]):
        way = "low" if score[-1] < 0 else "high"
        text = f"readings lean as if r_par = {reading.circuit.r_par:g} ohm was too {way}"
        found.append((abs(score[-1]) / _R_PAR, text, True))
    return [(text, is_r_par) for _, text, is_r_par in sorted(found, reverse=True)]


def _can_tell(jacobian: np.ndarray, p: np.ndarray) -> bool:
    """Whether the readings alone, without the prior, tell the pattern p from a change of the cells.

    With about as many cells touched as readings known they cannot: the misfit is then the prior's
    doing, and where the load is rougher than the prior expects it leans on a sound circuit too.
    Cells that are all but untouched do not count: a wrong r_par is what lifts them.
    """
    jacobian = jacobian.astype(float)
    precision = jacobian.T @ jacobian
    ridge = 1e-6 * precision.diagonal()  # the readings may leave a combination of cells open
    along = jacobian.T @ p
    hidden = along @ cho_solve(cho_factor(precision + np.diag(ridge)), along)
    return bool(p @ p - hidden > _TOLD * (p @ p))


def rounded(reading: Reading) -> bool:
    """Whether nothing but rounding to whole steps is known to trouble the readings."""
    most = ROUNDING_NOISE if reading.given else _ROUNDED_MOST * ROUNDING_NOISE
    return 0.0 < reading.noise <= most


def _alike(reading: Reading, turned: bool = False) -> np.ndarray:
    """(lines - 1,) bool: neighbouring lines whose readings differ by no more than noise."""
    steps, known = reading.steps, reading.known
    if turned:
        steps, known = steps.T, known.T
    pair = known[1:] & known[:-1]
    n = np.maximum(pair.sum(1), 1)
    apart = np.where(pair, np.square(np.diff(steps, axis=0)), 0.0).sum(1) / n
    noise = reading.fitted_noise
    return apart < 2.0 * noise**2 * (1.0 + 3.0 * np.sqrt(2.0 / n))


_SIGNS = np.array([1.0, -1.0])[:, None, None]


def judge(
    force,
    reading: Reading,
    method: str,
    iterations=0,
    *,
    converged=True,
    slack=None,
    network=None,
) -> Estimate:
    """Spread and status from the misfit.

    How far would each cell's resistance have to move, alone, to meet its own reading
    (d u / d log R = -g u^2 rho^2 / R_ref)? An impossible reading is always suspect, a misfit only
    after a method that fits.

    Args:
        slack: times the noise by which a method that fits may miss a sound reading; None: it does
            not fit.
        network: `network_of(force, reading)` where it is known already.
    """
    circuit, curve = reading.circuit, reading.curve
    resistance, g, rho = network or network_of(force, reading)
    model = circuit.ratio(rho)
    slope = g * np.square(model * rho) * (circuit.full_scale / circuit.r_ref)  # steps per log R
    misfit = reading.misfit(model)
    shift = np.sqrt(np.square(misfit) + max(reading.noise, 1e-9) ** 2) / np.maximum(slope, 1e-9)
    # both ends at once: half the time
    ends = curve.force_at(_SIGNS * np.minimum(shift, 50.0) - np.log(resistance))
    std = 0.5 * (ends[0] - ends[1])
    message = by_reading(reading)
    if slack and not message:
        message = by_residual(reading, model, slack=slack)
    status = "suspect" if message else "ok"
    if not converged:
        status, message = "failed", f"no convergence in {iterations} steps"
    if circuit.mask is not None:
        std *= circuit.populated
    residual, noise = reading.rms(misfit), reading.noise
    return Estimate(force, std, residual, status, message, method, iterations, noise=noise)


def network_of(force, reading: Reading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows, cols) resistance [ohm], conductance [S] and two-terminal resistance [ohm] of cells."""
    resistance = reading.curve.resistance(force)
    g = 1.0 / resistance
    if reading.circuit.mask is not None:
        g *= reading.circuit.populated
    return resistance, g, connected_rho(g)
