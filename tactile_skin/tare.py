"""What each cell conducts while nothing touches, followed as the fabric ages, creeps and warms.

A fabric's cells differ at rest, and drift. `PressureCurve.resting_at` tells that to the solvers;
here it is measured, in the pauses between touches. A standing touch is never tared away: nothing
is learnt while one is felt, nor shortly after, and never more than `LEAST` presses on a cell,
whatever was read. A line that falls is no fabric's doing, and is not followed.
"""

from __future__ import annotations

import numpy as np

from .circuit import Circuit
from .curve import GRAM, PressureCurve
from .solvers import compensate
from .solvers.reading import SCAN_NOISE, rest_reading

LEAST = 2.0 * GRAM  # N on a cell; what conducts more is a touch, and stays one
_MOST = 4.0  # times the curve's resistance at rest; a cell that conducts less is broken
_TOUCH = 10.0 * GRAM  # N on a cell, felt: a touch
_WINDOW = 1.0  # s that a measurement takes
_FRAMES = 40  # frames that it takes at least
_PAUSE = 1.0  # s after a touch: the fabric recovers
_WAIT = 0.1  # s that must follow a measurement without a touch: its onset is too weak to be felt
_SHARE = 0.5  # of a later measurement that is taken over
_NEWS = 4.0  # times its noise by which a measurement differs from what is known
_COMMON = 0.004  # by which all cells together may rest off the curve, at first
_LINE = 0.2  # by which a whole line may rest off the others
_JUMP = 0.1  # by which all cells together may change between two measurements, and
_DRIFT = 0.02 / 60.0  # 1/s, by which they may besides: as a robot's cover warms up
_FALL = 0.05  # by which a whole line may conduct less than at the first measurement


class Tare:
    """Follows the rest of one skin.

    Attributes:
        curve: the given curve, with the cells' offsets once they are known.
        message: why the last measurement could not be used; empty if it could.
    """

    def __init__(self, circuit: Circuit, curve: PressureCurve):
        self.curve, self.message = curve, ""
        self._learned = -np.inf  # s, when the rest was measured last
        self._first: np.ndarray | None = None  # (rows, cols) [S] that was measured first
        self._circuit = circuit
        # Between its ends newton finds whatever a skin at rest may be; its forces mean nothing.
        ends = _MOST * curve.points[0][1], float(curve.resistance(LEAST))
        self._range = PressureCurve((0.0, 1.0), ends)
        self._last = -np.inf  # s, when the last frame was read
        self._begin(-np.inf)

    def _begin(self, after: float) -> None:
        self._after, self._since, self._until = after, np.inf, np.inf
        self._sum, self._frames = np.zeros(self._circuit.shape), 0

    def update(self, t: float, adc: np.ndarray, force: np.ndarray) -> bool:
        """Take a frame.

        Args:
            t: when it was read [s]. On ROS that is the time of day: set back, it begins anew.
            adc: (rows, cols) ADC ratio.
            force: (rows, cols) that was found in it [N].

        Returns:
            whether `curve` changed.
        """
        if t < self._last:
            self._learned = -np.inf  # how long ago cannot be told, nor whether a pause is over
        if force.max() > _TOUCH or t < self._last:
            self._begin(t + _PAUSE)
        self._last = t
        if t < self._after:
            return False
        self._since = min(self._since, t)
        if self._until == np.inf:
            self._sum += adc
            self._frames += 1
            if t - self._since >= _WINDOW and self._frames >= _FRAMES:
                self._until = t
        if t - self._until < _WAIT:
            return False
        mean, frames = self._sum / self._frames, self._frames
        self._begin(t)
        return self._learn(mean, SCAN_NOISE / frames**0.5)

    def _learn(self, adc: np.ndarray, noise: float) -> bool:
        """Args:
        noise: of the mean reading, in ADC steps.
        """
        off = (adc - rest_reading(self._circuit, self.curve)) * self._circuit.full_scale
        if np.square(off).mean() < (_NEWS * noise) ** 2:
            self.message = ""
            return False
        found = compensate(adc, self._circuit, self._range, "newton", noise=0.0)
        cells = self._circuit.populated
        beyond = cells & ((found.force <= 1e-6) | (found.force >= 1.0 - 1e-6))
        if found.status == "failed" or beyond.any():
            where = "row {}, column {}".format(*np.argwhere(beyond)[0]) if beyond.any() else "?"
            self.message = f"no tare: more than fabric at rest, the first at {where}"
            return False
        now = 1.0 / self._range.resistance(found.force)  # S
        self.message = self._wires(np.log(now * self.curve.points[0][1]), cells)
        if self.message:
            return False
        if self._first is None:
            self._first = now
        else:
            before = 1.0 / self.curve.rest_resistance
            self.message = self._leads(np.log(now / self._first), cells)
            self.message = self.message or self._jump(np.log(now / before)[cells])
            if self.message:
                return False
            now = before + _SHARE * (now - before)
        self._learned = self._last
        rest = np.where(cells, 1.0 / now, self.curve.points[0][1])
        self.curve = self.curve.resting_at(rest)
        return True

    def _wires(self, off: np.ndarray, cells: np.ndarray) -> str:
        """What is no fabric's doing, and would be hidden by a tare; empty if nothing.

        Cells scatter; all of them, or all of a line, are off because of the circuit. A fabric warms
        as a whole, but not before the first measurement.

        Args:
            off: (rows, cols) log of each cell's conductance over the curve's, at rest.
        """
        common, spread = _middle(off[cells])
        for name, lines, _ in _lines(off, cells, common):
            worst = np.abs(lines - common).argmax()
            if abs(lines[worst] - common) > _LINE:
                return f"{name} {worst} conducts {np.expm1(lines[worst] - common):+.0%} at rest"
        if (
            self.curve.offset is None
            and abs(common) > _COMMON + 4.0 * spread / np.count_nonzero(cells) ** 0.5
        ):
            much = f"{np.expm1(common):+.1%}"
            return f"all cells conduct {much} at rest: is r_par, r_ref or the curve's start wrong?"
        return ""

    def _jump(self, change: np.ndarray) -> str:
        """A fabric warms and ages as a whole, but slowly.

        Args:
            change: (cells,) log of each one's conductance over that known.
        """
        common = np.median(change)
        if abs(common) <= _JUMP + _DRIFT * (self._last - self._learned):
            return ""
        much = f"{np.expm1(common):+.0%}"
        return f"all cells conduct {much} at once: has the supply or the reference changed?"

    def _leads(self, change: np.ndarray, cells: np.ndarray) -> str:
        """A lead that breaks puts a resistance before its whole line, which hides most of a push.

        Fabric changes cell by cell, or as a whole. A line must have fallen both by itself and
        against the others: where a palm lay, cells conduct more for a while.

        Args:
            change: (rows, cols) log of each cell's conductance over that measured first.
        """
        common, spread = _middle(change[cells])
        for name, lines, count in _lines(change, cells, common):
            fall = np.maximum(lines, lines - common)
            worst = fall.argmin()
            if fall[worst] < -_FALL - 4.0 * spread / count[worst] ** 0.5:
                much = f"{np.expm1(fall[worst]):+.0%}"
                return f"{name} {worst} conducts {much} since the start: is its lead breaking?"
        return ""


def _middle(values: np.ndarray) -> tuple[float, float]:
    """Median of (n,) values, and how far they scatter: 1.5 times the median of the deviations."""
    middle = np.median(values)
    return middle, 1.5 * np.median(np.abs(values - middle))


def _lines(values: np.ndarray, cells: np.ndarray, empty: float):
    """(name, medians, numbers of cells) of all rows, then of all columns."""
    for name, axis in (("row", 1), ("column", 0)):
        median = np.ma.median(np.ma.array(values, mask=~cells), axis=axis)
        yield name, median.filled(empty), np.maximum(cells.sum(axis), 1)
