# SPDX-License-Identifier: Apache-2.0
"""A line that is open again and again, each time too shortly for a fault of the circuit."""

from __future__ import annotations

from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from .check import Check, Seen

# Chosen with seeds 7101 (sound boards, on which no line was open in a frame) and 7102.
_TIMES = 3  # that a line opens, which make a fault
_WITHIN = 10.0  # s
_APART = 0.1  # s without one: a contact that chatters opens once


class LooseLines(Check):
    """Follows how often each line opens; over once it has not for some seconds."""

    def __init__(self, adc: Adc, threshold: float = 0.0):
        self.forget()

    def forget(self) -> None:
        self.found: Finding | None = None
        self._opened: list[tuple[float, Finding]] = []
        self._last, self._closed = 0.0, True  # s, when a line was open; whether it closed since

    def frame(self, seen: Seen) -> None:
        t, finding = seen.t, seen.estimate.finding
        self._opened = [pair for pair in self._opened if 0.0 <= t - pair[0] < _WITHIN]
        if seen.estimate.status == "ok":
            self._closed = True
        elif isinstance(finding, Finding) and finding.kind is Kind.OPEN:
            if self._closed and not 0.0 <= t - self._last < _APART:
                self._opened.append((t, finding))
            self._last, self._closed = t, False
        same = [f for _, f in self._opened if f == self._opened[-1][1]]
        if len(same) < _TIMES:
            self.found = None
            return
        numbers = {"count": len(same), "seconds": _WITHIN}
        self.found = Finding(
            Kind.CONTACT, "returns", Severity.FAULT, same[-1].rows, same[-1].cols, numbers
        )
