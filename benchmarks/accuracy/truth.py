# SPDX-License-Identifier: Apache-2.0
"""Touches whose force, place and direction are known, and what the skin says of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from tactile_skin.board import protocol
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation.scenes import read_out
from tactile_skin.simulation.simulator import Board
from tactile_skin.solvers import compensate
from tactile_skin.touch import features
from tactile_skin.touch.geometry import make_geometry
from tactile_skin.touch.tracking import RELEASED, Touch, Tracker

CIRCUIT, CURVE = Circuit(), PressureCurve()
ROWS, COLS = CIRCUIT.shape
RADIUS = 0.15  # m
SKIN = make_geometry("cylinder", ROWS, COLS, radius=RADIUS)
CELL_THRESHOLD = 0.2  # N, the node's
METHOD = "auto"

_FINE = 12  # points a cell and direction: the 12 mm of the 18 that sense are 8 of them
_AT = (np.arange(ROWS * _FINE) + 0.5) / _FINE - 0.5  # place of the points [cells]
_FINE_SKIN = make_geometry(
    "cylinder", ROWS * _FINE, COLS * _FINE, pitch=SKIN.pitch / _FINE, radius=RADIUS
)
KINDS = ("gaussian", "sphere", "flat", "rect")
SPREAD = 0.1  # of the logarithm of resistance, where cells are not alike
_HARDEST = 9.5  # N on a cell; at 9.8 (1 kg) the curve ends, and more cannot be told


class Pad(NamedTuple):
    """What presses: a shape of any size at any place."""

    kind: str  # of KINDS
    row: float  # of its middle [cells]
    col: float
    height: float  # [cells]
    width: float
    angle: float  # [rad]

    def pressed(self, newtons: float) -> np.ndarray:
        """(rows, cols) x 12 points a side: force on each [N], summing to `newtons`."""
        reach = np.hypot(self.height, self.width) / 2
        down, right = (slice(*np.searchsorted(_AT, (at - reach, at + reach))) for at in self[1:3])
        y, x = _AT[down, None] - self.row, _AT[None, right] - self.col
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        a = (y * cos + x * sin) / (self.height / 2)
        b = (x * cos - y * sin) / (self.width / 2)
        inside = np.maximum(abs(a), abs(b)) if self.kind == "rect" else np.hypot(a, b)
        if self.kind == "gaussian":
            shape = np.exp(-2.0 * inside**2)  # two standard deviations at the edge
        elif self.kind == "sphere":
            shape = np.sqrt(np.maximum(1.0 - inside**2, 0.0))  # Hertz
        else:
            shape = np.ones(inside.shape)
        shape[inside >= 1.0] = 0.0
        fine = np.zeros((_AT.size, _AT.size))
        fine[down, right] = newtons * shape / shape.sum()
        return fine


def cells(fine: np.ndarray) -> np.ndarray:
    """(rows, cols) force on each cell [N]: all that presses on its 18 x 18 mm."""
    return fine.reshape(ROWS, _FINE, COLS, _FINE).sum((1, 3))


def sensed_cells(fine: np.ndarray) -> np.ndarray:
    """The same where the gaps between the stripes feel nothing: 12 x 12 mm speak for all."""
    middle = fine.reshape(ROWS, _FINE, COLS, _FINE)[:, 2:-2, :, 2:-2]
    return middle.sum((1, 3)) * (_FINE / 8) ** 2


def random_pad(rng, sizes: tuple[float, float], middle=None) -> Pad:
    """A pad of a random shape; `sizes` of its sides [cells]; anywhere where it is whole."""
    kind = str(rng.choice(KINDS))
    height = rng.uniform(*sizes)
    width = np.clip(height * rng.uniform(0.7, 1.4), *sizes)
    reach = np.hypot(height, width) / 2 if kind == "rect" else max(height, width) / 2
    if middle is None:
        middle = rng.uniform(reach - 0.5, ROWS - 0.5 - reach, 2)
    return Pad(kind, *middle, height, width, rng.uniform(0.0, np.pi))


def found_in(force: np.ndarray, rng, method: str = METHOD, spread: float = 0.0) -> features.Frame:
    """What the skin says of a force on each cell, `scan` reading.

    Args:
        spread: standard deviation of the logarithm of each cell's resistance: no two cells of a
            textile are alike.
    """
    resistance = CURVE.resistance(np.minimum(force, CURVE.max_force))
    resistance *= np.exp(spread * rng.standard_normal(force.shape))
    adc = read_out(CIRCUIT, forward(CIRCUIT, resistance), "scan", rng)
    estimate = compensate(adc, CIRCUIT, CURVE, method)
    return features.analyse_frame(estimate.force, SKIN, CELL_THRESHOLD)


# --- 1. one touch: force, centre, direction ------------------------------------------------------


def single_touches(n: int, rng, feel=cells, spread: float = 0.0, track=iter) -> dict:
    """n single touches of 2 to 80 N, evenly in their logarithm, pads of 2 to 7 cells.

    Pads are redrawn until their hardest cell carries 0.3 to 9.5 N.

    Args:
        feel: what the cells feel of the points.
        spread: as `found_in`'s.

    Returns:
        force [N], and errors: of force (relative), centre [mm], direction [degrees], lists of n;
        one, the share of frames with exactly one contact.
    """
    found = {"force": [], "force_error": [], "centre_mm": [], "direction_deg": []}
    one = 0
    for _ in track(range(n)):
        newtons = float(np.exp(rng.uniform(np.log(2.0), np.log(80.0))))
        while True:
            fine = random_pad(rng, (2.0, 7.0)).pressed(newtons)
            if 0.3 < cells(fine).max() < _HARDEST:
                break
        frame = found_in(feel(fine), rng, spread=spread)
        true = fine.ravel() @ _FINE_SKIN.lever  # force, torque, first moment, sum
        centre, push = true[6:9] / true[9], true[:3] / np.linalg.norm(true[:3])
        one += len(frame.contacts) == 1
        found["force"].append(newtons)
        if not frame.contacts:
            for name, wrong in (("force_error", 1.0), ("centre_mm", 1e3), ("direction_deg", 180.0)):
                found[name].append(wrong)
            continue
        contact = frame.contacts[0]
        found["force_error"].append(abs(contact.force / newtons - 1.0))
        found["centre_mm"].append(1e3 * float(np.linalg.norm(contact.position - centre)))
        cosine = np.clip(frame.push.direction @ push, -1.0, 1.0)
        found["direction_deg"].append(float(np.degrees(np.arccos(cosine))))
    rounded = {name: np.round(values, 5).tolist() for name, values in found.items()}
    return rounded | {"one": one / n}


# --- 2. how many touches -------------------------------------------------------------------------


def neighbours(n: int, rng, leak: float = 0.0, spread: float = 0.0, track=iter) -> float:
    """Share of n frames in which two touches with one free row or column between are two contacts.

    Pads of 1.5 to 5 cells and 2 to 40 N each, their edges up to 0.3 cells from the free line.

    Args:
        leak: share of each cell's force that a cover spreads to each of its four neighbours: then
            the free line is not quite free.
        spread: as `found_in`'s.
    """
    right = 0
    for _ in track(range(n)):
        right += len(found_in(_two_beside(rng, leak), rng, spread=spread).contacts) == 2
    return right / n


def _two_beside(rng, leak: float) -> np.ndarray:
    while True:
        line = int(rng.integers(4, 12))
        sides = []
        for side in (-1, 1):
            height, width = rng.uniform(1.5, 5.0, 2)
            row = line + side * (0.5 + rng.uniform(0.0, 0.3) + height / 2)
            pad = Pad(str(rng.choice(KINDS)), row, rng.uniform(5.5, 9.5), height, width, 0.0)
            sides.append(cells(pad.pressed(np.exp(rng.uniform(np.log(2.0), np.log(40.0))))))
            if not 0.5 + height / 2 <= row + 1.0 <= ROWS + 0.5 - height / 2:
                break
        else:
            force = sides[0] + sides[1]
            if min(s.max() for s in sides) > 0.5 and force.max() < _HARDEST:
                around = np.pad(force, 1)
                beside = around[2:, 1:-1] + around[:-2, 1:-1] + around[1:-1, 2:] + around[1:-1, :-2]
                assert not force[line].any()
                force = (1.0 - 4.0 * leak) * force + leak * beside
                return force if rng.random() < 0.5 else force.T


def corners(rng) -> list[np.ndarray]:
    """Two to four fingers at the corners of a rectangle, (rows, cols) force [N] of each."""
    while True:
        top, left = rng.uniform(1.0, 8.0, 2)
        bottom, right = top + rng.uniform(5.0, 9.0), left + rng.uniform(5.0, 9.0)
        if max(bottom, right) > ROWS - 2.0:
            continue
        places = [(top, left), (bottom, right), (top, right), (bottom, left)]
        fingers = []
        for place in places[: int(rng.integers(2, 5))]:
            pad = random_pad(rng, (1.2, 3.0), place)
            while not 0.5 < (c := cells(pad.pressed(rng.uniform(1.0, 30.0)))).max() < _HARDEST:
                pad = random_pad(rng, (1.2, 3.0), place)
            fingers.append(c)
        return fingers


def ghosts(frame: features.Frame, touched: np.ndarray) -> int:
    """Contacts whose hardest cell nothing touches."""
    n = 0
    for k in range(1, len(frame.contacts) + 1):
        hardest = np.where(frame.labels == k, frame.force, 0.0).argmax()
        n += not touched.flat[hardest]
    return n


def corner_frames(n: int, rng, track=iter) -> dict:
    """n frames of `corners`: ghost contacts of the method, of naive and where cells are not alike;
    and the share of frames with as many contacts as fingers."""
    count = {"ghosts": 0, "naive_ghosts": 0, "spread_ghosts": 0, "right": 0}
    for _ in track(range(n)):
        fingers = corners(rng)
        force = np.sum(fingers, 0)
        frame = found_in(force, rng)
        count["ghosts"] += ghosts(frame, force > 0)
        count["right"] += len(frame.contacts) == len(fingers)
        count["naive_ghosts"] += ghosts(found_in(force, rng, "naive"), force > 0)
        count["spread_ghosts"] += ghosts(found_in(force, rng, spread=SPREAD), force > 0)
    return count | {"right": count["right"] / n}


# --- touches that move, on the simulated board ---------------------------------------------------


def play(
    scene: Callable[[float], np.ndarray], seconds: float, seed: int
) -> Iterable[tuple[float, features.Frame, list[Touch]]]:
    """Time [s], frame and touches of a scene, 100 times a second, as the nodes would tell them.

    The board low-passes its scans; `auto` goes on from the last estimate.
    """
    board = Board(CIRCUIT, CURVE, scene, seed=seed)
    parser, tracker, last = protocol.BinaryParser(), Tracker(SKIN.pitch), None
    for _ in range(round(seconds * 390)):
        for sent in parser.feed(board.scan()):
            adc = np.minimum(sent.samples / 64.0 / CIRCUIT.full_scale, 1.0)
            estimate = compensate(adc, CIRCUIT, CURVE, METHOD, start=last)
            last = estimate if estimate.status == "ok" else None
            frame = features.analyse_frame(estimate.force, SKIN, CELL_THRESHOLD)
            t = sent.device_time_us / 1e6
            yield t, frame, tracker.update(t, frame)


def corner_stream(scenes: int, rng, track=iter) -> dict:
    """Ghosts while fingers at corners come and go, half a second each, and the frames."""
    count = {"frames": 0, "ghosts": 0}
    for _ in track(range(scenes)):
        fingers = corners(rng)
        starts, ends = rng.uniform(0.0, 0.2, len(fingers)), rng.uniform(0.3, 0.5, len(fingers))
        touched = np.sum(fingers, 0) > 0

        def scene(t, fingers=fingers, starts=starts, ends=ends):
            on = [
                np.clip(min(t - s, e - t) / 0.05, 0.0, 1.0)
                for s, e in zip(starts, ends, strict=True)
            ]
            return np.tensordot(on, fingers, 1)

        for _, frame, _ in play(scene, 0.5, int(rng.integers(2**31))):
            count["frames"] += 1
            count["ghosts"] += ghosts(frame, touched)
    return count


def along(
    start: np.ndarray, end: np.ndarray, speed: float, pad: Pad, newtons: float
) -> tuple[Callable[[float], np.ndarray], Callable[[float], np.ndarray], float]:
    """A pad drawn from one place to another (row, col) [cells] at `speed` [m/s].

    Returns:
        the place at a time (row, col), the force on each cell at a time, when it is lifted [s].
    """
    seconds = float(np.linalg.norm(end - start)) * SKIN.pitch / speed

    def place(t):
        return start + (end - start) * min(max(t / seconds, 0.0), 1.0)

    def force(t):
        pressed = newtons * np.clip(min(t, seconds - t) / 0.03, 0.0, 1.0)
        row, col = place(t)
        return cells(pad._replace(row=row, col=col).pressed(pressed))

    return place, force, seconds


def _finger(rng) -> tuple[Pad, float]:
    """A fingertip of 1.2 to 2.5 cells (22 to 45 mm) and 2 to 15 N."""
    while True:
        pad, newtons = random_pad(rng, (1.2, 2.5), (7.3, 7.6)), rng.uniform(2.0, 15.0)
        if 0.5 < cells(pad.pressed(newtons)).max() < 0.8 * _HARDEST:
            return pad, newtons


def stroke_ids(rng) -> set[int]:
    """Ids told of a finger that is drawn across the skin, 0.05 to 1 m/s: one, if it kept its."""
    while True:
        start, end = rng.uniform(1.0, 14.0, (2, 2))
        if np.linalg.norm(end - start) > 8.0:
            break
    speed = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
    _, force, seconds = along(start, end, speed, *_finger(rng))
    told = set()
    for _, _, touches in play(force, seconds + 0.1, int(rng.integers(2**31))):
        told |= {touch.id for touch in touches}
    return told


def passing_ids(rng, apart: float = 3.0) -> tuple[list[set[int]], float]:
    """Two fingers drawn past each other on lines `apart` cells apart, 0.05 to 0.6 m/s each.

    Returns:
        for each finger, the ids that the touch nearest to it had whenever there were two: one each,
        if they kept theirs; and the share of frames in which both were one contact.
    """
    angle = rng.uniform(0.0, 2 * np.pi)
    ahead = np.array([np.sin(angle), np.cos(angle)])
    aside = np.array([ahead[1], -ahead[0]]) * apart / 2
    middle = np.array([7.5, 7.5])
    speeds = np.exp(rng.uniform(np.log(0.05), np.log(0.6), 2))
    fingers = []
    for sign, speed in zip((1.0, -1.0), speeds, strict=True):
        way = 5.0 * sign * ahead
        fingers.append(
            along(middle - way + sign * aside, middle + way + sign * aside, speed, *_finger(rng))
        )
    # the faster one starts late, so that they meet halfway
    seconds = max(f[2] for f in fingers)
    late = [(seconds - f[2]) / 2 for f in fingers]

    def scene(t):
        return sum(f[1](t - d) for f, d in zip(fingers, late, strict=True))

    ids, joined, both = [set(), set()], 0, 0
    for t, _, touches in play(scene, seconds, int(rng.integers(2**31))):
        if not all(0.1 < t - d < f[2] - 0.1 for f, d in zip(fingers, late, strict=True)):
            continue  # not both of them are pressed
        both += 1
        there = [touch for touch in touches if touch.state != RELEASED]
        joined += len(there) < 2
        if len(there) == 2:
            true = np.array([_on_skin(f[0](t - d)) for f, d in zip(fingers, late, strict=True)])
            here = np.array([touch.contact.position for touch in there])
            away = np.linalg.norm(true[:, None] - here, axis=-1)
            straight = away[0, 0] + away[1, 1] < away[0, 1] + away[1, 0]
            for k in range(2):
                ids[k].add(there[k if straight else 1 - k].id)
    return ids, joined / both


def _on_skin(place: np.ndarray) -> np.ndarray:
    """(3,) [m] of a place (row, col) [cells]."""
    row, col = place
    azimuth = (col - (COLS - 1) / 2) * SKIN.pitch / RADIUS
    up = ((ROWS - 1) / 2 - row) * SKIN.pitch
    return np.array([RADIUS * np.cos(azimuth), RADIUS * np.sin(azimuth), up])
