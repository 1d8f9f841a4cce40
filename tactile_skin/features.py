"""From the force on each cell to what a robot asks: contacts, wrench, push direction, stroke.

A skin that senses normal pressure cannot see shear. What it can see of a push's direction is
(1) where the touched cells face: `wrench` and `push_direction`; on a plane that is always its
normal; and (2) how the touch moves along the skin: `Stroke`. Each comes with a confidence.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from .geometry import Geometry

_EIGHT_NEIGHBOURS = np.ones((3, 3))
_RIM = 0.1  # of the threshold: what lies around a touched cell belongs to its contact


class Contact(NamedTuple):
    """One patch of touched cells, in the base frame."""

    position: np.ndarray  # (3,) [m], centre of force
    force: float  # [N], sum of the cells' normal forces
    area: float  # [m^2], of the touched cells
    peak: float  # [N], largest force on one cell


class Push(NamedTuple):
    """What all cells together exert on the robot, in the base frame."""

    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m], about the base frame's origin
    centre: np.ndarray  # (3,) [m], centre of force; zero without contact
    direction: np.ndarray  # (3,) unit vector of the force; zero without contact
    confidence: float  # 0..1, of the direction


def patches(force: np.ndarray, cell_threshold: float) -> tuple[np.ndarray, int]:
    """Patches of cells that touch (8 neighbours), each with a cell above the threshold.

    A patch reaches down to a tenth of the threshold: a fingertip has a third of its force on its
    rim.

    Args:
        force: (rows, cols) [N].
        cell_threshold: a patch whose strongest cell has less [N] is no contact.

    Returns:
        (rows, cols) number of the patch, 1.. and 0 for none; number of patches.
    """
    labels, n = ndimage.label(force > _RIM * cell_threshold, _EIGHT_NEIGHBOURS)
    peaks = ndimage.maximum(force, labels, np.arange(n + 1)) if n else np.zeros(1)
    kept = np.flatnonzero(peaks[1:] > cell_threshold) + 1
    number = np.zeros(n + 1, int)
    number[kept] = np.arange(1, kept.size + 1)
    return number[labels], kept.size


def contacts(force: np.ndarray, geometry: Geometry, cell_threshold: float) -> list[Contact]:
    """The `patches` as contacts, strongest first."""
    labels, n = patches(force, cell_threshold)
    found = []
    for k in range(1, n + 1):
        cells = labels == k
        f = force[cells]  # (m,)
        position = f @ geometry.position[cells] / f.sum()
        area = f.size * geometry.cell_area
        found.append(Contact(position, float(f.sum()), area, float(f.max())))
    return sorted(found, key=lambda c: -c.force)


def push(force: np.ndarray, geometry: Geometry, cell_threshold: float) -> Push:
    """Wrench of the touch on the robot, and the direction of the push from the cells' normals.

    The confidence is |sum f n| / sum f, 1 where all touched cells face one way, 0 for a squeeze,
    times total / (total + 10 cell_threshold): a touch near the threshold says little.
    """
    f = np.where(patches(force, cell_threshold)[0] > 0, force, 0.0)
    total = f.sum()
    if total == 0.0:
        nothing = np.zeros(3)
        return Push(nothing, nothing, nothing, nothing, 0.0)
    inward = -f[..., None] * geometry.normal  # (rows, cols, 3)
    vector = inward.sum((0, 1))
    torque = np.cross(geometry.position, inward).sum((0, 1))
    centre = np.tensordot(f, geometry.position, 2) / total
    length = np.linalg.norm(vector)
    direction = vector / length if length > 1e-6 * total else np.zeros(3)
    confidence = length / total * total / (total + 10.0 * cell_threshold)
    return Push(vector, torque, centre, direction, float(confidence))


class Stroke:
    """Velocity of a single contact's centre along the skin, by a line through its last positions.

    Args:
        window: how far back the line looks [s].
        noise: RMS error of the centre that counts as standing still [m].
    """

    def __init__(self, window: float = 0.15, noise: float = 0.001):
        self.window, self.noise = window, noise
        self._trail: deque[tuple[float, np.ndarray]] = deque()

    def update(self, t: float, found: list[Contact]) -> tuple[np.ndarray, float]:
        """Take the contacts of time t [s]; returns velocity (3,) [m/s] and confidence 0..1.

        Two contacts at once, none, or a jump end the trail: their common centre would move
        without anybody stroking.
        """
        if len(found) != 1:
            self._trail.clear()
            return np.zeros(3), 0.0
        here = found[0].position
        if self._trail and np.linalg.norm(here - self._trail[-1][1]) > 0.05:
            self._trail.clear()
        self._trail.append((t, here))
        while t - self._trail[0][0] > self.window:
            self._trail.popleft()
        if len(self._trail) < 4:
            return np.zeros(3), 0.0
        times = np.array([s for s, _ in self._trail])
        places = np.array([p for _, p in self._trail])  # (m, 3)
        dt = times - times.mean()
        spread = dt @ dt
        if spread == 0.0:
            return np.zeros(3), 0.0
        velocity = dt @ places / spread
        travelled = np.linalg.norm(velocity) * (times[-1] - times[0])
        filled = min(1.0, (times[-1] - times[0]) / (0.8 * self.window))
        return velocity, float(filled * travelled**2 / (travelled**2 + (3 * self.noise) ** 2))
