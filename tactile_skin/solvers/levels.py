# SPDX-License-Identifier: Apache-2.0
"""The last step where readings share a sum: how much the cells of a line conduct together.

The readings of a grounded sense line determine the shares of its cells. How much these conduct
together follows from what they leave of the supply, and a hard load leaves little but noise. A fit
then is where its prior pulls it, which counts each of a line's cells as if it said something of its
own, and its slopes there say too much of harder loads (docs/derivation.md).
"""

from __future__ import annotations

import numpy as np

from .estimate import spread
from .prior import SPREAD, NormalEquations, Point, differences, force_of
from .reading import NEAR_REST, Reading

_NODES = 15  # at which a level's distribution is taken
_FAR = 4.0  # standard deviations to which it is followed
_LEAST = 1e-3  # share of a precision that is left without the prior's part in it: less is rounding


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
