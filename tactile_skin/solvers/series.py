"""A series resistance that is not the circuit's: the cells that nothing touches give it away.

r_par lies before every reading. A wrong one moves each cell of a hard touch; at the cells at rest
it shows: too low, they would have to read less than nothing, too high, and all of them seem a
little touched, which a fit then believes. Held at rest, they leave r_par nowhere to hide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas, lapack

from ..physics import laplacian
from ..physics.circuit import Circuit
from .estimate import Estimate
from .fixed_point import last_guess
from .reading import Reading, r_par_pattern, rest_shift
from .suspect import LIFTED, ROUNDED, model_variance, network_of, rounded

_STEPS = 4
_RIM = 1.1  # times its conductance at rest: even the rim of a palm lies above
_LOOSE = 0.05  # of `series_scale` by which r_par is too small past such a rim
_LEAST = 0.15  # of r_ref: what a board's series resistance may be where none is configured
_MATTERS = 0.025  # of `series_scale`: less moves the hardest touches by some grams
_TOLERANCE = 0.25  # of `series_scale` that r_par may be off; more is another fault
_SURE = 5.5  # standard deviations: another r_par is told from the circuit's own
_UPRIGHT = 3.5  # the same, which a right one may leave
_ALONE = 30.0  # chi^2 a reading that the circuit's nonlinearity may leave beside a wrong r_par
# The same of a skin around the touches that is not at rest: below 3 beside a short or an r_par
# 10 % off, above 20 around nearly all palms (16 x 16 and 8 x 12).
_SOFT = 5.0
_CLEAR = 4.0  # as _ALONE, of a frame that is not suspect
_SURER = 8.0  # standard deviations beside a network's force, which no further fit checks
_TOLD = 1e-3  # share of r_par's pattern, squared, that the touched cells cannot take
_RIDGE = 1e-5  # of the touched cells' precision: the readings may leave a combination open
_DENSE = 400  # touched cells up to which to ask: the time is that of a Cholesky factor
_SEEMS = 1.02  # times its conductance at rest: a cell above it seems touched
_MANY = 4  # cells that seem hardly touched: from here on r_par may be the cause

Fit = Callable[[Reading, np.ndarray], Estimate]


class Lean(NamedTuple):
    """By how much r_par would have to be larger, as if the readings followed it linearly.

    Attributes:
        shift, std: [ohm].
        left: chi^2 a reading that is left then.
    """

    shift: float
    std: float
    left: float

    def beyond(self, limit: float) -> bool:
        return abs(self.shift) > limit * self.std


def series_scale(circuit: Circuit) -> float:
    """Series resistance [ohm] by whose share an error of r_par counts: r_par may be told as 0."""
    return max(circuit.r_par, _LEAST * circuit.r_ref)


def lean(
    reading: Reading, g: np.ndarray, beside: bool = True, lifted: float = LIFTED
) -> Lean | None:
    """Of a frame with conductances g (rows, cols) [S]; None: the readings cannot tell.

    Args:
        beside: whether the cells next to touched ones may be touched as well, and the readings be
            off the model; without, it takes half the time, and fabric and cover must carry nothing
            from cell to cell.
        lifted: times its conductance at rest from which on a cell counts as touched.

    Newton's step for r_par, past what the touched cells take of its pattern p: with the readings'
    misfit m and Jacobian J of the touched cells, in standard deviations of noise and of what the
    model leaves out, and R = 1 - J J^+, it is - p.R m / p.R p.
    """
    circuit = reading.circuit
    free, g = _held_at_rest(reading, g, beside, lifted)
    network = laplacian.solve(g)
    adc = circuit.ratio(network.rho)
    spread = np.full(g.shape, reading.spread)  # ADC steps
    if beside:
        spread = np.sqrt(spread**2 + model_variance(reading))
    misfit = (reading.misfit(adc) / spread).ravel()
    weight = adc * adc * (circuit.full_scale / circuit.r_ref) / spread * reading.known
    pattern = (weight * r_par_pattern(reading, network.k)).ravel()
    both = np.array([pattern, misfit])
    gram = both @ both.T
    size = gram[0, 0]
    free = np.flatnonzero(free).astype(np.int32)
    if free.size >= min(reading.told, _DENSE if beside else 0.75 * reading.told):
        return None
    if free.size:
        row, col = np.divmod(free, np.int32(circuit.cols))
        told = np.arange(g.size, dtype=np.int32)
        jacobian = laplacian.sensitivity(network.k, weight, told, row, col + np.int32(circuit.rows))
        jacobian *= g.ravel()[free].astype(np.float32)
        precision = blas.ssyrk(1.0, jacobian.T, lower=1)
        diagonal = precision.T.reshape(-1)[:: free.size + 1]
        diagonal *= 1.0 + _RIDGE
        factor, bad = lapack.spotrf(precision, lower=1, clean=0, overwrite_a=1)
        if bad:
            return None
        pull = both.astype(np.float32) @ jacobian
        taken = lapack.strtrs(factor, pull.T, lower=1)[0]
        gram -= taken.T @ taken
    (left, score), (_, chi) = gram.tolist()
    if left <= _TOLD * size:
        return None
    slack = ROUNDED[0] if rounded(reading) else 1.0
    return Lean(-score / left, slack * left**-0.5, (chi - score**2 / left) / reading.told)


def confirmed(reading: Reading, g: np.ndarray, r_par: bool) -> bool:
    """Whether a score test of a fit is right, of which a palm is no example.

    A palm presses ever less towards its rim. A prior that prefers touches with an edge then leaves
    misfits that look like a short, or like another r_par. So the skin around the touch must be at
    rest, and an r_par be off by more than does not matter.

    Args:
        g: (rows, cols) conductance [S] that the fit found.
        r_par: whether the test is that for r_par.
    """
    scale = series_scale(reading.circuit)
    found = lean(reading, g)
    if found is not None and found.left <= _SOFT:
        # cells that are lightly touched make r_par seem smaller than it is, never larger
        sure = _UPRIGHT if found.shift > 0.0 else _SURE
        return not r_par or (abs(found.shift) > _MATTERS * scale and found.beyond(sure))
    rim = lean(reading, g, lifted=_RIM)
    # what is left of a rim can only make r_par seem smaller than it is
    return bool(r_par and rim is not None and rim.beyond(_SURE) and rim.shift > _LOOSE * scale)


def seek(reading: Reading, fit: Fit, nominal: Estimate) -> Estimate:
    """The frame with another r_par, if that explains it better than the circuit's own.

    Args:
        fit: the estimate of a reading from conductances (rows, cols) [S].
        nominal: what it finds with the circuit's r_par, and what is returned if nothing is found.
    """
    g = last_guess(reading, nominal)
    before = _hardly_touched(reading, g)
    if nominal.status == "failed" or (nominal.status == "ok" and before < _MANY):
        return nominal
    own, most, first = reading.circuit.r_par, _most(reading), lean(reading, g)
    most_left = _CLEAR if nominal.status == "ok" else _ALONE
    matters = first is not None and abs(first.shift) > _MATTERS * series_scale(reading.circuit)
    if matters and first.beyond(_SURE) and first.left < most_left:
        r_par = own + first.shift
    elif most < own:
        r_par = most
    else:
        return nominal
    found = follow(reading, fit, g, r_par)
    if found is None:
        return nominal
    if nominal.status == "ok":  # what that explains, the other must explain with fewer cells
        after = _hardly_touched(reading, last_guess(reading, found))
        better = found.status == "ok" and 2 * after < before
    else:
        better = found.status == "ok" or 2 * _excess(reading, found) < _excess(reading, nominal)
    if not better:
        return nominal
    found = replace(found, iterations=nominal.iterations + found.iterations)
    return named(found, reading)


def follow(reading: Reading, fit: Fit, g: np.ndarray, r_par: float) -> Estimate | None:
    """The frame with an r_par near a guess [ohm], as a board with that r_par would see it.

    None: no r_par there fits best, or the circuit's own does as well.

    Args:
        g: (rows, cols) conductance [S] of each cell from which to begin.
    """
    circuit, iterations = reading.circuit, 0
    for _ in range(_STEPS):
        r_par = min(r_par, _most(reading))
        if r_par < 0.0 or abs(r_par - circuit.r_par) > _TOLERANCE * series_scale(circuit):
            return None
        trial = _with_r_par(reading, r_par)
        estimate = fit(trial, _held_at_rest(reading, g)[1])
        iterations += estimate.iterations
        g = last_guess(reading, estimate)
        if not reading.given:  # the noise that was measured with another r_par held its misfit
            trial = replace(trial, noise=estimate.noise)
        left = lean(trial, g)
        if left is None or reading.late():
            return None
        if not left.beyond(_UPRIGHT):
            break
        r_par += left.shift
    off = left._replace(shift=r_par + left.shift - circuit.r_par)
    if (
        left.beyond(_UPRIGHT)
        or not off.beyond(_SURE)
        or abs(off.shift) < _MATTERS * series_scale(circuit)
    ):
        return None
    return replace(estimate, iterations=iterations, r_par=r_par)


def _with_r_par(reading: Reading, r_par: float) -> Reading:
    """The frame as one of a board with this r_par [ohm], whose rest was measured with it."""
    circuit, curve = reading.circuit, reading.curve
    if curve.offset is not None:
        shift = (r_par - circuit.r_par) * rest_shift(circuit, curve)
        rest = np.where(circuit.populated, 1.0 / curve.rest_resistance + shift, 1.0)
        least = 0.1 / curve.rest_resistance  # the shift is a first order one
        curve = curve.resting_at(1.0 / np.maximum(rest, least))
    return replace(reading, circuit=replace(circuit, r_par=r_par), curve=curve)


def named(estimate: Estimate, reading: Reading) -> Estimate:
    """The estimate that an r_par other than the circuit's explains, as one that says so."""
    circuit = reading.circuit
    _, _, rho = network_of(estimate.force, reading)
    message = f"r_par = {circuit.r_par:g} ohm explains it less well than {estimate.r_par:.0f} would"
    return replace(
        estimate,
        residual=reading.residual(circuit.ratio(rho)),
        status="suspect",
        message="; ".join(filter(None, (message, estimate.message))),
    )


def guess(reading: Reading, g: np.ndarray) -> float | None:
    """The r_par [ohm] that a reading leans to beside conductances (rows, cols) [S] known in part.

    None: the circuit's own, or it cannot be told.
    """
    found = lean(reading, g, beside=False)
    if found is None or not found.beyond(_SURER) or found.left > _CLEAR:
        return None
    off = abs(found.shift) > _TOLERANCE * series_scale(reading.circuit)
    return None if off else reading.circuit.r_par + found.shift


def as_read_by_the_circuit(reading: Reading, r_par: float) -> Reading:
    """What a board with the circuit's r_par would read, from one whose r_par is another [ohm]."""
    circuit = reading.circuit
    with np.errstate(divide="ignore"):
        adc = circuit.r_ref / (circuit.r_ref / reading.adc + circuit.r_par - r_par)
    return replace(reading, adc=np.minimum(adc, 1.0))


def _most(reading: Reading) -> float:
    """What the largest reading leaves for r_par [ohm]."""
    r_ref = reading.circuit.r_ref
    return r_ref / max(reading.adc.max(), 1e-9) - r_ref


def _excess(reading: Reading, estimate: Estimate) -> float:
    """chi^2 a reading past what noise explains."""
    return (estimate.residual / reading.fitted_noise) ** 2 - 1.0


def _hardly_touched(reading: Reading, g: np.ndarray) -> int:
    """Number of cells that seem touched, but so lightly that a wrong r_par could be why."""
    free, _ = _held_at_rest(reading, g)
    return np.count_nonzero((g > _SEEMS * reading.bounds[0]) & ~free)


def _held_at_rest(
    reading: Reading, g: np.ndarray, beside=True, lifted=LIFTED
) -> tuple[np.ndarray, np.ndarray]:
    """(rows, cols) bool, the touched cells and those beside them, and g with the others at rest.

    Fabric and cover carry a little of a touch to the cells around it.
    """
    touch = g >= lifted * reading.bounds[0]
    free = touch.copy()
    if beside:
        free[1:] |= touch[:-1]
        free[:-1] |= touch[1:]
        free[:, 1:] |= touch[:, :-1]
        free[:, :-1] |= touch[:, 1:]
    free &= reading.circuit.populated
    return free, np.where(free, g, reading.bounds[0]) * reading.circuit.populated
