# SPDX-License-Identifier: Apache-2.0
"""What a fit of `map` found, and the forces that follow from it, with their standard deviations.

Forces cost as much as the fit. They are made of the one that is kept.

The readings of a grounded sense line determine the shares of its cells. How much these conduct
together follows from what they leave of the supply, and a hard load leaves little but noise. A fit
then is where its prior pulls it, which counts each of a line's cells as if it said something of its
own, and its slopes there say too much of harder loads (docs/derivation.md). So the level of each
line has a distribution, and forces are means over it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..findings.finding import Finding
from . import prior, suspect
from .estimate import Estimate, spread, where_unread
from .prior import SPREAD, NormalEquations, Point, differences, force_of
from .reading import NEAR_REST, Reading

_WIDEN = 1.2  # what the measured coverage requires; not of loads on all cells
_NODES = 15  # at which a level's distribution is taken
_FAR = 4.0  # standard deviations to which it is followed
_LEAST = 1e-3  # share of a precision that is left without the prior's part in it: less is rounding


class Step(NamedTuple):
    """One step of Gauss-Newton."""

    free: np.ndarray  # (n,) flat indices of the unknowns
    dx: np.ndarray  # (n,) change of log g
    gain: float  # predicted, in units of 1/2 chi^2
    equations: NormalEquations | None = None  # of the unknowns that met no bound; None: not formed
    solved: bool = True  # False: the numbers are beyond what its equations can hold


class Fit(NamedTuple):
    """What a fit found, before forces and their standard deviations are made of it."""

    reading: Reading
    point: Point
    step: Step
    broad: bool  # whether its prior is that of a load on all of the skin
    iterations: int
    finding: Finding | None
    failure: str  # why it has not converged; empty: it has

    @property
    def status(self) -> str:
        """As of `Estimate`."""
        return suspect.status_of(self.finding, self.failure)[0]

    @property
    def g(self) -> np.ndarray:
        """(rows, cols) conductance [S]."""
        return self.point.model.g

    def estimate(self) -> Estimate:
        """Return forces, and how sure they are."""
        converged = self.step.solved and not self.failure
        force, std, adc = _forces(self.reading, self.point, self.step, converged, self.broad)
        status, message = suspect.status_of(self.finding, self.failure)
        return Estimate(
            force,
            std,
            self.reading.residual(adc),
            status,
            message,
            "map",
            self.iterations,
            self.reading.noise,
            finding=self.finding,
        )


def _forces(
    reading: Reading, point: Point, step: Step, converged: bool, broad: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the force of each cell [N], its standard deviation [N] and the ADC ratio it gives.

    Each is (rows, cols). Where a fit has converged, each cell is smoothed with its neighbours, or
    the level of each line found where readings share a sum; the ADC ratio is then the fit's.
    """
    circuit, equations = reading.circuit, step.equations
    g, std_x, adc = point.model.g, _std_x(point, equations), point.model.adc
    # Readings that share a sum share its error, of which each cell's standard deviation tells
    # the network nothing: it then trusts neighbours too much.
    independent = not circuit.readout_class.shares_sum
    if converged and not broad and independent and equations is not None:
        smoothed = prior.with_neighbours(reading, point, equations, std_x)
        g, std_x, adc = smoothed or (g, std_x, adc)
    cells = circuit.populated
    of_lines = equations if converged and not independent else None
    log_g = np.log(np.where(cells, g, 1.0))
    force = reading.curve.force_at(log_g) * cells
    wide = 1.0 if of_lines is not None or (broad and independent) else _WIDEN
    std = spread(reading.curve, log_g, wide * std_x) * cells
    if of_lines is not None:
        force, std = with_levels(reading, point, of_lines, broad, std)
        std = _WIDEN * std
    any_force = reading.known & cells & (reading.adc >= circuit.near_short)
    if equations is not None and reading.topped.any():
        std = np.hypot(std, spread(reading.curve, log_g, _held(reading, point, equations)) * cells)
    at_end = reading.topped | any_force
    if at_end.any():  # up to the curve's end all is as likely
        end = reading.curve.max_force
        more = np.maximum(end - force, np.where(any_force, 0.5 * end, 0.0)) / 3**0.5
        std = np.where(at_end, np.maximum(std, more), std)
    return force, where_unread(reading, point.model, force, std, equations), adc


def _held(reading: Reading, point: Point, equations: NormalEquations) -> np.ndarray:
    """(rows, cols) standard deviation of x that is hidden where topped readings are held.

    They may lie anywhere above it, and draw the others along.
    """
    free, held = equations.unknowns, np.zeros(point.x.shape)
    ends = np.flatnonzero(reading.topped & (point.model.weight > 0.0)).astype(np.int32)
    root = point.model.jacobian(ends, free) * point.gx.ravel()[free]
    covariance = equations.covariance
    more = (without(covariance, root.T) - covariance).diagonal()
    held.flat[free] = np.sqrt(np.maximum(more, 0.0))
    return held


def _std_x(point: Point, equations: NormalEquations | None) -> np.ndarray:
    """(rows, cols) standard deviation of x: of the posterior for cells that met no bound.

    From each one's own reading and prior alone for cells held at a bound.
    """
    std_x = 1.0 / np.sqrt(point.curvature + 1e-12)
    if equations is not None:
        std_x.flat[equations.unknowns] = np.sqrt(equations.inverse.diagonal())
    return std_x


def with_levels(
    reading: Reading, point: Point, equations: NormalEquations, broad: bool, std: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return force and its standard deviation (rows, cols) [N], the means over lines' levels.

    With z for what a line's cells conduct in the fit over what they do, readings are linear in z:
    it is normal. Before it is read no level is more likely than one that is a times as high.

    Args:
        point: of the fit.
        broad: whether its prior is that of a load on all of the skin.
        std: (rows, cols) [N] of the fit's forces; it stays that of cells that are no unknowns.
    """
    free, cells, curve = equations.unknowns, reading.circuit.populated, reading.curve
    log_g = np.log(np.where(cells, point.model.g, 1.0))
    force, std = curve.force_at(log_g) * cells, std.copy()
    if not free.size:
        return force, std
    of = _line(reading, free)  # (n,)
    on = 1.0 * (of[:, None] == np.arange(reading.adc.shape[1 - reading.circuit.sense_axis]))
    share = on * point.model.g.ravel()[free, None]
    share /= np.maximum(share.sum(0), np.finfo(float).tiny)  # of what each line conducts
    covariance = equations.covariance
    slope = point.slope.ravel()[free].astype(float)  # what the steps have left
    if broad:
        covariance = without(covariance, _of_mean(reading, point)[free, None])
    else:
        pull, between = _of_lines(reading, point)
        slope += pull.ravel()[free]
        values, vectors = np.linalg.eigh(between)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        covariance = without(covariance, on / np.maximum(on.sum(0), 1.0) @ root)
    with_line = covariance @ share
    variance = (share * with_line).sum(0)
    z = 1.0 - with_line.T @ slope
    follows = with_line[np.arange(free.size), of] / variance[of]  # its line's level, each cell
    least = (on * (point.model.g / reading.bounds[1]).ravel()[free, None]).max(0)
    log_z, weight = _distribution(z, np.sqrt(variance), np.minimum(least, 1.0))
    pictures = np.repeat(log_g.reshape(1, -1), _NODES, 0)
    pictures[:, free] -= follows * log_z[:, of]
    forces = curve.force_at(pictures.reshape(_NODES, *log_g.shape)).reshape(_NODES, -1)[:, free]
    mean = (weight[:, of] * forces).sum(0)
    square = (weight[:, of] * np.square(forces - mean)).sum(0)
    force.flat[free] = mean
    own = np.zeros(log_g.shape)  # of x, past what the level leaves open
    left = covariance.diagonal() - np.square(follows) * variance[of]
    own.flat[free] = np.sqrt(np.maximum(left, 0.0))
    now = spread(curve, -np.log(curve.resistance(force)), own)
    std.flat[free] = np.sqrt(square + np.square(now.ravel()[free]))
    return force, std


def _line(reading: Reading, cells: np.ndarray) -> np.ndarray:
    """Return which sense line each of (n,) flat cells is on."""
    row, col = np.divmod(cells, reading.adc.shape[1])
    return row if reading.circuit.sense_axis else col


def _distribution(z: np.ndarray, std: np.ndarray, least: np.ndarray):
    """Return log z, and the weight of each: (nodes, lines), even in the log of z.

    Args:
        z, std: (lines,) of a normal distribution.
        least: (lines,) where the hardest cell comes to the curve's end.
    """
    std = np.maximum(std, np.finfo(np.float32).eps)  # of a line without an unknown 0
    low = np.maximum(np.maximum(least, z - _FAR * std), np.finfo(np.float32).eps)
    log_z = np.linspace(np.log(low), np.log(np.maximum(z + _FAR * std, low + std)), _NODES)
    off = np.square((np.exp(log_z) - z) / std)
    weight = np.exp(-0.5 * (off - off.min(0)))
    return log_z, weight / weight.sum(0)


def without(covariance: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the covariance where the precision is less by root root^T (Woodbury's identity)."""
    moved = covariance @ root
    left, vectors = np.linalg.eigh(np.eye(root.shape[1]) - root.T @ moved)
    moved = moved @ (vectors / np.sqrt(np.maximum(left, _LEAST)))
    return covariance + moved @ moved.T


def _of_mean(reading: Reading, point: Point) -> np.ndarray:
    """(cells,) root of the precision with which `prior.level` seems to know the mean force.

    Its mean moves with the forces, and it does not know it.
    """
    force, slope = force_of(reading, point.model.g)
    mean, length = force[reading.circuit.populated].mean(), np.linalg.norm(force)
    return (3.0**0.5 / (mean * length) * slope * force).ravel()


def _of_lines(reading: Reading, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Return what `prior.touches` says of levels only since lines have many cells.

    Two lines' levels differ by one difference, not by one in each of their cells; and no level is
    drawn to rest, or to cells at rest.

    Returns:
        (rows, cols) its gradient, and (lines, lines) its curvature.
    """
    x, circuit, between = point.x, reading.circuit, differences(reading.circuit)
    touched = (point.model.g > NEAR_REST * reading.bounds[0]) & circuit.populated
    here, there = touched.ravel()[between.here], touched.ravel()[between.there]
    one, other = _line(reading, between.here), _line(reading, between.there)
    lines = x.shape[1 - circuit.sense_axis]
    across, edge = here & there & (one != other), here != there
    count = np.bincount(one, across, lines)
    part = np.where(across, 1.0 - 1.0 / np.maximum(count[one], 1.0), 1.0 * edge)
    d = x.ravel()[between.there] - x.ravel()[between.here]
    curvature = part * between.weight / (SPREAD**2 + np.square(d))
    pull = np.bincount(between.there, curvature * d, x.size)
    pull -= np.bincount(between.here, curvature * d, x.size)
    pull = touched * (pull.reshape(x.shape) + 1.0 / (x + SPREAD))
    found = np.zeros((lines, lines))
    for a, b, which in ((one, other, across), (other, one, across)):
        np.add.at(found, (a[which], a[which]), curvature[which])
        np.add.at(found, (a[which], b[which]), -curvature[which])
    own = np.where(here, one, other)[edge]
    np.add.at(found, (own, own), curvature[edge])
    return pull, found
