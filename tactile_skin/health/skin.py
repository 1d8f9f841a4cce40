# SPDX-License-Identifier: Apache-2.0
"""One running skin: what is known of it by now, the picture of each frame, and what is wrong.

A frame is fitted with the rest and the circuit that the frames before it told.
"""

from __future__ import annotations

import datetime
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from ..calibration.at_rest import LEAST_STEPS
from ..calibration.bound import PARTS, Unknown, scale_at_rest, upper_bound
from ..calibration.creep import Standing
from ..calibration.tare import Tare
from ..calibration.touched import STIRRED, STIRRED_CELLS, TOUCHED
from ..calibration.tracker import CircuitTracker
from ..findings.finding import Finding, Kind, Severity
from ..physics.adc import Adc
from ..physics.circuit import forward
from ..physics.creep import Creep
from ..physics.curve import PressureCurve
from ..physics.proof import Proof
from ..solvers import METHODS, Estimate, compensate
from ..solvers.reading import ROUNDING_NOISE, SCAN_NOISE, rest_reading
from .check import Seen
from .monitor import SkinMonitor
from .standing import STANDS

_LEARNED = "cnn", "physics"  # methods that use weights: they know the circuit of their training
_BOUNDED = "map", "auto"  # methods that take a reading as a bound, and do without one
# The time limit of a frame, if none is given: so many of the board's frames, which may wait while
# one is solved; 0.05 s is what a fit of 16 x 16 cells takes on a slow computer.
_FRAMES = 2.0
_SHORTEST = 0.05  # s
_LONGEST = 0.5  # s: a push must not wait for longer
# s for which a touch counts as beginning, and `auto` hurries: a board's low-pass mixes scans then
# (two frames at 100 a second), and a fit takes longest where no picture explains the readings.
_BEGINS = 0.025
_ENDED = 1.0  # s for which readings at the end of the range count
_FOLLOW = 0.1  # share of the usual interval between frames that each frame renews


class Follower:
    """Follows one skin; all times are of one clock [s].

    Attributes:
        circuit: as the touches so far tell it.
        status, message: of the last frame, as `Estimate` has them.
        residual: of the last frame [ADC steps].
        force: on its most loaded cell [N].
        proof: what showed that its newtons are right; may be set.
        std: (rows, cols) of the last picture, one standard deviation of each force [N].
        bound: (rows, cols, 2) the most that each cell of it may feel, by the circuit and in all
            [N]; of creep what came after the first second is taken out.
        waits: whether the rest has still to be measured for the first time.
        taken: method -> number of frames.
        fitted: whether the last frame was fitted in full, not in a hurry.
    """

    def __init__(
        self,
        adc: Adc,
        curve: PressureCurve,
        creep: Creep,
        *,
        r_par_std: float | None,
        follows: bool,
        noise: float | None,
        threshold: float,
        time_limit: float,
        weights,
        proof: Proof,
        today: datetime.date,
        warn: Callable[[str], None],
    ):
        """Prepare a skin of which nothing has been read.

        Args:
            adc: the board's converter, with its circuit.
            curve: of the fabric.
            creep: what a standing load gains, which is taken out of what is published.
            r_par_std: how well its r_par is known [ohm]; None: as well as a data sheet says it.
            follows: whether to measure what the cells read at rest.
            noise: RMS of a reading [ADC steps]; None: measured.
            threshold: ADC ratio up to which the board sends 0 or no reading.
            time_limit: after which a frame fails [s]; 0: by the board's rate.
            weights: of a network; None: those of the package.
            proof, today: what showed that its newtons are right; the day, since it ages.
            warn: takes what somebody should know, and no stop is for.
        """
        self.circuit = adc.circuit
        self._adc, self._curve, self._follows = adc, curve, follows
        self._weights, self._warn = weights, warn
        floor, ceiling = adc.range
        self._tare = Tare(self.circuit, curve, floor)
        self._threshold, self._least = threshold, max(threshold, floor)
        self._bounds = {"ceiling": ceiling, "missing": True}
        self._noise = noise
        self._time_limit, self._interval, self._at = time_limit, 0.0, np.nan  # s; of the last frame
        self._standing = Standing(creep, curve) if creep.share else None
        self._tracker = CircuitTracker(self.circuit, r_par_std)
        self.proof, self._today = proof, today
        self._scale: tuple[PressureCurve, float] | None = None  # by how which curve rests
        self._monitor = SkinMonitor(adc, threshold)
        self._last: Estimate | None = None  # the last frame: where the next starts from
        self._rested = -np.inf  # s, of the last frame in which nothing touched
        self._ended = 0  # readings of the last frame at the end of the ADC's range
        self._ended_at = -np.inf  # s, of the last frame in which some were
        self.waits = follows
        self.status, self.message, self.residual, self.force = "ok", "", 0.0, 0.0
        self._doubt: Finding | None = None  # of the last frame
        self.std = np.zeros(self.circuit.shape)
        self.bound = np.zeros((*self.circuit.shape, 2))
        self.taken: Counter[str] = Counter()
        self.fitted = True

    def use(self, method: str) -> None:
        """Use another method from now on; ValueError: there is none, or it does not fit."""
        if method not in METHODS:
            raise ValueError(f"method = {method!r}: must be one of {', '.join(METHODS)}")
        weights = self._weights if method in _LEARNED else None
        given: dict[str, Any] = {"noise": self._noise, "weights": weights}
        given |= self._bounds if method in _BOUNDED else {}
        # Loads the weights, and says here, not at a frame, that they do not fit.
        flat = np.full(self.circuit.shape, 0.05)
        compensate(flat, self.circuit, self._tare.curve, method, **given)
        self._method, self._given, self._last = method, given, None

    def frame(
        self, t: float, samples: np.ndarray, *, late: bool = False, stopped: bool = False
    ) -> np.ndarray | None:
        """Take a frame.

        Args:
            t: when it was read.
            samples: (rows, cols) of skin/adc.
            late: whether it has waited: `auto` hurries then, and as a touch begins.
            stopped: whether a fault of this skin stops the robot.

        Returns:
            (rows, cols) force [N]; None: no picture was found.
        """
        since, self._at = t - self._at, t
        if since > 0.0:
            self._interval += _FOLLOW * (since - self._interval)
        try:
            if samples.shape != (shape := self.circuit.shape):
                raise ValueError(f"reading has shape {samples.shape}: the circuit is {shape}")
            if samples.dtype.kind != "u":
                raise ValueError(f"reading is of {samples.dtype}: must be uint16")
            adc = self._adc.ratio_of(samples)
            begins = 0.0 < t - self._rested < _BEGINS
            estimate = self._compensate(adc, hurry=(late or begins) and not self._threshold)
        except ValueError as error:
            self.refuse(str(error))
            return None
        self._rested = t if estimate.method == "rest" else self._rested
        self.fitted = estimate.method != "fixed_point" or self._method != "auto"
        # what is in doubt may be a bad local fit
        self._last = None if self.fitted and estimate.status != "ok" else estimate
        self.taken[str(estimate.method)] += 1
        self.status, self.message = str(estimate.status), str(estimate.message)
        self._doubt = estimate.finding if isinstance(estimate.finding, Finding) else None
        self.residual, self.force = float(estimate.residual), float(estimate.force.max())
        self.std = estimate.std
        at_end = self._adc.bounds(adc) & (adc >= self._adc.range[1])
        at_end |= adc >= self.circuit.near_short
        self._ended = int(np.count_nonzero(at_end))
        self._ended_at = t if self._ended else self._ended_at
        force = None
        if estimate.status != "failed":
            self._rest(t, adc, estimate)
            force = upper = estimate.force
            if standing := self._standing:
                force = standing.update(t, estimate.force)
                upper = standing.most
            unread = np.isnan(adc)
            if estimate.aside is not None:  # what is set aside says nothing of its own cell
                unread |= estimate.aside
            std = np.where(unread, estimate.std, 0.0) if unread.any() else None
            self.bound = upper_bound(upper, std, self.circuit, self._tare.curve, self.unknown)
        touched = self.force >= TOUCHED
        stirs = touched or bool(np.count_nonzero(estimate.force > STIRRED) >= STIRRED_CELLS)
        curve, known = self._tare.curve, self._tare.measured
        rest = rest_reading(self.circuit, curve) if known else None
        ohm = curve.rest_resistance if known else None
        noise = (self._tare.noise or SCAN_NOISE) / self.circuit.full_scale
        rising, opens = self._adc.rising(samples), self._tare.opens
        seen = Seen(t, samples, rising, adc, estimate, stirs, rest, noise, ohm, opens)
        self._monitor.frame(seen, judged=self.fitted)
        if self.waits and self._tare.measured:  # doubts no longer count, nor this frame's
            self.waits = False
            self._monitor.forget_doubts()
        self._learn_circuit(t, adc, touched, stopped)
        return force

    def refuse(self, why: str) -> None:
        """Refuse a frame of which nothing can be made."""
        self.status, self.message, self._doubt = "failed", why, None

    def _compensate(self, adc: np.ndarray, hurry: bool) -> Estimate:
        given = self._given | {"hurry": hurry, "start": self._last}
        given["threshold"] = self._floor if self._method in _BOUNDED else self._threshold
        if self._noise is None and self._tare.noise is not None:
            given["noise"] = max(self._tare.noise, ROUNDING_NOISE)
        limit = self._time_limit or min(max(_FRAMES * self._interval, _SHORTEST), _LONGEST)
        curve = self._tare.curve
        return compensate(adc, self.circuit, curve, self._method, time_limit=limit, **given)

    @property
    def _floor(self) -> float:
        """ADC ratio up to which a reading is a bound.

        At rest a sheet that is open reads noise that is cut at 0, and the ADC's own offset.
        """
        opens = LEAST_STEPS / self.circuit.full_scale if self._tare.opens else 0.0
        return max(self._least, opens)

    def _rest(self, t: float, adc: np.ndarray, estimate: Estimate) -> None:
        if self._least:  # what is not told is no rest
            adc = np.where(adc <= self._least, 0.0, adc)
        unread = np.isnan(adc)
        if unread.any():  # what the model reads there
            model = forward(self.circuit, self._tare.curve.resistance(estimate.force))
            adc = np.where(unread, model, adc)
        learns = self._follows and not any(f.kind is Kind.ZEROS for f in self._monitor.findings())
        if learns and self._tare.update(t, adc, estimate.force):
            self._last = None

    def _learn_circuit(self, t: float, adc: np.ndarray, touched: bool, stopped: bool) -> None:
        """Learn what lies in series, by touches; work it out while none is there, or a stop is."""
        known = self._follows and self._tare.measured and self._adc.table is None
        if not known or self._method in _LEARNED:
            return
        noise = max(self._tare.noise or SCAN_NOISE, ROUNDING_NOISE)
        if touched and not self._adc.bounds(adc).any():
            self._tracker.offer(t, adc, noise)
        # what nothing has shown yet counts against each touch: it is asked at once
        if touched and not self._tracker.overdue(t, stopped or not self.proof.proved):
            return
        try:
            if self._tracker.ask(self._tare.curve, noise):
                self._tare.suppose(self._tracker.circuit)
                self.circuit, self._last = self._tracker.circuit, None
                self._monitor.explained()
        except ValueError as error:  # no skin rests so with what was found: begin anew
            self._warn(f"what lies in series was not found: {error}")
            self._tracker = CircuitTracker(self.circuit)

    def reset(self) -> None:
        """Somebody has checked the skin: faults that the last frames no longer show are over."""
        self._last = None
        self._monitor.reset()

    def tare(self) -> str:
        """Measure the rest anew, as at the start; why not, empty if it is done."""
        if not self._follows:
            return "the tare is off: see `tare` and `threshold`"
        if self.force >= TOUCHED:
            return f"something presses with {self.force:.2g} N on a cell"
        if self._monitor.held:
            return f"a fault is kept ({self._monitor.held}): reset first"
        self._tare = Tare(self.circuit, self._curve, self._adc.range[0])
        self.waits, self._last = True, None
        self._monitor.begin_anew()
        return ""

    @property
    def unrested(self) -> Finding | None:
        """Why the rest is not measured yet; None: it is, or nothing keeps it from being."""
        return None if self._tare.measured else self._tare.found

    @property
    def stands(self) -> str:
        """What a touch that stands without moving may be; empty: none does."""
        return next((str(f) for f in self._monitor.findings() if f.form == STANDS), "")

    @property
    def fault(self) -> bool:
        """Whether the readings, or the circuit, are not a sound skin's."""
        unseen = self.waits and self._tare.unseen
        return unseen or self._monitor.doubtful or any(f.stops for f in self.findings())

    def findings(self, *, past: bool = True) -> list[Finding]:
        """Return all that is wrong, the worst first; `past`: in earlier frames, too."""
        if self.status == "failed":
            frame = [Finding(Kind.NO_PICTURE, severity=Severity.FAULT, detail=self.message)]
        else:
            frame = self._monitor.misfit(self._doubt, past=past)
        found = [
            *filter(None, [self._tare.noted, self._tare.found]),
            *self._monitor.findings(),
            *frame,
            *self._tracker.findings(),
        ]
        if self._ended:
            found.append(Finding(Kind.SATURATION, "range", numbers={"count": self._ended}))
        return sorted(found, key=lambda finding: finding.rank)

    @property
    def rest_resistance(self) -> np.ndarray | None:
        """(rows, cols) of each untouched cell [ohm]; None: not measured yet."""
        rest = self._tare.curve.rest_resistance
        return rest if isinstance(rest, np.ndarray) else None

    @property
    def ends(self) -> bool:
        """Whether readings have just been at the end of the ADC's range."""
        return 0.0 <= self._at - self._ended_at < _ENDED

    @property
    def unknown(self) -> Unknown:
        """What is not known of the skin, by which a force may exceed what is felt."""
        factor, proved = self.proof.factor(self._today), self.proof.proved
        return Unknown(self.hidden_series, self._scale_at_rest, factor, proved)

    @property
    def _scale_at_rest(self) -> float:
        curve = self._tare.curve
        if self.proof.proved or not self._tare.measured:
            return 1.0
        if self._scale is None or self._scale[0] is not curve:
            self._scale = curve, scale_at_rest(self.circuit, curve)
        return self._scale[1]

    @property
    def unknown_series(self) -> float:
        """By how much what lies in series may exceed that of `circuit` [ohm]."""
        # another one changes all cells at rest at once
        changed = any(f.kind is Kind.ALL_CELLS for f in self._monitor.findings())
        # nobody has shown that an r_par is right which was merely entered
        parts = 0.0 if self.proof.proved else PARTS - self.circuit.r_par
        return self._tracker.unknown(changed=changed, parts=parts)

    @property
    def hidden_series(self) -> float:
        """What readings may hide of a touch as so much more in series does [ohm].

        That is the noise of a reading near a short circuit, of all readings of a sense line where
        they share their sum; and at the end of the range all that reads so.
        """
        circuit, end = self.circuit, min(self._adc.range[1], self.circuit.near_short)
        readings = circuit.shape[circuit.sense_axis] if circuit.readout_class.shares_sum else 1
        noise = max(self._tare.noise or SCAN_NOISE, ROUNDING_NOISE) * readings**0.5
        hidden = np.hypot(self.unknown_series, circuit.r_ref * noise / circuit.full_scale)
        return float(hidden + (circuit.two_terminal(np.array(end)) if self.ends else 0.0))

    def values(self) -> dict[str, str]:
        """For diagnostics."""
        values = {"residual": f"{self.residual:.3f}"}
        values["tare"] = str(self._tare.found or ("ok" if self._follows else "off"))
        if self._tare.noise is not None:
            values["noise"] = f"{self._tare.noise:.2f}"
        values |= self._tracker.values()
        return values | {f"frames_{name}": str(n) for name, n in self.taken.items()}
