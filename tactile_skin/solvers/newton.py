# SPDX-License-Identifier: Apache-2.0
"""The exact inverse of the circuit: the maximum of a concave function (docs/derivation.md).

    phi(g) = log det L(g) - sum rho_measured * g,   g between rest and the curve's end

has the gradient rho(g) - rho_measured and the Hessian -t_ab^2. It is strictly concave: one
solution, no local optimum. The bounds make it solvable for noisy readings too, where the free
maximum may lie at negative conductances.

The other readouts have no such function: there the same steps solve rho(g) = rho_measured, and a
step must bring the unknowns' own readings nearer. A grounded matrix has a closed form.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from ..physics import compiled, laplacian, readouts
from ..physics.laplacian import INEXACT, Network
from ..physics.quadratic import solve_in_box
from ..physics.readouts import BOUND
from ..physics.readouts.floating import Floating
from .estimate import Estimate
from .fixed_point import START_STEPS, closed_form, first_guess, iterate, last_guess
from .reading import NEAR_REST, Reading
from .suspect import estimate_from_force

MAX_STEPS = 40  # 5 is usual; bounds the time of readings that no circuit explains
# Share of the supply by which exact readings differ, and a closed form may miss the voltage of a
# driven line: so little that no cell is off by 1e-3 g.
EXACT = 1e-9
_DONE = 1e-7  # relative step of g that may be left; a thousandth of a gram is 6e-7 at full load
# Share of the largest misfit from which on a cell at rest is an unknown: what is less is most often
# the error of others.
_JOIN_SHARE = 0.5
# Times its noise by which a valid reading is missed: where a bound acts, this is the best fit in
# another measure than ADC steps. 2 in 1,000 exceed 2, 1 in 10,000 exceeds 2.5.
_SLACK = 2.2
_DENSE = 400  # unknowns up to which a Cholesky factor is faster than conjugate gradients
# Share of its right side that such a step of a noisy reading leaves: how many steps there are is
# decided by which cells are at rest.
_LEFT = 0.1
_CURVED = 10.0  # times the square of a step, relative, that the next one may be
_PAST = 0.1  # of its slope at the begin of a step, that phi may fall with at the end
_ROUNDS = 1e-2  # times a cell's conductance at rest, below which a step's phi is but rounding
_NUMBERS = BOUND, _DONE, _CURVED, _JOIN_SHARE, _PAST, _DENSE  # as `compiled.newton_step` takes them


def newton(reading: Reading, start: Estimate | None = None) -> Estimate:
    """Projected Newton from `start`, or from a few steps of the fixed point."""
    reading.need_all_cells("newton")
    if (found := closed_form(reading, EXACT)) is not None:
        (g, steps, done), iterations = found, 0
        if steps and not reading.noise:  # of an exact reading the last digits
            g, iterations, done = maximise(reading, g)
    else:
        g = first_guess(reading) if start is None else last_guess(reading, start)
        g, steps = iterate(reading, g, START_STEPS, 1e-9)
        low = reading.bounds[0]
        g = np.where(g < NEAR_REST * low, low * reading.circuit.populated, g)
        g, iterations, done = maximise(reading, g)
    cells = reading.circuit.populated
    log_g = np.log(np.where(cells, g, reading.bounds[0]))
    return estimate_from_force(
        reading.curve.force_at(log_g) * cells,
        reading,
        "newton",
        steps + iterations,
        converged=done,
        slack=_SLACK if reading.noise else 1.0,
        network=(log_g, g, readouts.solve(reading.circuit, g, derivatives=False)),
    )


def maximise(reading: Reading, g: np.ndarray) -> tuple[np.ndarray, int, bool]:
    """Climb phi from g (rows, cols) [S] to its maximum between the bounds.

    Unknowns are the touched cells: those above rest, or whose own reading asks for more. Steps are
    taken in g itself, in which rho is close enough to linear that two or three suffice; single
    precision serves, since the misfit is evaluated in double.

    Returns:
        g, the number of steps, whether it converged.
    """
    network = readouts.solve(reading.circuit, g)
    # A cell at rest is left there if noise explains it: else half of them are lifted, in turns.
    noise = reading.noise if reading.noise_given else 0.0
    scale, offset = reading.apparent
    falls = np.square(reading.rho + offset) / (reading.circuit.r_ref * scale)  # - d rho / d adc
    chance = _SLACK * noise / reading.circuit.full_scale * falls
    given, moved = np.array([reading.rho, *reading.bounds, chance]), np.inf
    for iteration in range(MAX_STEPS):
        found = _next(reading, given, g, network, moved)
        if found is None:
            return g, iteration, True
        g, network, moved = found
        if reading.late():
            break
    return g, iteration + 1, False


def _next(reading: Reading, given: np.ndarray, g: np.ndarray, network, moved: float):
    """Return g after a step, its network, and by which share g moved; None: g is the maximum."""
    circuit, (rho_measured, low, high, chance) = reading.circuit, given
    if isinstance(network, Floating):
        numbers = np.array([*_NUMBERS, _ROUNDS * low.min()])
        found = compiled.newton_step(given, numbers, g, *network.inverse[1:], moved)
        if found is not None:
            n, moved, log_det, k, (g, rho) = found
            return (g, Floating(circuit, g, Network(log_det, k, rho)), moved) if n else None
    rho = reading.rho_of(network)
    gradient = rho - rho_measured
    # A cell on its bound is held there if the gradient pushes outwards.
    at_rest = g <= low * BOUND
    held = np.where(at_rest, gradient <= chance, (g >= high / BOUND) & (gradient >= 0.0))
    held |= ~circuit.populated
    gradient[held] = 0.0
    off = np.abs(gradient) / rho
    # Steps converge quadratically, but a cell at rest may be missing.
    if _CURVED * moved**2 < _DONE and (off <= _DONE * g * rho)[at_rest].all():
        return None
    held |= at_rest & (off <= _JOIN_SHARE * off.max())
    (free,) = (~held).ravel().nonzero()
    if not free.size:
        return None
    # rho log(rho / rho_measured) is the gradient to first order, and closer to linear far off
    pull = rho * np.log(rho / rho_measured)
    step = np.zeros(g.shape)
    step.reshape(-1)[free] = _step(reading, network, g, free, pull.ravel()[free])
    gradient[held] = 0.0
    new, network = _climb(reading, g, network, step, gradient)
    return new, network, np.abs(new.ravel()[free] / g.ravel()[free] - 1.0).max()


def _climb(reading: Reading, g, network, step, gradient):
    """Return g after the step, or as much of it as gains height, and the network there."""
    low, high = reading.bounds
    height = None
    for halving in range(40):
        new = np.minimum(np.maximum(g + step, np.maximum(low, 0.05 * g)), high)
        new *= reading.circuit.populated
        there = readouts.solve(reading.circuit, new)
        change = new - g
        if np.abs(change).max() < _ROUNDS * low.min():  # so near that rounding would decide
            break
        climbs = np.vdot(gradient, change)
        if reading.circuit.readout_class.two_terminal and (
            np.vdot(there.rho - reading.rho, change) >= -_PAST * climbs
        ):
            break
        if height is None:
            height = _height(reading, g, network, gradient)
        if _height(reading, new, there, gradient) >= height + 1e-4 * climbs:
            break
        if halving == 3:  # past the bounds' corners only the gradient is sure to climb
            step = 8.0 * gradient / np.square(reading.rho_of(network))
        step = 0.5 * step
    return new, there


def _height(reading: Reading, g: np.ndarray, network, gradient) -> float:
    """phi(g) but for a constant; det K is 1 / (det L_reduced * total conductance).

    Of other readouts, how near the unknowns' readings are.
    """
    if not reading.circuit.readout_class.two_terminal:
        apart = np.log(reading.rho_of(network) / reading.rho)[gradient != 0.0]
        return -float(apart @ apart)
    populated_rho = np.where(reading.circuit.populated, reading.rho, 0.0)
    return -network.inverse.log_det - np.log(g.sum()) - (populated_rho * g).sum()


def _step(reading: Reading, network, g: np.ndarray, free: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return x (n,) with (- d rho_a / d g_b) x = b over the free cells, to single precision.

    Of two-terminal readings that is (t_ab^2), which scaled by sqrt(g) on both sides has a diagonal
    (g rho)^2 <= 1, and the x between the cells' bounds that is nearest in its measure. That of
    others is scaled by rho and by g.
    """
    symmetric = reading.circuit.readout_class.two_terminal
    if symmetric and free.size > _DENSE:
        share = _LEFT if reading.noise else INEXACT
        return laplacian.hessian_solver(network.inverse, g, free, share)(b)
    rho = reading.rho_of(network)
    left, right = (np.sqrt(g), np.sqrt(g)) if symmetric else (1.0 / rho, g)
    falls = (rho + reading.apparent[1]) / network.adc  # - d rho / d adc
    row, col = np.divmod(free.astype(np.int32), np.int32(g.shape[1]))
    matrix = network.sensitivity(falls * left, free.astype(np.int32), row, col + np.int32(len(g)))
    left, right = left.flat[free], right.flat[free]
    matrix *= right.astype(np.float32)
    if symmetric:
        ends = ((bound - g).flat[free] / right for bound in reading.bounds)
        x, solved, _ = solve_in_box(matrix, left * b, *ends)
        if solved:
            return right * x
    factor, pivots, _ = lapack.sgetrf(matrix.T, overwrite_a=True)  # of the transposed
    return right * lapack.sgetrs(factor, pivots, left * b, trans=1)[0]
