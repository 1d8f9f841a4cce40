# SPDX-License-Identifier: Apache-2.0
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
# Times the threshold: force of a touch that is soft all over, 40 N at 20 g. Less would make a touch
# of the 35 N that the naive method sees on an idle skin.
_SOFT = 200.0
_LEFT = 1.0  # N, of a touch that was felt: what a fabric keeps after 45 N is less
_MOST_SOFT = 40.0  # N, of it at most: the stop must see a body whatever the threshold
# Of the lower of two peaks, which are two touches if the force between them falls below it. Chosen
# on pairs of pads, scored in docs/touch.md.
_VALLEY = 0.6


class Contact(NamedTuple):
    """One patch of touched cells, in the base frame."""

    position: np.ndarray  # (3,) [m], centre of force
    force: float  # [N], sum of the cells' normal forces
    area: float  # [m^2], of the touched cells
    peak: float  # [N], largest force on one cell
    bound: float  # [N], the most that its force may be
    peak_bound: float  # [N], the most that its peak may be, if newtons are right


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
    cells: np.ndarray  # (m,) places of the touched cells in the flattened picture
    own: np.ndarray  # (contacts, m) force of each of them [N], in the row of its contact


_NOTHING = Push(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


def analyse_frame(
    force: np.ndarray,
    geometry: Geometry,
    cell_threshold: float,
    bound: np.ndarray | None = None,
    *,
    held: bool = False,
) -> Frame:
    """Find the contacts of a frame and the push that they make together.

    The direction's confidence is |sum f n| / sum f, 1 where all touched cells face one way, 0 for
    a squeeze, times total / (total + 10 cell_threshold): a touch near the threshold says little.

    Args:
        force: (rows, cols) on each cell [N], 0 or more.
        cell_threshold: a contact has a cell with more [N].
        bound: (rows, cols, 2) the most that each cell may feel, by the circuit and in all [N];
            None: what is felt.
        held: whether something touched in the frame before: what is left of it, on many cells, is
            still a contact, so that a touch that fades is not lost at the threshold.
    """
    most = force if bound is None else np.maximum(bound[..., 1], force)
    cells, owner, n = segment(force, cell_threshold, most, held=held)
    labels = np.zeros(force.shape, int)
    if n == 0:
        return Frame(force, labels, [], _NOTHING, cells, np.zeros((0, 0)))
    labels.ravel()[cells] = owner + 1
    f = force.ravel()[cells]
    own = f[None] if n == 1 else np.where(owner == np.arange(n)[:, None], f, 0.0)
    moments = own @ geometry.lever[cells]  # (n, 10): force, torque, first moment, sum
    forces = moments[:, 9].tolist()
    centres = moments[:, 6:9] / moments[:, 9:]
    areas = np.bincount(owner, geometry.cell_area.ravel()[cells]).tolist()
    peaks, bounds = own.max(1), np.bincount(owner, most.ravel()[cells])
    highest = peaks if bound is None else np.zeros(n)
    if bound is not None:
        np.maximum.at(highest, owner, np.maximum(bound[..., 0], force).ravel()[cells])
    parts = centres, forces, areas, peaks.tolist(), bounds.tolist(), highest.tolist()
    found = [*map(Contact, *parts)]
    if n == 1:
        total, centre = moments[0], centres[0]
    else:
        total = moments.sum(0)
        centre = total[6:9] / total[9]
    length = math.hypot(*total[:3].tolist())
    direction = total[:3] / length if length > 1e-6 * total[9] else np.zeros(3)
    confidence = length / (float(total[9]) + 10.0 * cell_threshold)
    push = Push(total[:3], total[3:6], centre, direction, confidence)
    return Frame(force, labels, found, push, cells, own)


def segment(
    force: np.ndarray,
    cell_threshold: float,
    most: np.ndarray | None = None,
    *,
    held: bool = False,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Which cells are touched, and which contact each belongs to, strongest contact first.

    A contact is a hill of cells that touch (8 neighbours), each above a tenth of the threshold: a
    fingertip has a third of its force on its rim. Two hills that touch are two contacts where the
    highest way from one to the other falls below 0.6 of the lower peak, and both rise above the
    threshold: a free row between two fingers is seldom quite free in what was measured, and no
    palm is quite flat.

    Args:
        force: (rows, cols) [N].
        cell_threshold: a hill whose strongest cell has no more [N] is no contact, unless all its
            cells have 200 times as much, or 40 N, together: a body that leans on many cells is soft
            on each. Of more than 40 N all such hills are one contact: it leans on several places.
        most: (rows, cols) what each cell may feel at most, which is soft all over then [N]; None:
            what it feels.
        held: whether something touched in the frame before: 1 N on all cells is then a contact.

    Returns:
        (m,) places of the touched cells in the flattened picture; (m,) each one's contact, from 0;
        number of contacts.
    """
    flat, nothing = force.ravel(), np.zeros(0, int)
    upper = flat if most is None else most.ravel()
    soft = min(_SOFT * cell_threshold, _MOST_SOFT)
    least = _LEFT if held else soft  # of a frame
    rim = _RIM * cell_threshold
    highest = flat.max()
    cells = ((flat if highest > cell_threshold else upper) > rim).nonzero()[0]
    if not cells.size:
        return nothing, nothing, 0
    f = flat[cells]
    if not (highest > cell_threshold or upper[cells].sum() > least):
        return nothing, nothing, 0
    weakest_first = f.argsort(kind="stable")
    cells, f = cells[weakest_first], f[weakest_first]  # (m,)
    m = cells.size
    place = np.full(flat.size + 1, -1)  # in `cells`: equal forces have different ones
    place[cells] = np.arange(m)
    around = place[_neighbours(*force.shape)[cells]]  # (m, 9), -1 for idle cells
    hill = around.max(1)  # the steepest way up from each cell,
    tops = (hill == np.arange(m)).nonzero()[0].tolist()
    if len(tops) == 1:
        return cells, np.zeros(m, int), 1
    for _ in range(m.bit_length()):
        hill = hill[hill]  # twice as far up, to its top
    top_of = np.arange(m)
    top_of[tops] = _join(tops, hill, around, f, cell_threshold)
    owner = top_of[hill]
    sums = np.bincount(owner, upper[cells]).tolist()
    felt = [k for k in sorted(set(owner.tolist())) if f[k] > cell_threshold or sums[k] > soft]
    left_over = upper[cells].sum() - sum(sums[k] for k in felt)
    if left_over > _MOST_SOFT or not felt:
        left = ~np.isin(owner, felt)
        felt.append(owner[left].max())
        owner[left] = felt[-1]
    sums = np.bincount(owner, f).tolist()
    number = np.full(m, -1)
    number[sorted(felt, key=lambda k: -sums[k])] = range(len(felt))
    contact = number[owner]
    touched = contact >= 0
    return cells[touched], contact[touched], len(felt)


@lru_cache(maxsize=8)
def _neighbours(rows: int, cols: int) -> np.ndarray:
    """(rows * cols, 9) places of each cell and its neighbours; -1 beyond the edge."""
    places = np.full((rows + 2, cols + 2), -1)
    places[1:-1, 1:-1] = np.arange(rows * cols).reshape(rows, cols)
    windows = np.lib.stride_tricks.sliding_window_view(places, (3, 3))
    return windows.reshape(rows * cols, 9)


def _join(
    tops: list[int], hill: np.ndarray, around: np.ndarray, f: np.ndarray, threshold: float
) -> list[int]:
    """Which hills are one contact.

    Args:
        tops: places of the hills' tops, rising.
        hill: (m,) place of the top of each cell's hill.
        around: (m, 9) places of each cell's neighbours, -1 for none.
        f: (m,) forces, rising.

    Returns:
        for each top, the one that stands for its contact: the highest.
    """
    # each border seen from above
    cell, side = ((around >= 0) & (hill[around] < hill[:, None])).nonzero()
    beside = around[cell, side]
    saddle = np.minimum(f[cell], f[beside])
    highest = saddle.argsort()[::-1]
    above, below = hill[cell[highest]].tolist(), hill[beside[highest]].tolist()
    stands_for = {k: k for k in tops}

    def top(k: int) -> int:
        while stands_for[k] != k:
            k = stands_for[k]
        return k

    for one, another, height in zip(above, below, saddle[highest].tolist(), strict=True):
        low, high = sorted((top(one), top(another)))
        if low != high and (height >= _VALLEY * f[low] or f[low] <= threshold):
            stands_for[low] = high
    return [top(k) for k in tops]
