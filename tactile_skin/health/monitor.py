# SPDX-License-Identifier: Apache-2.0
"""What is watched on one running skin: each check takes each frame, and says what it finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter

from ..calibration.touched import STIRRED, TOUCHED
from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from ..physics.circuit import forward
from ..physics.readouts import apparent
from ..solvers import Estimate
from ..solvers.suspect import BEYOND, LIGHTER
from .bits import Bits
from .ceiling import Ceiling
from .check import Check, Seen, Windows, over
from .doubt import LARGE, Doubt
from .loose_lines import LooseLines
from .odd_cells import OddCells
from .rest_picture import RestPicture
from .sent import Sent
from .standing import MovingZero, Standing
from .untouched import CLEAR, Hum, Shakes, Untouched

CHECKS: list[type[Check]] = [
    Sent,
    Bits,
    RestPicture,
    Ceiling,
    Untouched,
    OddCells,
    LooseLines,
    Standing,
    MovingZero,
    Hum,
]


# In half of the frames that a shaking cover spoils a reading lies below that at rest, in all of
# them if it is lost for good: time constant of that share [s], for 3 Hz and more, and the limit.
_SWING = 0.35
_RETURNS = 0.9
# Where such a swing beats with the frame rate for longer than that: of the squares of readings that
# are low, what those that are high have. Losses only lower.
_EVEN = 0.25
# Share of its conductance at rest by which a cell that bore a load undershoots, the time with
# which that fades [s]: Velostat under a robot rests 25 to 40 % lower after a release, for 5 s.
_UNDERSHOOT = 0.45
_RECOVERS = 2.5


class SkinMonitor:
    """Follows one skin; all times are of one clock [s]."""

    def __init__(self, adc: Adc, threshold: float):
        """Watch a skin, with what `Check` takes."""
        self._adc, self._threshold = adc, threshold
        self._windows = Windows(adc.circuit.adc_bits)
        self._why = ""
        self._last: np.ndarray | None = None  # the frame before, as ADC ratio
        # share of the suspect frames in which each is below the rest
        self._below = np.zeros(adc.circuit.shape)
        self._shakes = Shakes(adc.circuit.shape)
        # which bear a load, or lie next to one that does; s, when they last ceased to
        self._bears = np.zeros(adc.circuit.shape, bool)
        self._ended = np.full(adc.circuit.shape, -np.inf)
        # s, when a reading was seen below the rest, as such a load leaves it; whether untouched
        self._low, self._undershoots = -np.inf, False
        self._t = np.inf  # s, of the suspect frame before
        self.begin_anew()
        self.forget_doubts()

    def begin_anew(self) -> None:
        """Watch as from the start: the rest is measured from here on."""
        self._checks = [make(self._adc, self._threshold) for make in CHECKS]
        self._found: list[Finding] | None = None  # by the checks since their last frame

    def forget_doubts(self) -> None:
        """Forget doubts, since the rest was measured for the first time."""
        self._doubt = Doubt()

    def explained(self) -> None:
        """Forget what the skin at rest read otherwise, since the circuit is known better."""
        for check in self._checks:
            if isinstance(check, Untouched):
                check.forget()
        self._found = None

    def reset(self) -> None:
        """Somebody has checked the skin: past faults are over, what the last frames show is not."""
        self._doubt.reset()
        for check in self._checks:
            check.forget()
        self._found = None

    def frame(self, seen: Seen, *, judged: bool) -> None:
        """Take a frame; `judged`: its status says something of the circuit."""
        estimate = seen.estimate
        touched = bool(estimate.force.max() >= TOUCHED)
        seen = seen._replace(recovers=self._recovers(seen))
        if not touched and seen.rest is not None:
            off = over(seen.adc, seen.rest)
            self._shakes.frame(seen.t, off, self._noise(estimate))
        suspect = estimate.status == "suspect" and not self._swings(seen, touched)
        if suspect or judged:
            large = suspect and self._misses(seen.adc, estimate)
            self._doubt.frame(seen.t, suspect, touched, large)
        self._last = seen.adc
        self._why = str(estimate.message) if suspect else self._why
        seen = seen._replace(window=self._windows.frame(seen.rising))
        for check in self._checks:
            check.frame(seen)
        self._found = None

    def _swings(self, seen: Seen, touched: bool) -> bool:
        """Whether what a suspect frame misses is a hum, a cover that shakes, or an undershoot."""
        elapsed, self._t = max(seen.t - self._t, 0.0), seen.t
        if seen.rest is None:
            return self._hums and not touched
        off = over(seen.adc, self._loaded(seen.rest, seen.adc))
        lost, before = np.fmin(off, 0.0) ** 2, self._below
        share = 1.0 - np.exp(-elapsed / _SWING)
        self._below = self._below + share * ((off < 0.0) - self._below)
        finding = seen.estimate.finding
        lighter = isinstance(finding, Finding) and LIGHTER in finding.numbers
        if lighter and seen.recovers and (self._undershoots or not touched):
            return True  # also where a touch raises all readings
        if not lighter or not lost.any():
            return self._hums and not touched
        begins = np.average(before, weights=lost) < _RETURNS
        clear = np.where(abs(off) > CLEAR * self._noise(seen.estimate), off, 0.0)
        even = np.square(clear[clear > 0.0]).sum() > _EVEN * np.square(clear[clear < 0.0]).sum()
        shakes = np.average(self._shakes.covers(seen.t, off), weights=lost) > _RETURNS
        return bool(shakes or (not touched and (begins or even)))

    def _noise(self, estimate: Estimate) -> float:
        """Return the noise of the frame, as ADC ratio: that of the rest has what shakes, too."""
        return float(estimate.noise) / self._adc.circuit.full_scale

    def _recovers(self, seen: Seen) -> bool:
        """Whether what lies below the rest is what a touch leaves for some seconds."""
        if seen.resting is None or seen.rest is None:
            return False
        bears = seen.estimate.force > STIRRED
        bears = maximum_filter(bears, 3) if bears.any() else bears  # or lies next to one that does
        self._ended[self._bears & ~bears] = seen.t
        self._bears = bears
        # the clock may be set back
        self._ended, self._low = np.minimum(self._ended, seen.t), min(self._low, seen.t)
        allowed = _UNDERSHOOT * np.exp((self._ended - seen.t) / _RECOVERS)
        circuit, adc = self._adc.circuit, np.where(np.isnan(seen.adc), seen.rest, seen.adc)
        if not (allowed * seen.rest > seen.noise).any():
            return False
        margin = BEYOND * seen.noise
        if (adc < self._loaded(seen.rest, adc) - margin).any():
            least = forward(circuit, seen.resting / (1.0 - allowed))
            if (adc < self._loaded(least, adc) - margin).any():
                return False
            self._low = seen.t
            self._undershoots |= bool(seen.estimate.force.max() < TOUCHED)
        return seen.t - self._low < 2.0 * _RECOVERS

    def _loaded(self, rest: np.ndarray, adc: np.ndarray) -> np.ndarray:
        """(rows, cols) what cells at rest read on lines that are loaded as those of a frame are."""
        circuit = self._adc.circuit
        adc = np.where(np.isnan(adc), rest, adc)
        return rest * (apparent(circuit, adc)[0] / apparent(circuit, rest)[0])

    def _misses(self, adc, estimate: Estimate) -> bool:
        """Whether a frame misses by more than `LARGE`, and by more than it has changed."""
        finding = estimate.finding
        times = finding.numbers.get("times", 0.0) if isinstance(finding, Finding) else 0.0
        if self._last is None or not float(times) > LARGE:
            return False
        change = over(adc, self._last) * self._adc.circuit.full_scale
        return bool(estimate.residual > np.sqrt(np.square(change).mean()))

    def misfit(self, finding: Finding | None, *, past: bool = True) -> list[Finding]:
        """Return the doubt of the last frame, or of `past` ones; a fault if it lasts."""
        severity = Severity.FAULT if self.doubtful else Severity.WARN
        if finding:
            return [replace(finding, severity=severity)]
        if past and self._doubt.kept:
            why = f"{self._why} ({self._doubt.kept})"
            return [Finding(Kind.MISFIT, "kept", severity=severity, detail=why)]
        return []

    @property
    def doubtful(self) -> bool:
        """Whether doubts are a fault."""
        return self._doubt.fault

    def findings(self) -> list[Finding]:
        """Return what the checks find; a hum moves all cells at once, and no supply."""
        if self._found is None:
            found = [finding for check in self._checks for finding in check.findings()]
            self._found = [f for f in found if not (self._hums and f.kind is Kind.ALL_CELLS)]
        return self._found

    @property
    def _hums(self) -> bool:
        return any(check.found for check in self._checks if isinstance(check, Hum))

    @property
    def held(self) -> str:
        """Why what was seen under a touch is not over; empty if nothing was."""
        return self._why if self._doubt.held else ""
