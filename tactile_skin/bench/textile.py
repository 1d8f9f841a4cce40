"""A skin richer than any solver's model: what a real textile, its wires and its board add.

The solvers know stripes without resistance, cells on one curve and a frame read in an instant.
Here stripes have resistance, are cut and touch one another; cells scatter, leak sideways and stick;
the board drifts, saturates and reads one row after the other while the contact moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import shift

from ..physics.circuit import Circuit
from ..physics.curve import GRAM, PressureCurve

_SCANS = 4  # a frame is their mean, see scenes.read_out


@dataclass(frozen=True)
class Textile:
    """What differs from the solvers' model; the defaults differ in nothing.

    Attributes:
        noise: RMS of a sample, in ADC steps.
        r_par, r_ref: true value over the one that the solver is given.
        curve: relative error of what a load adds to each cell's conductance, of random sign.
        scatter: relative RMS scatter of the same from cell to cell.
        rest: relative RMS scatter of the cells' resistance at rest.
        line: resistance of a stripe from its lead to its far end [ohm].
        lateral: share of a cell's conductance above rest that its four neighbours gain.
        moving: cells that the contact moves while the board reads from the first row to the last.
        open: lines whose lead is cut: they read nothing, but still connect their cells.
        broken: lines cut within the matrix: the far part floats.
        short: pairs of neighbouring lines that touch.
        stuck: cells that stay pressed by a random load.
        ceiling: ADC ratio above which the input saturates.
        full_scale: lines whose samples read full scale whatever is connected.
    """

    noise: float = 0.0
    r_par: float = 1.0
    r_ref: float = 1.0
    curve: float = 0.0
    scatter: float = 0.0
    rest: float = 0.0
    line: float = 0.0
    lateral: float = 0.0
    moving: float = 0.0
    open: int = 0
    broken: int = 0
    short: int = 0
    stuck: int = 0
    ceiling: float = 1.0
    full_scale: int = 0


def read(textile: Textile, circuit: Circuit, curve: PressureCurve, force, rng) -> np.ndarray:
    """One frame as the board sends it: (rows, cols) ADC ratio, rounded, mean of 4 scans.

    Args:
        force: (rows, cols) [N], at the middle of the scan.
    """
    ratio = expose(textile, circuit, curve, force, rng)
    return sample(textile, circuit, ratio, rng)


def expose(
    textile: Textile, circuit: Circuit, curve: PressureCurve, force, rng, factor=1.0
) -> np.ndarray:
    """(rows, cols) ADC ratio before noise and rounding.

    Args:
        factor: (rows, cols) times what a cell conducts otherwise: it crept, or lost its contact.
    """
    rows, cols = circuit.shape
    lines = rng.permutation(rows + cols)  # which lines are damaged
    cuts = {line: 0 for line in lines[: textile.open]}
    for line in lines[textile.open : textile.open + textile.broken]:
        cuts[line] = int(rng.integers(1, cols if line < rows else rows))
    pairs = np.delete(np.arange(rows + cols - 1), rows - 1)  # line, and the next of its kind
    shorts = rng.choice(pairs, textile.short, replace=False)
    gain = 1.0 + textile.curve * rng.choice((-1.0, 1.0))
    gain = gain * np.exp(textile.scatter * rng.standard_normal((rows, cols)))
    at_rest = np.exp(textile.rest * rng.standard_normal((rows, cols))) / curve.rest_resistance
    stuck = rng.choice(rows * cols, textile.stuck, replace=False)
    stuck_at = rng.uniform(50.0, 1000.0, textile.stuck) * GRAM
    heading = rng.uniform(0.0, 2.0 * np.pi)

    def resistance(force):
        added = gain * (1.0 / curve.resistance(force) - 1.0 / curve.rest_resistance)  # S
        added.flat[stuck] = 1.0 / curve.resistance(stuck_at)
        if textile.lateral:
            padded = np.pad(added, 1)
            around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
            added = added + textile.lateral * around
        return 1.0 / (factor * (at_rest + added))

    if textile.moving:
        way = textile.moving * (np.arange(rows) / max(rows - 1, 1) - 0.5)  # cells, of each row
        steps = way[:, None] * (np.sin(heading), np.cos(heading))
        moved = np.array([shift(force, step, order=1, prefilter=False) for step in steps])
        rho = two_terminal(np.array([resistance(f) for f in moved]), textile.line, cuts, shorts)
        rho = rho[np.arange(rows), np.arange(rows)]
    else:
        rho = two_terminal(resistance(force), textile.line, cuts, shorts)
    true = replace(
        circuit, r_par=circuit.r_par * textile.r_par, r_ref=circuit.r_ref * textile.r_ref
    )
    ratio = true.ratio(rho)
    for line in lines[::-1][: textile.full_scale]:
        if line < rows:
            ratio[line] = 1.0
        else:
            ratio[:, line - rows] = 1.0
    return ratio


def sample(textile: Textile, circuit: Circuit, ratio: np.ndarray, rng) -> np.ndarray:
    """Mean of 4 noisy, rounded samples, none above the ceiling; ADC ratio."""
    full = circuit.full_scale
    steps = [
        np.rint(np.minimum(ratio, textile.ceiling) * full + textile.noise * noise)
        for noise in rng.standard_normal((_SCANS, *ratio.shape))
    ]
    top = np.rint(textile.ceiling * full)
    # full scale is no analogue value: a line tied to it passes any ceiling
    top = np.where(ratio >= 1.0, full, top)
    return np.clip(steps, 0.0, top).mean(0) / full


class Board:
    """One board: its cells and its damage are the same in all frames."""

    def __init__(self, textile: Textile, circuit: Circuit, curve: PressureCurve, seed):
        self._textile, self._circuit, self._curve, self._seed = textile, circuit, curve, seed

    def expose(self, force) -> np.ndarray:
        """(n, rows, cols) ADC ratio before noise and rounding, of forces (n, rows, cols) [N]."""
        skin = self._textile, self._circuit, self._curve
        return np.array([expose(*skin, f, np.random.default_rng(self._seed)) for f in force])

    def sample(self, ratio, rng) -> np.ndarray:
        """(n, rows, cols) frames as the board sends them."""
        return np.array([sample(self._textile, self._circuit, r, rng) for r in ratio])

    def at_rest(self, n: int, rng) -> np.ndarray:
        """(n, rows, cols) frames of the untouched board."""
        return self.sample(np.repeat(self.expose(np.zeros((1, *self._circuit.shape))), n, 0), rng)


def two_terminal(resistance, line: float = 0.0, cuts=None, shorts=()) -> np.ndarray:
    """Resistance between the leads of row i and column j, every other lead floating.

    A stripe is a chain of equal resistors from its lead to its far end, a cell hanging at the end
    of each. The currents of the cells are the unknowns: with the Laplacian's incidence B from
    cells to lines, (diag(resistance) + shared stripe resistance) current = B voltage, so that
    B^T (...)^-1 B is the conductance matrix between the leads. It holds for `line` = 0 as well.

    Args:
        resistance: (..., rows, cols) of the cells [ohm], finite.
        line: of a stripe [ohm].
        cuts: line number (rows, then columns) -> crossing before which it is cut; 0: its lead.
        shorts: line numbers that touch the next one, at their leads.

    Returns:
        (..., rows, cols) [ohm], infinite for a line whose lead is cut.
    """
    resistance = np.asarray(resistance, dtype=float)
    rows, cols = resistance.shape[-2:]
    cells = rows * cols
    incidence, shared = _wiring(rows, cols, line, cuts or {})
    nodes = incidence.shape[1]
    frames = resistance.reshape(-1, cells)
    rho = np.empty((len(frames), rows, cols))
    ties = np.zeros((nodes, nodes))
    for first in shorts:
        ends = np.ix_((first, first + 1), (first, first + 1))
        ties[ends] += np.array([[1.0, -1.0], [-1.0, 1.0]])  # 1 ohm
    wired = incidence.any(0) | ties.any(0)
    for k, r in enumerate(frames):
        if line:
            current = np.linalg.solve(np.diag(r) + shared, incidence)
        else:
            current = incidence / r[:, None]
        between = (incidence.T @ current + ties)[np.ix_(wired, wired)]
        # singular along the constant vector; filling it does not touch rho
        fill = between.trace() / len(between) ** 2
        inverse = np.full((nodes, nodes), np.nan)
        inverse[np.ix_(wired, wired)] = np.linalg.inv(between + fill)
        lead, other = inverse[:rows, :rows].diagonal(), inverse[rows:, rows:].diagonal()[:cols]
        rho[k] = lead[:, None] + other - 2.0 * inverse[:rows, rows : rows + cols]
    return np.where(np.isnan(rho), np.inf, rho).reshape(resistance.shape)


def _wiring(rows: int, cols: int, line: float, cuts: dict):
    """Incidence (cells, leads + floating parts) and stripe resistance shared by two cells [ohm]."""
    row, col = (index.ravel() for index in np.indices((rows, cols)))
    incidence = np.zeros((rows * cols, rows + cols + len(cuts)))
    shared = np.zeros((rows * cols,) * 2)
    place = {cut: rows + cols + n for n, cut in enumerate(cuts)}  # node of the far part
    for stripe in range(rows + cols):
        is_row = stripe < rows
        mine = np.flatnonzero(row == stripe if is_row else col == stripe - rows)
        sign, length = (1.0, cols) if is_row else (-1.0, rows)
        cut = cuts.get(stripe, length)
        near, far = mine[:cut], mine[cut:]
        segments = line / length * np.arange(1, length + 1)
        if near.size:
            incidence[near, stripe] = sign
            shared[np.ix_(near, near)] += np.minimum.outer(segments[:cut], segments[:cut])
        if far.size:
            incidence[far, place[stripe]] = sign
            shared[np.ix_(far, far)] += np.minimum.outer(segments[: far.size], segments[: far.size])
    return incidence, shared
