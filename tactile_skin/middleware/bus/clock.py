# SPDX-License-Identifier: Apache-2.0
"""Time, as a node sees it."""

from __future__ import annotations

import time
from dataclasses import dataclass

from ... import msg


@dataclass(frozen=True, order=True)
class Time:
    nanoseconds: int = 0

    def to_msg(self) -> msg.Time:
        return msg.Time(*divmod(self.nanoseconds, 10**9))

    @classmethod
    def from_msg(cls, stamp: msg.Time) -> Time:
        return cls(stamp.sec * 10**9 + stamp.nanosec)


class Clock:
    """Time of day that never jumps: wall clock at start, then the monotonic clock.

    Attributes:
        stands_still: a simulation's clock may, and so nothing that waits for it would happen.
    """

    stands_still = False

    def __init__(self):
        self._offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> Time:
        return Time(self._offset + time.monotonic_ns())

    @staticmethod
    def monotonic() -> float:
        """Seconds that went by, since whenever."""
        return time.monotonic()


class ManualClock:
    """A clock that a test drives."""

    stands_still = False

    def __init__(self, seconds: float = 1000.0):
        self._now = round(seconds * 1e9)
        self._set = 0

    def now(self) -> Time:
        return Time(self._now)

    def monotonic(self) -> float:
        """Seconds that went by, since whenever."""
        return (self._now - self._set) * 1e-9

    def advance(self, seconds: float) -> None:
        self._now += round(seconds * 1e9)

    def set(self, seconds: float) -> None:
        """Show another time of day, by so much, although no time goes by."""
        self._now += round(seconds * 1e9)
        self._set += round(seconds * 1e9)
