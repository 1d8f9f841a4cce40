# SPDX-License-Identifier: Apache-2.0
"""What a person does to calibrate a board, step by step (docs/calibrate.md).

Hands off, press here and there, lay known weights on. Each step says when it has enough, why
something does not count, and waits for a key; "b" leads a step back.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..calibration import proving
from ..calibration.curve_fit import FittedCurve, fit_curve
from ..calibration.identify import Identified, identify, reads_alike
from ..calibration.rest import Rest, measure_rest, supposing
from ..calibration.touched import MOVED, stands_anew
from ..physics.adc import Adc
from ..physics.circuit import Circuit
from ..physics.creep import Creep
from ..physics.proof import NOTHING, Proof
from ..solvers import compensate
from .sent import check_readout
from .weight import concluded, newtons

REST = 3.0  # s that the skin rests
OBJECT = 1.0  # s for which an object stands
_TRIES = 5  # to measure the rest
_FEW = 20  # frames that a rest takes at least, at any rate
TOUCHES = 30  # that are asked for at most
_EVERY = 5  # touches after which the circuit is looked for
OBJECTS = 10  # that are asked for
LEAST_OBJECTS = 3  # with fewer there is no curve
ENOUGH = 0.05  # error of a total, left out in turn, at which the objects suffice
_USELESS = 0.5  # the same, from which on the shipped curve is as good
# Share of its readings by which a load that stands may change: 0.005 at most of objects that creep,
# 0.05 and 0.09 at least of 19 in 20 that slide by half a cell and by one (seed 151000).
MOST_MOVED = 0.08
_GLANCE = 0.3  # s that a touch must stand
_PERSISTS = 4  # glances for which a press does not count before it is said why; or until it ends
_LIGHT = "too light"
PATIENCE = 20.0  # s without a new touch after which it asks whether to go on
_COUNTED = 3  # s that are counted down before a measurement, in which hands leave the skin
BACK = "b", "back"
_MORE = "m", "more"
_PITCH = 0.018  # m, the paper's
_NOTHING = Proof()

Frames = Callable[[float], np.ndarray]  # s -> (n, rows, cols) ADC ratio, of that time from now on
Ask = Callable[[str], str]  # what to show -> what was typed
Say = Callable[[str], None]
Show = Callable[[np.ndarray], None]
CountDown = Callable[[int], None]  # s to wait for, in which they are counted down


class Guide:
    """Leads through the steps, wherever frames and answers come from."""

    def __init__(
        self,
        circuit: Circuit,
        frames: Frames,
        ask: Ask,
        say: Say,
        count_down: CountDown = lambda seconds: None,
        show: Show = lambda force: None,
        *,
        pitch: float = _PITCH,
        known: Proof = _NOTHING,
        adc: Adc | None = None,
        today: Callable[[], datetime.date] = datetime.date.today,
    ):
        """Prepare the guided steps.

        Args:
            circuit: as it is configured.
            pitch: of the cells [m].
            known: what has proved the configured scale.
            adc: that reads the frames; None: a linear one.
            count_down: before a measurement; recorded frames need none.
            show: takes the force (rows, cols) [N] of what was weighed last.
        """
        self.supposed, self.frames, self.ask, self.say = circuit, frames, ask, say
        self._count_down, self._show = count_down, show
        self.pitch, self.known, self._today = pitch, known, today
        self._adc = adc or Adc(circuit)
        self.touches: list[np.ndarray] = []
        self.rest: Rest  # the untouched skin, once it is measured
        self.found: Identified | None = None  # as fitted and creep: what was learnt, None before
        self.unfit = ""  # what is doubted, where another circuit fits the touches as well
        self.fitted: FittedCurve | None = None
        self.creep: Creep | None = None
        self.proof = known

    @property
    def circuit(self) -> Circuit:
        """What the configuration says, then what the touches tell."""
        return self.found.circuit if self.found else self.supposed

    @property
    def adc(self) -> Adc:
        """The converter as configured, then as the touches tell."""
        return self._adc.bent(self.found.bent) if self.found else self._adc

    def straight(self, frames) -> np.ndarray:
        """Return (..., rows, cols) ADC ratio by what the touches tell of the converter."""
        frames = np.asarray(frames)
        return self._adc.straight(frames, self.found.bent) if self.found else frames

    @property
    def at_rest(self) -> Rest:
        """The rest by the same."""
        return replace(self.rest, adc=self.straight(self.rest.adc))

    def run(self) -> None:
        from .creep import find_creep  # here: it leads a Guide

        steps: tuple[Callable[[], bool], ...] = self.measure_rest, self._press, self.fit_curve
        steps, step = (*steps, lambda: find_creep(self)), 0
        while step < len(steps):
            step += 1 if steps[step]() else -1

    def _press(self) -> bool:
        """Lead through the touches; whether to go on, or a step back."""
        self.touches, self.found, word = [], None, _MORE[0]
        while word in _MORE:
            self.identify()
            word = self.ask("  Enter: on to the weights; m: more touches; b: back to the rest: ")
            word = word.strip()
        return word not in BACK

    @property
    def scaled(self) -> bool:
        """Whether weights go with what the touches found, now or before."""
        return self.fitted is not None or self.known.by != NOTHING

    @property
    def learnt(self) -> list[str]:
        """What the configuration did not say, and is to be written.

        Touches find resistances as multiples of r_ref: without a scale none of them is known.
        """
        told = self.found.told if self.found and self.scaled else {}
        names = [name for name, yes in told.items() if yes]
        return names + ["curve"] * bool(self.fitted) + ["creep"] * bool(self.creep)

    def measure_rest(self, of: int = 3) -> bool:
        """Measure the untouched skin; True: go on."""
        self.ask(f"1 of {of}. Take everything off the skin, and keep your hands off it. Enter: ")
        for left in reversed(range(_TRIES)):
            self._count_down(_COUNTED)
            frames = self.frames(REST)
            while len(frames) < _FEW:
                frames = np.concatenate([frames, self.frames(REST)])
            try:
                self.rest = measure_rest(frames, self.supposed)
                break
            except ValueError as error:
                if not left:
                    raise ValueError(
                        f"no rest in {_TRIES} tries: {error} If nothing does, `tactile-skin "
                        "doctor` names the line or cells to check"
                    ) from error
                self.ask(f"  {error}\n  Hands off, and Enter to measure again: ")
        usual = 1.0 / np.median(self.rest.conductance[self.supposed.populated])
        self.say(
            f"  {len(frames)} frames: a cell has {usual:.0f} ohm at rest, a reading "
            f"{self.rest.noise:.2f} ADC steps of noise."
        )
        for row, col in self.rest.noisy:
            at = f"row {row}, column {col}"
            self.say(f"  {at} is noisy: its readings are left out here. Check its contact.")
        return True

    def identify(self) -> None:
        """Find what lies in series, by touches beside those that there are."""
        self.say(
            "2 of 3. Press here and there, near the edges too: hard, with a knuckle, a\n  palm, "
            f"both hands. Hold each touch for a moment. {2 * _EVERY} to {TOUCHES} of them count."
        )
        touches, telling = self.touches, [0, 0]  # frames that tell something, each time
        most = max(TOUCHES, len(touches) + 2 * _EVERY)
        for _ in self.presses():
            if len(touches) % _EVERY:
                self.say(f"  touch {len(touches)}")
                continue
            self.found = identify(touches, self.supposed, self.rest, adc=self._adc)
            if not any(self.found.told.values()):
                self._check_readout(touches)
            self.say(f"  touch {len(touches)}")
            telling.append(self.found.frames)
            enough = not self.found.missing or telling[-1] <= telling[-3]  # more tell no more
            if (enough and len(touches) >= 2 * _EVERY) or len(touches) >= most:
                break
        if len(touches) % _EVERY:
            self.found = identify(touches, self.supposed, self.rest, adc=self._adc)
        if self.found:
            self.say(": ".join(filter(None, ("  " + self.found.message, self.found.advice))))
        if self.found and (alike := reads_alike(self.supposed, self.found)):
            self.say(f"  {alike}")
        self._check_readout(touches)
        if not touches:
            self.say("  no touch was felt: what lies in series stays as it is configured.")
        elif self.found and self.found.missing:
            self.say("  What the touches do not tell stays as it is configured.")

    def presses(self) -> Iterator[None]:
        """Add one touch after the other, and say why one does not count, as long as they come."""
        waited, said, counted = 0.0, "", False  # s; of the press that is on: what was said of it
        why: list[str] = []  # it does not count, by each glance since it began or was counted
        while waited < PATIENCE:
            touch, reason = self._new_touch()
            if touch is not None:
                self.touches.append(touch)
                waited, said, counted, why = 0.0, "", True, []
                yield
                continue
            waited += _GLANCE
            why += [reason] if reason else []
            kind = why[-1].partition(",")[0] if why else ""
            light = kind == _LIGHT  # as are, for a glance, noise and what a press leaves behind
            enough = len(why) >= (_PERSISTS if reason else 1 + light)
            if why and enough and kind != said and not (counted and (light or not reason)):
                self.say(f"  does not count: {why[-1]}")
                said = kind
            if not reason:  # it has ended
                said, counted, why = "", False, []
        self.say(f"  no new touch for {PATIENCE:.0f} s")

    def _check_readout(self, touches: list[np.ndarray]) -> None:
        if words := check_readout(self.circuit, self.at_rest, self.straight(touches)):
            self.unfit = "the touches do not fit the circuit"
            self.say(f"  {words}")

    def _new_touch(self) -> tuple[np.ndarray | None, str]:
        """Return the mean frame of a new touch that stands, or None and why there is none."""
        frames = self.rest.quiet(self.frames(_GLANCE))
        if len(frames) < 2:
            return None, ""
        frame, last = mean_of(frames), self.touches[-1] if self.touches else None
        steps = float(np.nanmax(frame - self.rest.adc)) * self.supposed.full_scale
        least = MOVED * self._noise * self.supposed.full_scale
        if steps <= 0.5 * least:
            return None, ""
        if steps <= least:
            return None, f"{_LIGHT}, {steps:.1f} of {least:.1f} ADC steps: press harder"
        stands = stands_anew(frames[-1], frames[0], None, self._noise)
        if not stands and self.moved(frames) > MOST_MOVED:  # what creeps stands
            return None, "it moves: hold it still"
        if not stands_anew(frame, frame, last, self._noise):
            return None, "it is counted already: press somewhere else"
        return frame, ""

    def touched(self, frame: np.ndarray) -> bool:
        return bool(np.nanmax(frame - self.rest.adc) > MOVED * self._noise)

    def load(self, frames: np.ndarray) -> float:
        """Return by how much (n, rows, cols) frames exceed rest where most lies; 0: none stands."""
        frames = self.rest.quiet(frames)
        mean = mean_of(frames)
        stands = self.touched(mean) and self.moved(frames) <= MOST_MOVED
        return float(np.nanmax(mean - self.rest.adc)) if stands else 0.0

    def moved(self, frames: np.ndarray) -> float:
        """Share of a load's readings by which its first and its last frames differ, noise aside."""
        third = max(1, len(frames) // 3)
        change = np.abs(mean_of(frames[-third:]) - mean_of(frames[:third]))
        load = np.abs(mean_of(frames) - self.rest.adc)
        seen = np.maximum(change - 4.0 * self._noise, 0.0)
        return float(np.nansum(seen) / np.nansum(load))

    @property
    def _noise(self) -> float:
        """Of a reading, as ADC ratio."""
        return max(self.rest.noise, 0.5) / self.supposed.full_scale

    def fit_curve(self) -> bool:
        """Find the curve by things of known weight; False: a step back is asked for."""
        self.say(
            f"3 of 3. Lay things of known weight on the skin, at least {LEAST_OBJECTS}, better "
            f"{OBJECTS}: light\n  and heavy ones, 0.3 to 5 kg (a bottle, books), each somewhere "
            "else, on a piece\n  of foam if they are hard. They must not stand beside the skin."
        )
        frames: list[np.ndarray] = []
        weights: list[float] = []
        while True:
            number = len(weights) + 1
            word = self.ask(
                f"  object {number}: its weight once it lies (500 g or 5 N; b: back, Enter: end) "
            )
            if not word.strip() and len(weights) < LEAST_OBJECTS:
                word = self.ask(
                    f"  {len(weights)} of at least {LEAST_OBJECTS} objects: no curve is found. "
                    "Enter: end all the same; or its weight: "
                )
            if not word.strip():
                break
            if word.strip() in BACK:
                if not weights:
                    return False
                frames, weights = frames[:-1], weights[:-1]
                continue
            weight = newtons(word)
            if weight is None:
                self.say(f"  {word.strip()!r} is no weight and unit: write 500 g, 1.2 kg or 5 N")
                continue
            if (frame := self.weighed(word.strip())) is None:
                continue
            frames.append(frame)
            weights.append(weight)
            if len(weights) < LEAST_OBJECTS:
                continue
            if len(weights) == LEAST_OBJECTS:
                self._check_readout(frames)
            if len(weights) % _EVERY == 0:
                self._learn_by(frames)
            self._fit(frames, weights)
            if self.fitted and len(weights) >= 6 and self.fitted.error < ENOUGH:
                self.say("  That is enough. Enter alone ends; more objects make it better.")
        if len(weights) >= LEAST_OBJECTS and len(weights) % _EVERY and self._learn_by(frames):
            self._fit(frames, weights)
        if self.fitted and self.fitted.error > _USELESS:
            self.say(
                f"  A total would be off by more than {_USELESS:.0%}: this curve is not kept. A "
                "wrong weight may do that, or another readout or r_ref than the configured one: "
                "check these, and begin anew."
            )
            self.fitted = None
        elif self.fitted:
            used = np.delete(weights, self.fitted.odd)
            self.prove(frames, used, lambda *by: self._by_weights(frames, weights, *by))
        elif len(weights) < LEAST_OBJECTS:
            self.say(f"  {len(weights)} objects: the curve stays that of the configuration.")
        return True

    def weighed(self, word: str) -> np.ndarray | None:
        """Return the mean frame of what lies on the skin; None: nothing stands, which is said."""
        self._count_down(_COUNTED)
        stood = self.rest.quiet(self.frames(OBJECT))
        if not self.touched(mean_of(stood)):
            self.say("  nothing lies on the skin: the readings are those of rest")
            return None
        if (moved := self.moved(stood)) > MOST_MOVED:
            self.say(
                f"  {word} is not used: the readings changed by {moved:.0%} while it was measured, "
                f"{MOST_MOVED:.0%} at most is a load that stands for {OBJECT:g} s"
            )
            return None
        return mean_of(stood)

    def prove(self, frames, loads, refit: proving.Refit) -> None:
        """Say whether loads prove the fitted curve; arguments as of `proving.by_weights`."""
        assert self.fitted is not None
        given = self.straight(frames), loads, [*self.straight(self.touches)]
        by = self.circuit, self.at_rest, *given, self.pitch
        error, why = proving.by_weights(self.fitted, refit, *by)
        self.conclude(error, self.unfit or why, loads)

    def conclude(self, error: float, why: str, loads) -> None:
        """Say, and keep, that loads (n,) [N] prove forces, or why they do not."""
        self.proof, words = concluded(error, why, loads, self._today())
        self.say(words)

    def _learn_by(self, frames: list[np.ndarray]) -> bool:
        """Ask the objects, too, where the touches do not tell r_par; whether they were asked."""
        if self.found is None or self.found.told["r_par"]:
            return False
        self.found = identify([*self.touches, *frames], self.supposed, self.rest, adc=self._adc)
        if self.found.told["r_par"]:
            self.say(f"  With the objects: {self.found.message}")
        return True

    def _by_weights(self, frames, weights, circuit: Circuit, rest: Rest) -> FittedCurve:
        return fit_curve(self.straight(frames), weights, circuit, rest, ends=self.adc.range)

    def _fit(self, frames: list[np.ndarray], weights: list[float]) -> None:
        rest = supposing(self.at_rest, self.circuit)
        try:
            fitted = self._by_weights(frames, weights, self.circuit, rest)
        except ValueError as error:
            self.say(f"  {error}")
            return
        self.fitted = fitted
        self.say(f"  {fitted.message}")
        cells = self.circuit.populated
        usual = float(np.median(rest.conductance[cells]))  # S
        at_rest = 1.0 / np.where(cells, rest.conductance, usual)
        curve = fitted.curve.resting_at(at_rest)
        found = compensate(self.straight(frames[-1]), self.circuit, curve, "map", missing=True)
        self._show(found.force)
        self.say(f"  felt: {found.force.sum():.1f} N of {weights[-1]:.1f} N")


def mean_of(frames: np.ndarray) -> np.ndarray:
    """(rows, cols) mean of (n, rows, cols); NaN where no frame read a crossing."""
    known = np.isfinite(frames)
    with np.errstate(invalid="ignore"):
        return np.where(known, frames, 0.0).sum(0) / known.sum(0)
