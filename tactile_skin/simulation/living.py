# SPDX-License-Identifier: Apache-2.0
"""How a fabric differs from one press, and one day, to the next: more than any solver knows.

Sizes are those of public recordings of Velostat, FSRs and foam (docs/calibrate.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .matrix import Fabric

_TURN = 1.5  # s after which Velostat under a robot creeps less than before
_RETURNS = 2.0  # s in which its rest comes back after a release: all of it in 5 s
_MERGED = 0.02  # of a load, below which a change of it is no step of its own
_LIGHTEST = 0.01  # N on a cell, below which it is released


@dataclass(frozen=True)
class Habits:
    """What a fabric does in time; the defaults are nothing."""

    creep: float = 0.0  # share of what a load adds that it gains in a decade of time, at first
    late: float = 1.0  # times which it creeps after 1.5 s
    time: float = 0.03  # s after which it begins
    scatter: float = 0.0  # relative RMS of the share, from cell to cell
    undershoot: float = 0.0  # share by which a cell rests below its rest after a release
    hysteresis: float = 0.0  # share by which an unloaded cell conducts more at an equal force
    drift: float = 0.0  # RMS of the logarithm of the gain, from day to day
    place: float = 1.0  # factor by which the place within a cell counts, at most, either way

    @classmethod
    def real(cls, rng) -> Habits:
        """Draw those of a real fabric."""
        return cls(
            creep=float(np.exp(rng.uniform(*np.log((0.03, 0.4))))),
            late=0.12 / 0.28,
            scatter=0.2,
            undershoot=rng.uniform(0.25, 0.4),
            hysteresis=rng.uniform(0.0, 0.13),
            drift=0.3,
            place=1.5,
        )


class Living:
    """The cells of one mat, by all that has happened to them."""

    def __init__(self, habits: Habits, shape: tuple[int, int], rng):
        self._habits, self._rng = habits, rng
        self._share = habits.creep * np.exp(habits.scatter * rng.standard_normal(shape))
        self._steps: list[tuple[float, np.ndarray]] = []  # s, and force that came then [N]
        self._peak, self._last = np.zeros((2, *shape))  # N, of this touch and of the last frame
        self._released = np.full(shape, -np.inf)  # s
        self._place = np.ones(shape)
        self.gain = 1.0  # of this day
        self.next_day()

    def next_day(self) -> None:
        """Draw another gain of all cells."""
        self.gain = float(np.exp(self._habits.drift * self._rng.standard_normal()))

    def factor(self, t: float, force: np.ndarray, fabric: Fabric) -> np.ndarray:
        """Return times which cells conduct otherwise than `fabric` says, under (rows, cols) [N].

        Args:
            t: now [s], rising.
        """
        kept = np.clip(force / np.maximum(self._last, _LIGHTEST), 0.0, 1.0)
        came = np.maximum(force - self._last, 0.0)
        fresh = (self._last <= _LIGHTEST) & (force > _LIGHTEST)
        gone = (self._last > _LIGHTEST) & (force <= _LIGHTEST)
        self._released[gone] = t
        most = np.log(self._habits.place)
        self._place[fresh] = np.exp(self._rng.uniform(-most, most, np.count_nonzero(fresh)))
        self._peak = np.where(force > _LIGHTEST, np.maximum(self._peak, force), 0.0)
        self._steps = [(at, step * kept) for at, step in self._steps if (step * kept).any()]
        if came.max() > _MERGED * force.max() or not self._steps:
            self._steps.append((t, came))
        else:
            self._steps[-1] = self._steps[-1][0], self._steps[-1][1] + came
        self._last = force.copy()
        gained = sum(step * self._law(t - at) for at, step in self._steps)
        creep = 1.0 + self._share * gained / np.maximum(force, _LIGHTEST)
        back = 1.0 - force / np.maximum(self._peak, _LIGHTEST)
        hysteresis = 1.0 + self._habits.hysteresis * back * (force > _LIGHTEST)
        fading = np.exp(-(t - self._released) / _RETURNS) * (force <= _LIGHTEST)
        plain = fabric.conductance(force[None])[0]
        loads = np.maximum(plain - fabric.rest, 0.0) * creep * hysteresis * self._place * self.gain
        rest = fabric.rest * (1.0 - self._habits.undershoot * fading)
        return np.divide(rest + loads, plain, out=np.ones_like(plain), where=plain > 0.0)

    def _law(self, stood: float) -> float:
        """Decades of creep after a time [s], those after the turn by what they count."""
        time = self._habits.time
        early = np.log10(1.0 + min(stood, _TURN) / time)
        return float(early + self._habits.late * np.log10(max(stood, _TURN) / _TURN))
