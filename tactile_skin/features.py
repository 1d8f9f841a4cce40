"""What one frame says: from the force on each cell to contacts, wrench and push direction.

A skin that senses normal pressure cannot see shear. What it can see of a push's direction is
where the touched cells face (`Push`, here; on a plane that is always its normal) and how the touch
moves along the skin (`tracking.stroke`, over time). Each comes with a confidence (docs/touch.md).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .geometry import Geometry

_RIM = 0.1  # of the threshold: what lies around a touched cell belongs to its contact
_VALLEY = 0.6  # of the lower of two peaks: two touches where the force between them falls below


class Contact(NamedTuple):
    """One patch of touched cells, in the base frame."""

    position: np.ndarray  # (3,) [m], centre of force
    force: float  # [N], sum of the cells' normal forces
    area: float  # [m^2], of the touched cells
    peak: float  # [N], largest force on one cell


class Push(NamedTuple):
    """What all contacts together exert on the robot, in the base frame."""

    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m], about the base frame's origin
    centre: np.ndarray  # (3,) [m], centre of force; zero without contact
    direction: np.ndarray  # (3,) unit vector of the force; zero without contact
    confidence: float  # 0..1, of the direction


class Frame(NamedTuple):
    """All that one frame says."""

    force: np.ndarray  # (rows, cols) [N]
    labels: np.ndarray  # (rows, cols) int, 1 + place in `contacts`; 0: no contact
    contacts: list[Contact]  # strongest first
    push: Push


_NOTHING = Push(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


def look(force: np.ndarray, geometry: Geometry, cell_threshold: float) -> Frame:
    """Find the contacts of a frame and the push that they make together.

    The direction's confidence is |sum f n| / sum f, 1 where all touched cells face one way, 0 for
    a squeeze, times total / (total + 10 cell_threshold): a touch near the threshold says little.

    Args:
        force: (rows, cols) on each cell [N], 0 or more.
        cell_threshold: a contact has a cell with more [N].
    """
    labels, n = segment(force, cell_threshold)
    if n == 0:
        return Frame(force, labels, [], _NOTHING)
    cells = np.flatnonzero(labels)
    f, owner = force.flat[cells], labels.flat[cells] - 1
    own = np.zeros((n, cells.size))  # force of each cell, in the row of its contact
    own[owner, np.arange(cells.size)] = f
    moments = own @ geometry.lever[cells]  # (n, 9): force, torque, first moment
    forces = own.sum(1)
    areas = np.bincount(owner, geometry.cell_area.flat[cells], n)
    centres = moments[:, 6:] / forces[:, None]
    found = [*map(Contact, centres, forces.tolist(), areas.tolist(), own.max(1).tolist())]
    total = moments.sum(0)
    sum_of_forces = float(forces.sum())
    length = float(np.sqrt(total[:3] @ total[:3]))
    direction = total[:3] / length if length > 1e-6 * sum_of_forces else np.zeros(3)
    confidence = length / (sum_of_forces + 10.0 * cell_threshold)
    centre = total[6:] / sum_of_forces
    return Frame(
        force, labels, found, Push(total[:3], total[3:6], centre, direction, confidence)
    )


def segment(force: np.ndarray, cell_threshold: float) -> tuple[np.ndarray, int]:
    """Which contact each cell belongs to, strongest contact first.

    A contact is a hill of cells that touch (8 neighbours), each up to a tenth of the threshold: a
    fingertip has a third of its force on its rim. Two hills that touch are two contacts where the
    highest way from one to the other falls below 0.6 of the lower peak, and both rise above the
    threshold: a free row between two fingers is seldom quite free in what was measured, and no
    palm is quite flat.

    Args:
        force: (rows, cols) [N].
        cell_threshold: a hill whose strongest cell has no more [N] is no contact.

    Returns:
        (rows, cols) number of the contact, 1.. and 0 for none; number of contacts.
    """
    rows, cols = force.shape
    labels = np.zeros((rows, cols), int)
    if not force.max() > cell_threshold:
        return labels, 0
    # A frame of idle cells around, so that every cell has eight neighbours.
    width = cols + 2
    flat = np.zeros((rows + 2) * width)
    flat.reshape(rows + 2, width)[1:-1, 1:-1] = force
    cells = np.flatnonzero(flat > _RIM * cell_threshold)
    cells = cells[np.argsort(flat[cells], kind="stable")]  # (m,) weakest first
    f = flat[cells]
    place = np.zeros(flat.size, int)  # 1 + place in `cells`; equal forces get different ones
    place[cells] = np.arange(1, cells.size + 1)
    around = place[cells[:, None] + _nine(width)]  # (m, 9)
    hill = around.max(1) - 1  # the way up from each cell,
    while True:
        higher = hill[hill]
        if (higher == hill).all():
            break
        hill = higher  # to its top
    top_of = _join(hill, around, f, cell_threshold)
    owner = top_of[hill]  # (m,) place of each cell's top
    tops, owner = np.unique(owner, return_inverse=True)
    sums = np.where(f[tops] > cell_threshold, np.bincount(owner, f), 0.0)
    n = np.count_nonzero(sums)
    number = np.zeros(tops.size, int)
    number[np.argsort(-sums, kind="stable")[:n]] = np.arange(1, n + 1)
    row, col = np.divmod(cells, width)
    labels[row - 1, col - 1] = number[owner]
    return labels, n


def _nine(width: int) -> np.ndarray:
    """Offsets of a cell and its eight neighbours in a flattened picture."""
    return np.array([down * width + right for down in (-1, 0, 1) for right in (-1, 0, 1)])


def _join(hill: np.ndarray, around: np.ndarray, f: np.ndarray, threshold: float) -> np.ndarray:
    """Which hills are one contact.

    Args:
        hill: (m,) place of the top of each cell's hill; `around` (m, 9) places + 1 of each cell's
            neighbours; `f` (m,) forces, rising.

    Returns:
        (m,) for the place of each top, the place of the top that stands for its contact.
    """
    top_of = np.arange(f.size)
    if (hill == hill[-1]).all():
        return top_of
    other = np.where(around > 0, hill[around - 1], hill[:, None])
    cell, neighbour = np.nonzero(other < hill[:, None])
    first, second = hill[cell], other[cell, neighbour]  # the second's top is the lower one
    saddle = np.minimum(f[cell], f[around[cell, neighbour] - 1])
    highest = np.argsort(-saddle, kind="stable")
    # of each pair of hills the highest saddle only
    _, once = np.unique((first * f.size + second)[highest], return_index=True)
    tops = top_of.tolist()

    def top(k):
        while tops[k] != k:
            k = tops[k]
        return k

    for k in highest[np.sort(once)].tolist():
        low, high = sorted((top(first[k]), top(second[k])))
        if low != high and (saddle[k] >= _VALLEY * f[low] or f[low] <= threshold):
            tops[low] = high
    for k in set(hill.tolist()):
        top_of[k] = top(k)
    return top_of
