"""What one frame says: from the force on each cell to contacts, wrench and push direction.

A skin that senses normal pressure cannot see shear. What it can see of a push's direction is
where the touched cells face (`Push`, here; on a plane that is always its normal) and how the touch
moves along the skin (`tracking.stroke`, over time). Each comes with a confidence (docs/touch.md).
"""

from __future__ import annotations

import math
from functools import lru_cache
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
    cells = labels.ravel().nonzero()[0]  # (m,)
    owner = labels.ravel()[cells] - 1
    own = np.zeros((n, cells.size))  # force of each cell, in the row of its contact
    own[owner, np.arange(cells.size)] = force.ravel()[cells]
    moments = own @ geometry.lever[cells]  # (n, 10): force, torque, first moment, sum
    forces = moments[:, 9].tolist()
    centres = moments[:, 6:9] / moments[:, 9:]
    areas = np.bincount(owner, geometry.cell_area.ravel()[cells]).tolist()
    found = [*map(Contact, centres, forces, areas, own.max(1).tolist())]
    if n == 1:
        total, centre = moments[0], centres[0]
    else:
        total = moments.sum(0)
        centre = total[6:9] / total[9]
    length = math.hypot(*total[:3].tolist())
    direction = total[:3] / length if length > 1e-6 * total[9] else np.zeros(3)
    confidence = length / (float(total[9]) + 10.0 * cell_threshold)
    return Frame(force, labels, found, Push(total[:3], total[3:6], centre, direction, confidence))


def segment(force: np.ndarray, cell_threshold: float) -> tuple[np.ndarray, int]:
    """Which contact each cell belongs to, strongest contact first.

    A contact is a hill of cells that touch (8 neighbours), each above a tenth of the threshold: a
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
    # With idle cells around the skin every cell has eight neighbours.
    width = cols + 2
    flat = np.zeros((rows + 2) * width)
    flat.reshape(rows + 2, width)[1:-1, 1:-1] = force
    cells = (flat > _RIM * cell_threshold).nonzero()[0]
    cells = cells[flat[cells].argsort(kind="stable")]  # (m,) weakest first
    f = flat[cells]
    place = np.full(flat.size, -1)  # in `cells`: equal forces have different ones
    place[cells] = np.arange(cells.size)
    around = place[cells[:, None] + _nine(width)]  # (m, 9), -1 for idle cells
    hill = around.max(1).tolist()  # the steepest way up from each cell,
    for k in range(cells.size - 1, -1, -1):
        hill[k] = hill[hill[k]]  # to its top
    owner = np.array(hill)
    tops = sorted(set(hill))
    if len(tops) > 1:
        top_of = _join(tops, owner, around, f, cell_threshold)
        owner = np.array([top_of[k] for k in hill])
        tops = sorted(set(top_of.values()))
    sums = np.bincount(owner, f).tolist()
    tops = sorted((k for k in tops if f[k] > cell_threshold), key=lambda k: -sums[k])
    number = np.zeros(cells.size, int)
    number[tops] = range(1, len(tops) + 1)
    flat_labels = np.zeros(flat.size, int)
    flat_labels[cells] = number[owner]
    return flat_labels.reshape(rows + 2, width)[1:-1, 1:-1].copy(), len(tops)


@lru_cache(maxsize=8)
def _nine(width: int) -> np.ndarray:
    """Offsets of a cell and its eight neighbours in a flattened picture."""
    return np.array([down * width + right for down in (-1, 0, 1) for right in (-1, 0, 1)])


def _join(tops: list[int], hill, around, f, threshold: float) -> dict[int, int]:
    """Which hills are one contact.

    Args:
        tops: places of the hills' tops, rising.
        hill: (m,) place of the top of each cell's hill.
        around: (m, 9) places of each cell's neighbours, -1 for none.
        f: (m,) forces, rising.

    Returns:
        for each top, the one that stands for its contact: the highest.
    """
    other = np.where(around < 0, -1, hill[around])
    cell, side = ((other >= 0) & (other < hill[:, None])).nonzero()  # each border seen from above
    saddle = np.minimum(f[cell], f[around[cell, side]])
    highest = saddle.argsort()[::-1]
    above, below = hill[cell[highest]].tolist(), other[cell, side][highest].tolist()
    stands_for = {k: k for k in tops}

    def top(k):
        while stands_for[k] != k:
            k = stands_for[k]
        return k

    for one, another, height in zip(above, below, saddle[highest].tolist(), strict=True):
        low, high = sorted((top(one), top(another)))
        if low != high and (height >= _VALLEY * f[low] or f[low] <= threshold):
            stands_for[low] = high
    return {k: top(k) for k in tops}
