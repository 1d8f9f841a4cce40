# SPDX-License-Identifier: Apache-2.0
"""What lies in series with a running skin: `identify`, one touch that stands at a time."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from ..findings.finding import Finding, Kind, Severity
from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from ..solvers.evidence import (
    MIN_SCALE,
    RELEVANT,
    REST_FRAMES,
    SOFT,
    Evidence,
    Supposed,
    series_scale,
)
from ..solvers.reading import rest_reading, rounding_left
from ..solvers.suspect import BEYOND
from .identify import (
    CONTRADICTION,
    FEWEST,
    Solution,
    names,
    prior_of,
    shifted,
    told_below,
    values,
    without_r_par,
)
from .rest import Rest, supposing
from .touched import stands_anew

_KEPT = 24  # touches: the latest, since boards warm up and connectors age
_LATEST = 2 * FEWEST  # of them that may overrule it
_PATIENCE = 2.0  # s that a stretch waits for a pause between touches,
_STOPPED = 0.15  # and for more of it, while a stop gives time
_REFINED = 2.0  # standard deviations by which what was learnt since must be wrong
_RELEVANT_OTHER = 1.5  # ohm, of r_line and r_drive: less changes no picture
_EXPLAINED = 3.0  # chi^2 a reading, in the median frame, beyond which there is another fault
# Beside the configured r_par, as share of it, or of `MIN_SCALE` r_ref, if that is more: of a loaded
# matrix, where r_ref changes nothing of it, only above; ohm of the others: a multiplexer that
# drives has up to 1050 (data sheet of the CD4051B at 5 V and 25 degrees).
POSSIBLE = {"r_par": 0.5, "r_line": 60.0, "r_drive": 1050.0}
# Ohm of an Arduino's pin (data sheet of the ATmega328P), by which r_drive may exceed what is
# configured as long as nothing tells.
PIN = 25.0


class _Asked(NamedTuple):
    adc: np.ndarray  # (rows, cols) mean of a stretch
    noise: float  # RMS of it [ADC steps]
    at: np.ndarray  # (2,) ohm beside the configured, that were supposed
    evidence: Evidence


class _Stretch(NamedTuple):
    """Frames of a touch that stands."""

    total: np.ndarray  # (rows, cols) of their ADC ratios
    frames: int

    @property
    def mean(self) -> np.ndarray:
        return self.total / self.frames


class CircuitTracker:
    """Follows the circuit of one skin beside the configured one.

    Attributes:
        circuit: what is known of it; the configured one until touches tell another.
        std: (2,) of `identify.names` [ohm]; infinite as long as nothing is known.
    """

    def __init__(self, circuit: Circuit, r_par_std: float | None = None):
        """Follow a skin from its configured circuit.

        Args:
            r_par_std: how well its r_par was known when the curve was found with it [ohm]; None: as
                well as a data sheet says it, and the curve is of the fabric alone.
        """
        self.circuit, self._configured = circuit, circuit
        self._calibrated = r_par_std is not None
        # A curve makes up for the error of the r_par that it was found with, any if nothing told
        # it: newtons are right with that r_par only. What is further off has changed since.
        limits = told_below(circuit)
        told = (r_par_std or 0.0) <= limits[0]
        self._made_up_for = CONTRADICTION * (r_par_std or 0.0) if told else np.inf  # ohm
        by_data_sheet = float(prior_of(circuit)[0, 0] ** -0.5)
        self._known_to = [by_data_sheet if r_par_std is None else r_par_std]
        self._hardly = 2.0 * limits  # ohm of std above which a resistance is not known at all
        self._tells_drivers = names(circuit)[1] == "r_drive"
        if self._tells_drivers:
            self._known_to.append(PIN if r_par_std is None else limits[1])
        self.std = np.full(2, np.inf)
        self._learnt: list[Finding] = []
        self._likely: list[Finding] = []
        self._off = np.zeros(2)  # beside the configured [ohm]: the best guess
        self._adopted = np.zeros(2)  # the same, of `circuit`
        self._asked: deque[_Asked] = deque(maxlen=_KEPT)
        self._supposed: Supposed | None = None  # with what the last touch was asked
        self._rest: Rest | None = None
        self._waiting: _Stretch | None = None  # the longest since the last that was asked
        self._standing: _Stretch | None = None
        self._last: np.ndarray | None = None  # of those asked
        self._t = -np.inf  # s, since when one waits

    def offer(self, t: float, adc: np.ndarray, noise: float) -> None:
        """Take a frame with a touch; while one stands, their mean is asked when there is time.

        Args:
            t: when it was read [s].
            adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
            noise: RMS of a reading [ADC steps].
        """
        noise /= self._configured.full_scale
        standing = self._standing
        if standing is None or not stands_anew(adc, standing.mean, self._last, noise):
            self._standing = _Stretch(adc, 1)
            return
        standing = self._standing = _Stretch(standing.total + adc, standing.frames + 1)
        if self._waiting is None:
            self._t = t
        if self._waiting is None or standing.frames > self._waiting.frames:
            self._waiting = standing

    def overdue(self, t: float, stopped: bool) -> bool:
        """Whether a stretch has waited for a pause for so long that it is asked in a touch.

        Args:
            stopped: whether nothing is lost if that takes some milliseconds.
        """
        return self._waiting is not None and t - self._t > (_STOPPED if stopped else _PATIENCE)

    def unknown(self, *, changed: bool = False, parts: float = 0.0) -> float:
        """Return by how much what lies in series may exceed that of `circuit` [ohm].

        This is the best guess, which may not be sure enough to be used, and its std.

        An ohm of r_drive hides as much of a touch as one of r_par does on a loaded matrix.

        Args:
            changed: whether it may be another than that of the touches so far.
            parts: what those of a board have beyond it at most, until touches or a measurement
                show how much it is [ohm].
        """
        n = len(self._known_to)
        more = np.maximum(self._off - self._adopted, 0.0)[:n].sum()
        std = np.full(n, np.inf) if changed else self.std[:n]
        known_to = np.array(self._known_to)
        if not self._calibrated:
            known_to[0] = max(known_to[0], parts)
        return float(more + np.hypot.reduce(np.minimum(std, known_to)))

    def values(self) -> dict[str, str]:
        """For diagnostics [ohm]; empty as long as nothing is known."""
        if not np.isfinite(self.std).all():
            return {}
        std = np.hypot(self.std, self._off - self._adopted)
        found: dict[str, str] = {}
        for name, value, spread in zip(names(self.circuit), values(self.circuit), std, strict=True):
            found |= {name: f"{value:.1f}", f"{name}_std": f"{spread:.1f}"}
        return found

    def ask(self, curve: PressureCurve, noise: float) -> bool:
        """Take the stretch that waits; some milliseconds.

        Args:
            curve: with the cells' rest, as it was measured if the circuit is `circuit`.
            noise: RMS of a reading [ADC steps].

        Returns:
            whether `circuit` changed.
        """
        stretch, self._waiting = self._waiting, None
        if stretch is None:
            return False
        self._last = stretch.mean
        self._suppose(curve, noise)
        circuit = self._configured
        left = rounding_left(stretch.mean[circuit.populated] * circuit.full_scale)
        of_mean = np.hypot(noise / stretch.frames**0.5, left)
        self._take(stretch.mean, float(of_mean))
        if self._asked and (self._asked[0].at != self._off).any():
            old = self._asked.popleft()
            self._take(old.adc, old.noise)  # anew, by what is known now
        changed = len(self._asked) >= FEWEST and self._conclude()
        self._likely = self._suggested()
        return changed

    def _suggested(self) -> list[Finding]:
        """Return what a few touches tell: not enough to use it, but to doubt hard touches."""
        if not self._asked:
            return []
        off, _, std, _ = self._solve(list(self._asked))
        least = np.maximum(CONTRADICTION * std, self._relevant)
        least[0] = max(least[0], self._made_up_for) if self._calibrated else least[0]
        least[1] = least[1] if self._tells_drivers else np.inf
        least[std > self._hardly] = np.inf
        return self._differing("likely", off, self._adopted, std, least, Severity.WARN)

    def _differing(self, form: str, off, beside, std, least, severity: Severity) -> list[Finding]:
        """Return the resistances that are off and not `beside` the configured, all (2,) [ohm]."""
        found = []
        both = zip(names(self._configured), values(self._configured), strict=True)
        for k, (name, given) in enumerate(both):
            if abs(off[k] - beside[k]) <= least[k]:
                continue
            value, before = given + off[k], given + beside[k]
            numbers = {"value": value, "std": std[k], "given": before}
            # readings tell resistances as multiples of r_ref: they fit its own value as well
            alike = before / value - 1.0 if value > 0.0 else np.inf
            either = f"{form}, or {'r_ref' if min(before, value) > 0.0 else 'scale'}"
            how = either if form == "learnt" and k == 0 else form
            numbers |= {"alike": 100.0 * alike}  # %
            said = Finding(Kind.CIRCUIT, how, severity=severity, numbers=numbers, detail=name)
            found.append(said)
        return found

    def _suppose(self, curve: PressureCurve, noise: float) -> None:
        adc = rest_reading(self.circuit, curve)  # what it was measured by
        if self._rest is None or not np.array_equal(adc, self._rest.adc):
            conductance = self.circuit.populated / curve.rest_resistance
            self._rest, self._supposed = Rest(adc, noise, REST_FRAMES, conductance), None
        circuit = shifted(self._configured, self._off)
        if self._supposed is None or self._supposed.circuit != circuit:
            self._supposed = self._of(circuit)

    def _of(self, circuit: Circuit) -> Supposed:
        assert self._rest is not None
        return Supposed(circuit, supposing(self._rest, circuit).conductance, SOFT)

    def _take(self, adc: np.ndarray, noise: float) -> None:
        assert self._supposed is not None
        at, evidence = self._off, self._supposed.evidence(adc, noise)
        if evidence is None and self._configured.readout == "loaded":
            at = without_r_par(self._configured)
            evidence = self._of(shifted(self._configured, at)).evidence(adc, noise)
        if evidence is not None:
            self._asked.append(_Asked(adc, noise, at, evidence))

    def _conclude(self) -> bool:
        """Whether what the touches say together is another circuit than `circuit`."""
        found, latest = self._solve(list(self._asked)), list(self._asked)[-_LATEST:]
        now = self._solve(latest)
        changed = np.abs(now.off - found.off) > BEYOND * np.hypot(now.std, found.std)
        if changed.any():
            self._asked, found = deque(latest, _KEPT), now
        off, information, std, _ = found
        relevant = self._relevant
        if (np.abs(off - self._off) > np.maximum(relevant, std)).any():
            self._off = off
        self.std = std
        if std[0] > self._hardly[0]:
            if not self._tells_drivers:
                return False
            # r_drive, with the r_par that is used: touches on few lines tell no more
            told = information[1, 0] / information[1, 1] * (off[0] - self._adopted[0])
            off = np.array([self._adopted[0], max(off[1] + told, -self._configured.r_drive)])
        change = off - self._adopted
        # the two vary together: what one touch takes for stripes another takes for r_par
        sure = _REFINED if self._adopted.any() else BEYOND
        if not (np.abs(change) > relevant).any() or change @ information @ change < sure**2:
            return False
        if np.median([self._chi2(a, off) for a in self._asked]) > _EXPLAINED:
            return False
        impossible, kept = self._beyond(off), abs(off[0]) <= self._made_up_for
        form = "learnt, calibrated" if self._calibrated else "learnt"
        form = "impossible" if impossible else "kept" if kept else form
        severity = Severity.FAULT if impossible else Severity.WARN
        self._learnt = self._differing(form, off, (0.0, 0.0), self.std, relevant, severity)
        if kept:
            return False
        self._adopted, self.circuit = off, shifted(self._configured, off)
        return True

    def findings(self) -> list[Finding]:
        """Return what the configuration should say, a fault if no board is like that."""
        return self._learnt + self._likely

    @property
    def _relevant(self) -> np.ndarray:
        """Return what is relevant of each resistance (2,) [ohm]."""
        return np.array([RELEVANT * series_scale(self._configured), _RELEVANT_OTHER])

    def _beyond(self, off: np.ndarray) -> bool:
        """Whether no board is (2,) ohm off beside the configuration."""
        given = self._configured
        most = POSSIBLE["r_par"] * max(given.r_par, MIN_SCALE * given.r_ref)
        least = -np.inf if given.readout == "loaded" else -most
        return not (least <= off[0] <= most and abs(off[1]) <= POSSIBLE[names(given)[1]])

    @staticmethod
    def _chi2(asked: _Asked, off: np.ndarray) -> float:
        """Return the misfit a reading that the frame leaves with this circuit, to first order."""
        e, step = asked.evidence, off - asked.at
        return float((e.chi2 - 2.0 * e.score @ step + step @ e.information @ step) / e.count)

    def _solve(self, asked: list[_Asked]) -> Solution:
        """Return what touches say together; less surely where they differ by more than noise."""
        assert self._rest is not None and self._supposed is not None
        evidence, at = [a.evidence for a in asked], [a.at for a in asked]
        found = Solution.of(evidence, at, self._configured, self._rest, self._supposed)
        information = found.information
        less = np.min(1.0 / (information.diagonal() ** 0.5 * found.std)) ** 2
        return found._replace(information=information * less)
