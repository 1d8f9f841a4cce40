# SPDX-License-Identifier: Apache-2.0
"""Touches of a body: what crosses from one mat to its neighbour is one touch, with one id.

Each mat gives its own touches ids. Here a touch that begins on a mat close to where one is, or was
a moment ago, on a neighbour is that one: a finger on a seam has a piece on both mats. Which mats
are neighbours follows from where their cells are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..behaviours.pace import MAX_PARAMETER
from ..behaviours.stop import TRANSPORT
from ..touch.geometry import PITCH, Geometry
from ..touch.tracking import IDS, LONGEST, Course

_SEAM = 2.5  # pitches between the outermost cells of two mats, up to which they are neighbours
_REACH = 0.75  # pitches more from where a touch is expected within which it is found
_MAX_ABSENCE = 0.15  # s that a touch may be on no mat: a seam of 40 mm at 0.3 m/s
# s after which a mat that says nothing is touched no more: until then its stop may be free
OLDEST = MAX_PARAMETER + TRANSPORT
# Cells that a touch counts as for its course while it has been on two mats: its centre stands at
# the edge of one, and leaps over the gap. Chosen on seed 100 of benchmarks.body.seam.
_ON_SEAM = 0.8
_MEMORY = 2.0  # s that a mat's id is remembered: as long as its tracker remembers a joined touch


class Piece(NamedTuple):
    """A touch as one skin gives it, in the base frame."""

    id: int  # of the skin's own
    position: np.ndarray  # (3,) [m]
    force: float  # [N]
    area: float  # [m^2]
    peak: float  # [N], on one cell
    # [N], the most that its force, and its peak, may be
    bound: float = 0.0
    peak_bound: float = 0.0


class BodyTouch(NamedTuple):
    """A touch of the body."""

    id: int  # from 1
    new: bool  # it has not been reported before
    skin: str  # that bears most of it
    position: np.ndarray  # (3,) [m], centre of force of its pieces
    velocity: np.ndarray  # (3,) [m/s]; zero until it is known
    force: float  # [N], of all pieces, as are area and peak
    area: float
    peak: float
    bound: float  # [N], the most that its force may be; of its peak
    peak_bound: float


class _Track:
    def __init__(self, number: int, pitch: float):
        self.id, self.new = number, True
        self._course = Course(pitch)
        self.pieces: dict[str, Piece] = {}  # skin -> its piece; empty while it is on no mat
        self.last: dict[str, tuple[float, np.ndarray]] = {}  # skin -> when and where it was there
        self.seen = -math.inf

    @property
    def position(self) -> np.ndarray:
        forces = np.array([p.force for p in self.pieces.values()])
        places = np.array([p.position for p in self.pieces.values()])
        centre: np.ndarray = forces @ places / forces.sum()
        return centre

    def move(self, t: float) -> None:
        """Take the place of its pieces at t; mats may read at the same time, or a bit before."""
        self.seen = max(t, self.seen)
        forces = [piece.force for piece in self.pieces.values()]
        peak = max(piece.peak for piece in self.pieces.values())
        crosses = sum(t - when <= LONGEST for when, _ in self.last.values()) > 1
        self._course.add(t, self.position, _ON_SEAM if crosses else sum(forces) / peak)

    @property
    def velocity(self) -> np.ndarray:
        return self._course.velocity

    def away(self, t: float, skins: Mapping[str, float], place: np.ndarray) -> float:
        """Distance from where it is expected at t to a place on another skin, over its reach.

        Args:
            skins: neighbour of that skin -> reach [m].
        """
        ratios = [
            float(np.linalg.norm(place - where - self.velocity * min(t - when, _MAX_ABSENCE)))
            / reach
            for skin, reach in skins.items()
            if skin in self.last
            for when, where in [self.last[skin]]
            if t - when <= _MAX_ABSENCE
        ]
        return min(ratios, default=math.inf)


class BodyTracker:
    """Gives the touches of several skins the ids of the body.

    Args:
        skins: name -> geometry. One of unknown shape has no neighbours.
    """

    def __init__(self, skins: Mapping[str, Geometry]):
        self.reach = reaches(skins)
        self._pitch = max((g.pitch for g in skins.values()), default=PITCH)
        self._of: dict[tuple[str, int], tuple[_Track, float]] = {}  # touch of a skin -> when seen
        self._tracks: list[_Track] = []
        self._taken: dict[str, float] = {}  # skin -> stamp of its last frame
        self._ids = 0

    def update(self, t: float, skin: str, pieces: list[Piece]) -> None:
        """Take the touches of one skin at t [s]; those that it no longer has are over on it."""
        if t < self._taken.get(skin, -math.inf):  # the clock was set back
            self._of, self._tracks, self._taken = {}, [], {}
        self._taken[skin] = t
        before = [track for track in self._tracks if skin in track.pieces]
        for track in before:
            del track.pieces[skin]
        unknown = []
        for piece in pieces:
            track, _ = self._of.get((skin, piece.id), (None, t))
            if track is None or skin in track.pieces:
                unknown.append(piece)
            else:
                self._put(t, skin, piece, track)
        for piece in unknown:
            self._put(t, skin, piece, self._crossing(t, skin, piece) or self._new())
        for track in {id(x): x for x in self._tracks if skin in x.pieces or x in before}.values():
            if track.pieces:
                track.move(t)
        self._forget(t)

    def touches(self) -> list[BodyTouch]:
        """Return what touches the body now, the oldest first."""
        found = []
        for track in self._tracks:
            if pieces := track.pieces:
                most = max(pieces, key=lambda skin: pieces[skin].force)
                force, area, bound = (
                    sum(getattr(p, name) for p in pieces.values())
                    for name in ("force", "area", "bound")
                )
                peak = max(p.peak for p in pieces.values())
                peak_bound = max(p.peak_bound for p in pieces.values())
                who = track.id, track.new, most, track.position, track.velocity
                found.append(BodyTouch(*who, force, area, peak, bound, peak_bound))
                track.new = False
        return found

    def _put(self, t: float, skin: str, piece: Piece, track: _Track) -> None:
        track.pieces[skin] = piece
        track.last[skin] = t, piece.position
        self._of[skin, piece.id] = track, t
        if track not in self._tracks:
            self._tracks.append(track)

    def _crossing(self, t: float, skin: str, piece: Piece) -> _Track | None:
        """Return the touch of a neighbour that a new one of this skin continues."""
        near = [
            (away, track)
            for track in self._tracks
            if skin not in track.pieces
            and (away := track.away(t, self.reach.get(skin, {}), piece.position)) <= 1.0
        ]
        return min(near, key=lambda item: item[0])[1] if near else None

    def _new(self) -> _Track:
        self._ids = self._ids % (IDS - 1) + 1
        return _Track(self._ids, self._pitch)

    def _forget(self, t: float) -> None:
        for skin, taken in self._taken.items():
            for track in self._tracks if t - taken > OLDEST else ():
                track.pieces.pop(skin, None)
        self._tracks = [x for x in self._tracks if x.pieces or t - x.seen <= _MAX_ABSENCE]
        self._of = {key: value for key, value in self._of.items() if t - value[1] <= _MEMORY}


def coincident(skins: Mapping[str, Geometry]) -> tuple[str, str] | None:
    """Return two skins most of whose cells lie at one place and face one way; None: there are none.

    So lie skins whose place nobody gave.
    """
    for (name, one), (other, two) in itertools.combinations(skins.items(), 2):
        there, others = one.normal.any(-1), two.normal.any(-1)
        away, nearest = cKDTree(two.position[others]).query(one.position[there])
        facing = (one.normal[there] * two.normal[others][nearest]).sum(-1) > 0.0
        if ((away < 0.5 * one.pitch) & facing).mean() > 0.5:
            return name, other
    return None


def reaches(skins: Mapping[str, Geometry]) -> dict[str, dict[str, float]]:
    """Return skin -> neighbour -> how far a touch may be from where it is expected across [m]."""
    found: dict[str, dict[str, float]] = {}
    there = {name: g.position[g.normal.any(-1)] for name, g in skins.items()}
    for name, cells in there.items():
        for other, others in there.items():
            if name == other or not (cells.size and others.size):
                continue
            pitch = max(skins[name].pitch, skins[other].pitch)
            gap = float(cKDTree(others).query(cells)[0].min())
            if gap <= _SEAM * pitch:
                found.setdefault(name, {})[other] = gap + _REACH * pitch
    return found
