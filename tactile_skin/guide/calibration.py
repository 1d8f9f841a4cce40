# SPDX-License-Identifier: Apache-2.0
"""What a person does to calibrate a board, step by step (docs/calibrate.md).

Hands off, press here and there, lay known weights on. Each step says when it has enough, why
something does not count, and waits for a key; "b" leads a step back.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from ..calibration.creep import creep_of_presses, measure_creep
from ..calibration.curve_fit import FittedCurve, fit_curve
from ..calibration.identify import Identified, identify
from ..calibration.rest import Rest, measure_rest, supposing
from ..calibration.touched import MOVED, stands_anew
from ..health.doctor import ignored_diode, other_readout
from ..health.doctor.advice import HARDEST
from ..physics.circuit import Circuit
from ..physics.creep import Creep
from ..physics.curve import GRAM, PressureCurve
from ..solvers import compensate

REST = 3.0  # s that the skin rests
OBJECT = 1.0  # s for which an object stands
PRESSES = 60.0  # s in which five things are laid on and taken off for it
STANDS = 120.0  # s for which it stands to tell how much it gains
_LOOK = 0.25  # s of which each frame of it is the mean
_TELL = 10.0  # s after which a word is said
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
_PERSISTS = 4  # glances in a row for which a press does not count before it is said why
_PATIENCE = 20.0  # s without a new touch after which it asks whether to go on
_COUNTED = 3  # s that are counted down before a measurement, in which hands leave the skin
_BACK, _MORE = ("b", "back"), ("m", "more")
_WEIGHT = re.compile(r"\s*([0-9]*[.,]?[0-9]+)\s*(g|kg|N)\s*$")
_UNIT = {"g": GRAM, "kg": 1000.0 * GRAM, "N": 1.0}

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
    ):
        """Prepare the guided steps.

        Args:
            circuit: as it is configured.
            count_down: before a measurement; recorded frames need none.
            show: takes the force (rows, cols) [N] of what was weighed last.
        """
        self._supposed, self._frames, self._ask, self._say = circuit, frames, ask, say
        self._count_down, self._show = count_down, show
        self._touches: list[np.ndarray] = []
        self.rest: Rest  # the untouched skin, once it is measured
        self.found: Identified | None = None  # as fitted and creep: what was learnt, None before
        self.unfit = ""  # what is doubted, where another circuit fits the touches as well
        self.fitted: FittedCurve | None = None
        self.creep: Creep | None = None

    @property
    def circuit(self) -> Circuit:
        """What the configuration says, then what the touches tell."""
        return self.found.circuit if self.found else self._supposed

    def run(self) -> None:
        steps, step = (self.measure_rest, self._press, self.fit_curve, self.find_creep), 0
        while step < len(steps):
            step += 1 if steps[step]() else -1

    def _press(self) -> bool:
        """Lead through the touches; whether to go on, or a step back."""
        self._touches, self.found, word = [], None, _MORE[0]
        while word in _MORE:
            self.identify()
            word = self._ask("  Enter: on to the weights; m: more touches; b: back to the rest: ")
            word = word.strip()
        return word not in _BACK

    @property
    def learnt(self) -> list[str]:
        """What the configuration did not say."""
        names = [name for name, told in self.found.told.items() if told] if self.found else []
        return names + ["curve"] * bool(self.fitted) + ["creep"] * bool(self.creep)

    def find_creep(self) -> bool:
        """Find creep by five presses, if somebody wants to; False: a step back is asked for."""
        word = self._ask(
            "Creep, if you like: within a minute lay one of the things on five times: down in a "
            "second, five\n  seconds there, off. p: begin; b: back; Enter: end without it: "
        )
        if word.strip() != "p" or not self.fitted:
            return word.strip() not in _BACK
        frames = self._frames(PRESSES)
        times = np.arange(len(frames)) * PRESSES / max(len(frames), 1)
        rest = supposing(self.rest, self.circuit)
        try:
            self.creep = creep_of_presses(frames, times, self.circuit, rest, self.fitted.curve)
        except ValueError as error:
            self._say(f"  {error}")
            return True
        self._say(
            f"  A load gains {self.creep.share:.0%} +- {self.creep.std:.0%} in a decade of time."
        )
        return True

    def measure_creep(self, curve: PressureCurve) -> None:
        """Two steps of their own, for a skin whose curve is known."""
        self.measure_rest(of=2)
        self._ask(
            "2 of 2. Take a thing of 1 kg or more, and a piece of foam if it is hard. Enter, and "
            f"lay it on the\n  skin at once; leave it there for {STANDS / 60:.0f} minutes: "
        )
        frames: list[np.ndarray] = []
        stood = 0.0  # s
        while stood <= STANDS:
            frames.append(_mean(self._frames(_LOOK)))
            if stood or self._touched(frames[-1]):
                stood += _LOOK
                if stood % _TELL == 0.0:
                    self._say(f"  {stood:.0f} s of {STANDS:.0f} s")
            elif len(frames) * _LOOK > _PATIENCE:
                raise ValueError(f"nothing was laid on the skin for {_PATIENCE:.0f} s")
        times = _LOOK * (np.arange(len(frames)) + 0.5)
        creep = measure_creep(np.array(frames), times, self._supposed, self.rest, curve)
        self.creep = creep
        self._say(
            f"  A standing load gains {creep.share:.1%} +- {creep.std:.1%} in a decade "
            f"of time: {creep.gain(600.0) - 1.0:.0%} in ten minutes."
        )

    def measure_rest(self, of: int = 3) -> bool:
        """Measure the untouched skin; True: go on."""
        self._ask(f"1 of {of}. Take everything off the skin, and keep your hands off it. Enter: ")
        for left in reversed(range(_TRIES)):
            self._count_down(_COUNTED)
            frames = self._frames(REST)
            while len(frames) < _FEW:
                frames = np.concatenate([frames, self._frames(REST)])
            try:
                self.rest = measure_rest(frames, self._supposed)
                break
            except ValueError as error:
                if not left:
                    raise ValueError(
                        f"no rest in {_TRIES} tries: {error} If nothing does, `tactile-skin "
                        "doctor` names the line or cells to check"
                    ) from error
                self._ask(f"  {error}\n  Hands off, and Enter to measure again: ")
        usual = 1.0 / np.median(self.rest.conductance[self._supposed.populated])
        self._say(
            f"  {len(frames)} frames: a cell has {usual:.0f} ohm at rest, a reading "
            f"{self.rest.noise:.2f} ADC steps of noise."
        )
        for row, col in self.rest.noisy:
            self._say(
                f"  row {row}, column {col} is noisy: its readings are left out here. Check its "
                "contact."
            )
        return True

    def identify(self) -> None:
        """Find what lies in series, by touches beside those that there are."""
        self._say(
            "2 of 3. Press here and there, near the edges too: hard, with a knuckle, a\n  palm, "
            f"both hands. Hold each touch for a moment. {2 * _EVERY} to {TOUCHES} of them count."
        )
        touches = self._touches
        most = max(TOUCHES, len(touches) + 2 * _EVERY)
        waited, why, times, said = 0.0, "", 0, ""  # s; why a press does not count, how often, said
        while len(touches) < most and waited < _PATIENCE:
            touch, reason = self._new_touch()
            if touch is None:
                waited += _GLANCE
                why, times = reason, times + 1 if reason == why else 1
                if why and times >= _PERSISTS and said != why:
                    self._say(f"  does not count: {why}")
                    said = why
                continue
            touches.append(touch)
            waited, said = 0.0, ""
            if len(touches) % _EVERY:
                self._say(f"  touch {len(touches)}")
                continue
            self.found = identify(touches, self._supposed, self.rest)
            if not any(self.found.told.values()):
                self._check_readout(touches)
            self._say(f"  touch {len(touches)}: {self.found.message}")
            if len(touches) >= 2 * _EVERY and not self.found.missing:
                break
        if waited >= _PATIENCE:
            self._say(f"  no new touch for {_PATIENCE:.0f} s")
        if len(touches) % _EVERY:
            self.found = identify(touches, self._supposed, self.rest)
            self._say(f"  {self.found.message}")
        self._check_readout(touches)
        if diode := ignored_diode(self.circuit, self.rest, np.array(touches)):
            self._say(f"  {diode} Until then this calibration is wrong.")
        if not touches:
            self._say("  no touch was felt: what lies in series stays as it is configured.")
        elif self.found and self.found.missing:
            self._say("  What the touches do not tell stays as it is configured.")

    def _check_readout(self, touches: list[np.ndarray]) -> None:
        """ValueError: they are those of another readout than the configured one.

        Where something else explains them as well it is only said.
        """
        hardest = sorted(touches, key=lambda touch: -np.nanmax(touch))[:HARDEST]
        at_rest = self.rest.quiet(self.rest.adc[None])[0]
        found = other_readout(self.circuit, at_rest, self.rest.noise, np.array(hardest))
        if found and found.change:
            raise ValueError(str(found))
        if found:
            self.unfit = "the touches do not fit the circuit"
            self._say(f"  {found}")

    def _new_touch(self) -> tuple[np.ndarray | None, str]:
        """Return the mean frame of a new touch that stands, or None and why there is none."""
        frames = self.rest.quiet(self._frames(_GLANCE))
        if len(frames) < 2:
            return None, ""
        frame, last = _mean(frames), self._touches[-1] if self._touches else None
        steps = float(np.nanmax(frame - self.rest.adc)) * self._supposed.full_scale
        least = MOVED * self._noise * self._supposed.full_scale
        if steps <= 0.5 * least:
            return None, ""
        if steps <= least:
            return None, f"too light, {steps:.1f} of {least:.1f} ADC steps: press harder"
        if not stands_anew(frames[-1], frames[0], None, self._noise):
            return None, "it moves: hold it still"
        if not stands_anew(frames[-1], frames[0], last, self._noise):
            return None, "it is counted already: press somewhere else"
        return frame, ""

    def _touched(self, frame: np.ndarray) -> bool:
        return bool(np.nanmax(frame - self.rest.adc) > MOVED * self._noise)

    def load(self, frames: np.ndarray) -> float:
        """Return by how much (n, rows, cols) frames exceed rest where most lies; 0: none stands."""
        frames = self.rest.quiet(frames)
        mean = _mean(frames)
        stands = self._touched(mean) and self.moved(frames) <= MOST_MOVED
        return float(np.nanmax(mean - self.rest.adc)) if stands else 0.0

    def moved(self, frames: np.ndarray) -> float:
        """Share of a load's readings by which its first and its last frames differ, noise aside."""
        third = max(1, len(frames) // 3)
        change = np.abs(_mean(frames[-third:]) - _mean(frames[:third]))
        load = np.abs(_mean(frames) - self.rest.adc)
        seen = np.maximum(change - 4.0 * self._noise, 0.0)
        return float(np.nansum(seen) / np.nansum(load))

    @property
    def _noise(self) -> float:
        """Of a reading, as ADC ratio."""
        return max(self.rest.noise, 0.5) / self._supposed.full_scale

    def fit_curve(self) -> bool:
        """Find the curve by things of known weight; False: a step back is asked for."""
        self._say(
            f"3 of 3. Lay things of known weight on the skin, at least {LEAST_OBJECTS}, better "
            f"{OBJECTS}: light\n  and heavy ones, 0.3 to 5 kg (a bottle, books), each somewhere "
            "else, on a piece\n  of foam if they are hard. They must not stand beside the skin."
        )
        frames: list[np.ndarray] = []
        weights: list[float] = []
        while True:
            number = len(weights) + 1
            word = self._ask(
                f"  object {number}: its weight once it lies (500 g or 5 N; b: back, Enter: end) "
            )
            if not word.strip():
                break
            if word.strip() in _BACK:
                if not weights:
                    return False
                frames, weights = frames[:-1], weights[:-1]
                continue
            weight = newtons(word)
            if weight is None:
                self._say(f"  {word.strip()!r} is no weight and unit: write 500 g, 1.2 kg or 5 N")
                continue
            self._count_down(_COUNTED)
            stood = self.rest.quiet(self._frames(OBJECT))
            frame = _mean(stood)
            if not self._touched(frame):
                self._say("  nothing lies on the skin: the readings are those of rest")
                continue
            if (moved := self.moved(stood)) > MOST_MOVED:
                self._say(
                    f"  {word.strip()} is not used: the readings changed by {moved:.0%} while "
                    f"it was measured, {MOST_MOVED:.0%} at most is a load that stands for "
                    f"{OBJECT:g} s"
                )
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
                self._say("  That is enough. Enter alone ends; more objects make it better.")
        if len(weights) >= LEAST_OBJECTS and len(weights) % _EVERY and self._learn_by(frames):
            self._fit(frames, weights)
        if self.fitted and self._series_open:
            self._say(
                "  Nothing tells r_par: the curve makes up for it, and is right with this one."
            )
        if self.fitted and self.fitted.error > _USELESS:
            self._say(
                f"  A total would be off by more than {_USELESS:.0%}: this curve is not kept. A "
                "wrong weight may do that, or another readout or r_ref than the configured one: "
                "check these, and begin anew."
            )
            self.fitted = None
        elif len(weights) < LEAST_OBJECTS:
            self._say(
                f"  {len(weights)} objects: the curve stays that of the configuration; forces are "
                "as good as it is."
            )
        return True

    @property
    def _series_open(self) -> bool:
        return self.found is not None and not self.found.told["r_par"]

    def _learn_by(self, frames: list[np.ndarray]) -> bool:
        """Whether objects tell r_par, with the touches, where these did not."""
        if not self._series_open:
            return False
        found = identify([*self._touches, *frames], self._supposed, self.rest)
        if found.told["r_par"]:
            self.found = found
            self._say(f"  With the objects: {found.message}")
        return found.told["r_par"]

    def _fit(self, frames: list[np.ndarray], weights: list[float]) -> None:
        rest = supposing(self.rest, self.circuit)
        try:
            fitted = fit_curve(np.array(frames), np.array(weights), self.circuit, rest)
        except ValueError as error:
            self._say(f"  {error}")
            return
        self.fitted = fitted
        self._say(f"  {fitted.message}")
        cells = self.circuit.populated
        usual = float(np.median(rest.conductance[cells]))  # S
        at_rest = 1.0 / np.where(cells, rest.conductance, usual)
        curve = fitted.curve.resting_at(at_rest)
        found = compensate(frames[-1], self.circuit, curve, "map", missing=True)
        self._show(found.force)
        self._say(f"  felt: {found.force.sum():.1f} N of {weights[-1]:.1f} N")


def newtons(text: str) -> float | None:
    """ "500 g", "1,2 kg", "5 N" -> N; None: it is no weight above 0, or has no unit."""
    match = _WEIGHT.match(text)
    if not match:
        return None
    value = float(match[1].replace(",", ".")) * _UNIT[match[2]]
    return value if value > 0.0 else None


def _mean(frames: np.ndarray) -> np.ndarray:
    """(rows, cols) mean of (n, rows, cols); NaN where no frame read a crossing."""
    known = np.isfinite(frames)
    with np.errstate(invalid="ignore"):
        return np.where(known, frames, 0.0).sum(0) / known.sum(0)
