# SPDX-License-Identifier: Apache-2.0
"""How often readings come, how long the last one is good for, and what to say if that is too long.

With `stale_after` = 0 that time follows the board: 2.5 usual intervals, so that one reading may be
lost and the next come half an interval late. It is at least 0.1 s, since threads and USB hold
readings back by tens of milliseconds, and at most 0.5 s: that is the promise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection

MIN_STALE_AFTER = 0.1  # s, of what is measured: see above
MAX_STALE_AFTER = 0.5  # s, the same
_INTERVALS = 2.5  # usual ones for which a reading is good
_KEPT = 16  # last intervals that are averaged
_ENOUGH = 4  # of them at least, else the minimum holds
_LATELY = 5  # last intervals that the message is based on
_NEWS = 1.25  # factor by which a number must change before the text does: each text calls the hooks
RESUMED = "readings have only just resumed"  # no fault of the board, nor of the link
_ADVISED = 3.0  # usual intervals that the message advises
MAX_PARAMETER = 1.0  # s, upper limit of the parameter stale_after


class Pace:
    """Measures the pace of readings, and so how old the last one may be.

    Args:
        stale_after: [s]; 0: measured. The attribute of this name is in force now.
    """

    def __init__(self, stale_after: float):
        self.forget()
        self.configure(stale_after)

    def configure(self, stale_after: float) -> None:
        """Go on with another limit, as of the start; what is known of the readings stays."""
        self.measured = stale_after == 0.0
        self.stale_after = stale_after or MIN_STALE_AFTER
        self._follow()

    def forget(self) -> None:
        """Forget the pace of readings, since the clock was set; what is in force stays."""
        self._gaps: deque[float] = deque(maxlen=_KEPT)
        self._named = self._named_gap = 0.0  # s

    @property
    def interval(self) -> float | None:
        """Usual between readings [s]; None: too few have come."""
        return _middle(self._gaps) if len(self._gaps) >= _ENOUGH else None

    def gap(self, seconds: float) -> None:
        """Take how long after the last reading one came [s]."""
        self._gaps.append(seconds)
        self._follow()

    def _follow(self) -> None:
        if not self.measured or (usual := self.interval) is None:
            return
        wanted = _wanted(usual)
        small = 1 / _NEWS < wanted / self.stale_after < _NEWS
        if not small or (wanted in (MIN_STALE_AFTER, MAX_STALE_AFTER)):
            self.stale_after = wanted

    @property
    def patience(self) -> float:
        """Silence [s] after which readings stay away, however slowly they came."""
        return max(5.0 * self.stale_after, 3.0 * self._named)

    def slow(self) -> str:
        """Return what is wrong if readings come and none is in time; one text for one cause."""
        lately = list(self._gaps)[-_LATELY:]
        if not lately:
            return RESUMED
        usual, limit = _middle(lately), self.stale_after
        if self.measured:  # by more readings than there are yet it will be that
            limit = max(limit, _wanted(usual))
        if not 1 / _NEWS < usual / max(self._named, 1e-9) < _NEWS:
            self._named = usual
        if self._named <= limit:
            longest = max(lately)
            if longest <= limit:  # they were late by another limit
                return RESUMED
            if longest > _NEWS * self._named_gap:
                self._named_gap = longest
            return (
                f"gaps of {self._named_gap:.2g} s between readings that usually come every "
                f"{self._named:.2g} s, but stale_after = {limit:.2g} s: is the computer or the "
                "link overloaded?"
            )
        text = f"readings come every {self._named:.2g} s, but stale_after = {limit:.2g} s"
        if self.measured:
            return f"{text}, measured, at most {MAX_STALE_AFTER:g} s: let the board send more often"
        if _ADVISED * self._named > MAX_PARAMETER:
            return f"{text}, at most {MAX_PARAMETER:g} s: let the board send more often"
        advised = math.ceil(100.0 * _ADVISED * self._named) / 100.0
        return f"{text}: set stop_on_push.stale_after: {advised:g}, or 0.0 to have it measured"


def _wanted(usual: float) -> float:
    return min(max(_INTERVALS * usual, MIN_STALE_AFTER), MAX_STALE_AFTER)


def _middle(values: Collection[float]) -> float:
    return sorted(values)[(len(values) - 1) // 2]
