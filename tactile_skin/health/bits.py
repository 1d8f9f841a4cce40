# SPDX-License-Identifier: Apache-2.0
"""A bit of the ADC that is never set, or never cleared: live, and in a recording of the doctor.

A bit that fails in use leaves each untouched cell where it was, or moves it by the bit's weight.
One that was wrong before the rest was measured leaves gaps: of the readings that touches hold for a
while, none lies where the bit's other value would put it, between many that lie where it does not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from ..solvers.reading import FEW, ROUNDING_NOISE
from .check import ABOVE, Check, Seen, Window

GAP_READINGS = 200  # on either side of the gaps, at least; of readings that say anything new
# Readings within the gap of a high bit, over those of the emptier side: readings leap over it
# without standing there, and hard fingers on sound boards leave 0.05 or more.
HIGH_GAP = 0.03
EMPTY = 0.02  # of the readings may lie in the gap of a top bit
_LOWEST = 5  # bit that is looked for by gaps: noise and means of samples fill those of lower ones
_EVERY = 50  # readings that are new, after which to look again
_CELLS = 3  # that a bit moves at least
_SHARE = 0.75  # of the cells that agree: the others may lie about the edge of a bit, or be touched
_APART = 3.0  # times that cells at rest are further apart than they may miss what is supposed


class Gap(NamedTuple):
    """Where the other value of a bit would put readings."""

    near: float  # readings beside it, on the emptier side
    share: float  # of readings within, over that
    empty: bool  # whether there is next to none within


def gaps(counts: np.ndarray, bit: int) -> list[Gap]:
    """Return the gap of a bit that is always 0, and of one that is always 1.

    Args:
        counts: how many readings there are at each step.
    """
    margin = min((1 << bit) // 4, 4)  # noise at a block's ends
    each = counts.reshape(-1, 1 << bit)[:, margin : (1 << bit) - margin].sum(1)
    found = []
    for kept in (0, 1):
        gap, beside = each[1 - kept :: 2], each[kept::2]
        inner = gap[1:] if kept else gap[:-1]  # those between two others
        near = float(np.minimum(beside[:-1], beside[1:]).sum())
        empty = bool(counts.any() and gap.sum() <= EMPTY * each.sum())
        found.append(Gap(near, float(inner.sum() / max(near, 1.0)), empty))
    return found


class Bits(Check):
    """Follows the bits of one board's ADC; what it finds is over once the rest reads as before."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self._adc, self._bits = adc, adc.circuit.adc_bits
        self.forget()

    def forget(self) -> None:
        """Begin again: somebody has checked the board."""
        self.found: Finding | None = None
        self._before: np.ndarray | None = None  # (rows, cols) rest before a bit failed [ADC steps]
        self._counts = np.zeros(1 << self._bits)  # readings that stood, at each step
        self._last: np.ndarray | None = None  # (rows, cols) that each cell stood at [ADC steps]
        self._new = 0

    def frame(self, seen: Seen) -> None:
        if seen.window is None:
            return
        if self._before is not None:
            self._look(seen.window, self._before, seen.recovers)
        elif seen.rest is not None and self.found is None:
            self._look(seen.window, self._adc.rising_count(seen.rest), seen.recovers)
        if self.found is None:
            self._count(seen.window)

    def _look(self, window: Window, rest: np.ndarray, recovers: bool) -> None:
        """Compare readings with the rest, and what bits make of it; what recovers fell by none."""
        read = (window.mean > 0.0) & (rest > 0.0)
        if np.count_nonzero(read) < FEW:
            return
        now, at = window.mean[read], rest[read]
        most = max(at.std() / _APART, 2.0 * ROUNDING_NOISE)
        if np.quantile(np.abs(now - at), _SHARE) < most:  # as before
            self.found = self._before = None
            return
        if self.found is not None:
            return
        codes = np.rint(at).astype(int)
        for bit in range(self._bits):
            for kept in range(int(recovers), 2):
                moved = (codes >> bit & 1) != kept
                if 1 << bit < ABOVE or np.count_nonzero(moved) < max(_CELLS, 0.1 * moved.size):
                    continue
                supposed = at + (2 * kept - 1) * moved * (1 << bit)
                near = min(most, (1 << bit) / 4.0)
                if np.quantile(np.abs(now - supposed), _SHARE) < near:
                    self._before = rest
                    self._find("moved", bit, kept, {"count": np.count_nonzero(moved)})
                    return

    def _count(self, window: Window) -> None:
        """Count readings that stand, each once, and look for gaps between them."""
        width = 4.0 * (window.noise + ROUNDING_NOISE)
        stands = (window.spread <= width / 2.0) & (window.mean > window.low + 2.0 * ABOVE)
        if self._last is not None:
            stands &= np.abs(window.mean - self._last) > width
        self._last = np.where(stands, window.mean, window.low if self._last is None else self._last)
        codes = np.clip(np.rint(window.mean[stands]), 0, self._counts.size - 1).astype(int)
        np.add.at(self._counts, codes, 1.0)
        self._new += codes.size
        if self._new < _EVERY:
            return
        self._new = 0
        for bit in range(_LOWEST, self._bits - 1):
            for kept, gap in enumerate(gaps(self._counts, bit)):
                if gap.near >= GAP_READINGS and gap.share < HIGH_GAP:
                    self._find("gap", bit, kept, {"share": gap.share})
                    return

    def _find(self, form: str, bit: int, kept: int, numbers: dict) -> None:
        kept = 1 - kept if self._adc.inverted else kept  # the complement is what the board sends
        numbers |= {"bit": bit, "kept": kept}
        self.found = Finding(Kind.BITS, form, severity=Severity.FAULT, numbers=numbers)
