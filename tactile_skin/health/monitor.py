"""What is watched on one running skin: each check takes each frame, and says what it finds.

A check is a class with `frame(seen)`, `findings()` and `forget()`. To add one takes a line in
`CHECKS`, a kind in finding.py and its words in words.csv.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from ..calibration.touched import TOUCHED
from ..findings.finding import Finding, Kind, Severity, largest
from ..physics.adc import Adc
from ..solvers import Estimate
from .ceiling import Ceiling, Window, Windows
from .doubt import Doubt
from .odd_cells import OddCells
from .rest_picture import RestPicture
from .sent import Sent
from .untouched import Untouched


class Seen(NamedTuple):
    """Holds one frame of a running skin, and what was found in it.

    Attributes:
        t: when it was read [s]; may be set back.
        samples: (rows, cols) of skin/adc.
        rising: the same, so that they rise with pressure; 0 where there is no reading.
        adc: (rows, cols) ADC ratio; NaN where there is no reading.
        estimate: of the frame.
        stirs: whether anything touches, however lightly.
        rest: (rows, cols) ADC ratio of the skin at rest; None: not measured yet.
        noise: RMS of a reading, as ADC ratio.
        window: of the last frames, which this one ends; None: it ends none.
    """

    t: float
    samples: np.ndarray
    rising: np.ndarray
    adc: np.ndarray
    estimate: Estimate
    stirs: bool
    rest: np.ndarray | None
    noise: float
    window: Window | None


class Check(Protocol):
    """Looks at one skin; it is made for a converter, with its circuit, and a threshold of the board
    [ADC ratio].
    """

    def __init__(self, adc: Adc, threshold: float): ...

    def frame(self, seen: Seen) -> None:
        """Take a frame."""

    def findings(self) -> list[Finding]:
        """Return what is wrong by now."""

    def forget(self) -> None:
        """Take what only earlier frames show as over: somebody has checked the skin."""


class LoadedAtStart:
    """Looks for a load on half of the skin since the first frame: its rest is unknown."""

    def __init__(self, adc: Adc, threshold: float):
        self._cells = np.count_nonzero(adc.circuit.populated)
        self._let_go = False
        self._found: list[Finding] = []

    def frame(self, seen: Seen) -> None:
        force = seen.estimate.force
        self._let_go = self._let_go or bool(force.max() < TOUCHED)
        loaded = 2 * np.count_nonzero(force >= TOUCHED) > self._cells and not self._let_go
        at = largest(force)
        self._found = (
            [Finding(Kind.LOADED, "since the start", severity=Severity.FAULT, **at)]
            if loaded
            else []
        )

    def findings(self) -> list[Finding]:
        return self._found

    def forget(self) -> None:
        """Do nothing: only the load's end is one."""


CHECKS: list[type[Check]] = [Sent, LoadedAtStart, RestPicture, Ceiling, Untouched, OddCells]


class Monitor:
    """Follows one skin; all times are of one clock [s]."""

    def __init__(self, adc: Adc, threshold: float, *, rest_known: bool):
        """Args:
        adc: the board's converter, with its circuit.
        threshold: ADC ratio up to which it is known to send 0 or no reading.
        rest_known: whether the rest of the cells need not be measured.
        """
        self._adc, self._threshold = adc, threshold
        self._windows = Windows(adc.circuit.adc_bits)
        self._why = ""
        self.begin_anew(rest_known=rest_known)
        self.forget_doubts()

    def begin_anew(self, *, rest_known: bool = False) -> None:
        """Watch as from the start: the rest is measured from here on."""
        skipped = (LoadedAtStart,) if rest_known else ()
        made = [make(self._adc, self._threshold) for make in CHECKS if make not in skipped]
        self._checks: list[Check] = made

    def forget_doubts(self) -> None:
        """The rest was measured for the first time: what was in doubt before was so without it."""
        self._doubt, self._doubtful = Doubt(), False

    def explained(self) -> None:
        """The circuit is known better: what the skin at rest read otherwise is explained."""
        for check in self._checks:
            if isinstance(check, Untouched):
                check.forget()

    def reset(self) -> None:
        """Somebody has checked the skin: past faults are over, what the last frames show is not."""
        self._doubt.reset()
        self._doubtful = self._doubt.present
        for check in self._checks:
            check.forget()

    def frame(self, t, samples, adc, estimate: Estimate, *, judged, stirs, rest, noise) -> None:
        """Take a frame.

        Args:
            judged: whether its status says anything of the circuit.
            others as of `Seen`.
        """
        suspect = estimate.status == "suspect"
        if suspect or judged:
            touched = bool(estimate.force.max() >= TOUCHED)
            self._doubtful = self._doubt.frame(t, suspect, touched)
        self._why = str(estimate.message) if suspect else self._why
        rising = self._adc.rising(samples)
        window = self._windows.frame(rising)
        seen = Seen(t, samples, rising, adc, estimate, stirs, rest, noise, window)
        for check in self._checks:
            check.frame(seen)

    def misfit(self, finding: Finding | None, *, past: bool = True) -> list[Finding]:
        """Return the doubt of the frames; a fault if it lasts.

        Args:
            finding: of the last frame; None: it is not in doubt.
            past: with doubts that the last frame no longer shows.
        """
        severity = Severity.FAULT if self._doubtful else Severity.WARN
        if finding:
            return [replace(finding, severity=severity)]
        if past and self._doubt.kept:
            why = f"{self._why} ({self._doubt.kept})"
            return [Finding(Kind.MISFIT, "kept", severity=severity, detail=why)]
        return []

    def findings(self) -> list[Finding]:
        """Return what the checks find."""
        return [finding for check in self._checks for finding in check.findings()]

    @property
    def doubtful(self) -> bool:
        """Whether so many frames are in doubt, or were under a touch, that it is a fault."""
        return self._doubtful

    @property
    def held(self) -> str:
        """Why what was seen under a touch is not over; empty if nothing was."""
        return self._why if self._doubt.held else ""
