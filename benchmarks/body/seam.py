# SPDX-License-Identifier: Apache-2.0
"""Show in how many strokes across the seam of two mats a touch keeps its id and its velocity.

Each stroke is a round finger that slides over two planes of 8 x 8 cells: its pressure is averaged
over each cell from samples 9 times finer, both boards read it at their own time, and each cell has
5 % noise. As control the same finger slides over one mat of 8 x 16 cells.
"""

from __future__ import annotations

import numpy as np

from benchmarks import harness
from tactile_skin.body.touches import BodyTracker, Piece
from tactile_skin.touch.features import analyse_frame
from tactile_skin.touch.geometry import Geometry, make_geometry
from tactile_skin.touch.tracking import RELEASED, Tracker

PITCH = 0.018  # m
STRIPE = 0.012  # m that a cell senses of its pitch
ROWS = 8
PERIOD = 0.01  # s between two frames of a board
JITTER = 0.001  # s, RMS of a frame's time
NOISE = 0.05  # relative, of a cell's force
THRESHOLD = 0.2  # N on a cell that is a contact
FINE = 9  # samples along each side of a cell
AROUND = 0.05  # m on either side of the seam in which the velocity is judged
OFF = 0.3  # of the speed that the velocity may be off, in the median around the seam
SHARE = 0.95  # of the strokes that must keep their id
GAP = 0.018  # m, largest, between two mats, besides their pitch


def sensed(geometry: Geometry, centre: np.ndarray, radius: float, newtons: float) -> np.ndarray:
    """Return the force on each cell under a finger, Hertz's pressure, in the plane x = 0."""
    offsets = (np.arange(FINE) - (FINE - 1) / 2) / FINE * STRIPE
    y = geometry.position[..., 1][..., None, None] + offsets[:, None] - centre[1]
    z = geometry.position[..., 2][..., None, None] + offsets[None, :] - centre[2]
    pressure = np.sqrt(np.maximum(1.0 - (y**2 + z**2) / radius**2, 0.0)).mean((-1, -2))
    # what lies between the stripes is borne by the cover: 2/3 pi r^2 is the integral of the root
    force: np.ndarray = newtons * pressure * PITCH**2 / (2.0 / 3.0 * np.pi * radius**2)
    return force


class Mat:
    """One board with its tracker."""

    def __init__(self, cols: int, middle: float, rng: np.random.Generator):
        self.geometry = make_geometry(
            "plane", ROWS, cols, PITCH, STRIPE**2, translation=(0.0, middle, 0.0)
        )
        self.tracker, self._rng = Tracker(PITCH), rng
        self.next = rng.uniform(0.0, PERIOD)

    def pieces(self, t: float, finger) -> list[tuple[Piece, np.ndarray]]:
        """Return what the mat says of a finger at t: each touch, with its velocity."""
        force = sensed(self.geometry, *finger)
        force = force * (1.0 + NOISE * self._rng.standard_normal(force.shape))
        frame = analyse_frame(np.maximum(force, 0.0), self.geometry, THRESHOLD)
        self.next = t + PERIOD + float(self._rng.normal(0.0, JITTER))
        return [
            (Piece(x.id, x.contact.position, *x.contact[1:4]), x.velocity)
            for x in self.tracker.update(t, frame)
            if x.state != RELEASED
        ]


def stroke(seed: int, mats: int = 2) -> dict:
    """Return how many ids a stroke had, and how far its velocity was off, over its speed."""
    rng = np.random.default_rng(seed)
    radius, newtons = rng.uniform(0.009, 0.016), rng.uniform(2.0, 10.0)
    speed, gap = rng.uniform(0.08, 0.4), rng.uniform(0.0, GAP)
    angle = rng.uniform(-0.6, 0.6) + rng.choice([0.0, np.pi])
    velocity = speed * np.array([0.0, np.cos(angle), np.sin(angle)])
    across = np.array([0.0, rng.uniform(-0.5, 0.5) * PITCH, rng.uniform(-1.0, 1.0) * PITCH])
    shift = 4 * PITCH + gap / 2
    if mats == 2:
        boards = {"right": Mat(8, -shift, rng), "left": Mat(8, shift, rng)}
    else:
        boards = {"one": Mat(16, 0.0, rng)}
    body = BodyTracker({name: mat.geometry for name, mat in boards.items()})
    half = 0.1 / speed  # s: 0.1 m on either side of the seam
    ids: set[int] = set()
    off = []
    most = 0
    while True:
        name = min(boards, key=lambda k: boards[k].next)
        t = boards[name].next
        if t > 2 * half:
            break
        place = across + velocity * (t - half)
        found = boards[name].pieces(t, (place, radius, newtons))
        body.update(t, name, [piece for piece, _ in found])
        touches = body.touches()
        ids |= {touch.id for touch in touches}
        most = max(most, len(touches))
        if abs(place[1]) < AROUND and len(touches) == 1:
            off.append(float(np.linalg.norm(touches[0].velocity - velocity)) / speed)
    return {"ids": len(ids), "most": most, "off": float(np.median(off)) if off else np.inf}


def kept(found: dict) -> bool:
    """Whether a stroke kept its id and its velocity."""
    return found["ids"] == 1 and found["off"] <= OFF


def measure(strokes: int, seed: int) -> dict:
    """Return the share of strokes that kept id and velocity, across a seam and on one mat."""
    result: dict = {"strokes": strokes, "seed": seed}
    for mats, name in ((2, "seam"), (1, "one_mat")):
        found = [stroke(seed + k, mats) for k in range(strokes)]
        off = [x["off"] for x in found if np.isfinite(x["off"])]
        result[name] = {
            "kept": float(np.mean([kept(x) for x in found])),
            "one_id": float(np.mean([x["ids"] == 1 for x in found])),
            "velocity_off": float(np.median(off)),
            "velocity_off_p95": float(np.quantile(off, 0.95)),
        }
    return result


def main(arguments=None) -> dict:
    """Measure, print, and return the figures."""
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--strokes", type=int, default=200, help="of each kind (default 200)")
    parser.add_argument("--seed", type=int, default=3800, help="of the first (default 3800)")
    given = parser.parse_args(arguments)
    result = measure(given.strokes, given.seed)
    for name in ("seam", "one_mat"):
        print(name, {key: round(value, 3) for key, value in result[name].items()})
    return result


if __name__ == "__main__":
    harness.run(main)
