# SPDX-License-Identifier: Apache-2.0
"""Where one frame is in another: the tree of transforms that a robot publishes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

# s by which the stamps of a transform and of a touch may differ: an arm moves on, and a stamp from
# before the clock was set back would stay valid
_OLDEST = 0.5


class Pose(NamedTuple):
    """Of a frame in another: p -> rotation @ p + translation."""

    rotation: np.ndarray  # (3, 3)
    translation: np.ndarray  # (3,) [m]

    def after(self, other: Pose) -> Pose:
        """`other` first, then this one."""
        return Pose(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> Pose:
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def wrench(self, force: Sequence[float], torque: Sequence[float]) -> np.ndarray:
        """Return (6,) force [N] and torque about the origin [N m] of those in the frame."""
        moved = self.rotation @ force
        (x, y, z), (fx, fy, fz) = self.translation.tolist(), moved.tolist()
        moment = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx  # np.cross takes ten times that
        return np.concatenate([moved, self.rotation @ torque + moment])


IDENTITY = Pose(np.eye(3), np.zeros(3))


def pose_of(translation: Sequence[float], quaternion: Sequence[float]) -> Pose:
    """Of a translation [m] and a unit quaternion (x, y, z, w), as tf has them.

    Raises:
        ValueError: no unit quaternion, or not finite.
    """
    from scipy.spatial.transform import Rotation  # here: a skin without tf does without

    if not abs(math.hypot(*quaternion) - 1.0) < 1e-3 or not np.isfinite(translation).all():
        raise ValueError(f"transform: {translation}, {quaternion}: must be a unit quaternion")
    return Pose(Rotation.from_quat(quaternion).as_matrix(), np.asarray(translation, float))


def quaternion_of(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """(3, 3) rotation -> (x, y, z, w)."""
    from scipy.spatial.transform import Rotation

    return tuple(Rotation.from_matrix(rotation).as_quat().tolist())


class Frames:
    """Takes transforms in any order; the last of a frame counts."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Pose, float]] = {}  # child -> parent, pose, stamp [s]

    def take(self, parent: str, child: str, pose: Pose, stamp: float = math.inf) -> None:
        """Take the pose of `child` in `parent`; `stamp`: when it was so [s], always by default."""
        self._parents[child.lstrip("/")] = parent.lstrip("/"), pose, stamp

    def lookup(self, target: str, source: str, t: float) -> Pose:
        """Return the pose of `source` in `target` at t [s].

        Raises:
            LookupError: they are not connected, or by a transform of another time.
        """
        to_root = {}
        for name in (target.lstrip("/"), source.lstrip("/")):
            to_root[name] = dict(self._above(name, t))
        ups, downs = to_root[source.lstrip("/")], to_root[target.lstrip("/")]
        for common, pose in ups.items():
            if common in downs:
                return downs[common].inverse().after(pose)
        raise LookupError(f"no transform from {source} to {target}")

    def _above(self, name: str, t: float) -> Iterator[tuple[str, Pose]]:
        """Each frame above, itself first, with the frame's pose in it."""
        pose = IDENTITY
        seen: set[str] = set()
        while name not in seen:
            yield name, pose
            seen.add(name)
            if name not in self._parents:
                return
            parent, step, stamp = self._parents[name]
            if abs(t - stamp) > _OLDEST and math.isfinite(stamp):
                return
            name, pose = parent, step.after(pose)
