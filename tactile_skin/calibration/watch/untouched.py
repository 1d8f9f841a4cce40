"""What an untouched skin reads, beside what it read when its rest was measured.

Its cells differ, so that the readings at rest are a picture that is known. Fabric changes cell by
cell, and as a whole slowly. Two changes are none of its own: all cells at once, as of a supply, a
reference or a series resistance; and a line that reads as another one did, cell for cell, as of a
multiplexer or leads that were exchanged.
"""

from __future__ import annotations

import numpy as np

from ...physics import readouts
from ...physics.circuit import Circuit
from ..rest import resting_conductance

# Frames whose mean is looked at, at least, and time that they take [s]: a board's low-pass leaves
# alike what follows within less, and a look may take as long as some frames.
_FRAMES, _TAKE = 20, 0.18
# Log conductance by which all cells change at once, and besides for each second since rest was seen
# last: what the tare follows of a drift. Time for which that adds up [s].
_AT_ONCE, _A_SECOND, _UNSEEN = 0.004, 0.003, 5.0
# Of the cells may have changed by less than half of that: those that still recover from a touch;
# standard deviations that a normal distribution's quartile lies off.
_SHARE, _QUARTILE = 0.25, 0.674
# Log conductance lost from which on a push may be hidden: it stops, if all cells have lost as much,
# but for this share.
_FALL, _EVEN = 0.05, 0.1
_KEPT = 60.0  # s: by then touches have told another r_par, and a drift has been followed
_CELLS = 4  # of a line, at least, by which lines are compared
# Sum of squares, in standard deviations of noise, by which it differs from its own line, without
# this share of its cells: those that a touch has left behind. Standard deviations of chi^2 up to
# which it is the other line, and up to which no third one may be: on even fabric lines are alike,
# and one that something lay on at the tare reads as all others once that is gone.
_OWN, _LEFT_BEHIND = 40.0, 0.25
_OTHER, _ALIKE = 4.0, 10.0
# ADC steps that a mean may be off at least: the rest is measured anew only from such a difference
# on (tare.py); and where a reading has less noise than averages its rounding away.
_LEAST, _ROUNDED, _DITHER = 0.1, 0.3, 0.4


class Untouched:
    """Follows the picture of one skin at rest; all times are of one clock [s].

    Attributes:
        message: what is wrong; empty if nothing is.
        fault: whether readings tell too little of what presses: a stop.
    """

    def __init__(self, circuit: Circuit):
        self._circuit = circuit
        self._looked = -np.inf  # s
        self._asked = self._conductance = None  # (rows, cols) rest, and what its cells conduct [S]
        self._before: np.ndarray | None = None  # what the last look saw
        self.forget()

    def forget(self) -> None:
        """What is read now is right: somebody has checked the skin, or it is explained."""
        self.message, self.fault = "", False
        self._line = ""  # that reads as another one; of `message`
        self._rest: np.ndarray | None = None  # before what `message` says
        self._told_at = -np.inf  # s
        self._begin()

    def _begin(self) -> None:
        self._sum, self._count = np.zeros(self._circuit.shape), 0
        self._since = np.inf  # s, the first of them

    def frame(
        self, t: float, adc: np.ndarray, touched: bool, rest: np.ndarray | None, noise: float
    ):
        """Take a frame.

        Args:
            t: when it was read.
            adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
            touched: whether anything touches the skin.
            rest: (rows, cols) ADC ratio at rest, as it was measured; None: it was not yet, and each
                look is compared with the one before: what falls by then would be tared away.
            noise: RMS of a reading, as ADC ratio.
        """
        if touched or t < self._since < np.inf:  # or the clock was set back
            self._begin()
        if touched:
            return
        self._since = min(self._since, t)
        self._sum, self._count = self._sum + adc, self._count + 1
        if self._count < _FRAMES or t - self._since < _TAKE:
            return
        now, before = self._sum / self._count, self._before
        self._begin()
        self._before = now
        if self._rest is not None:
            rest = self._rest
        elif rest is None:
            rest = now if before is None else before
        known = self._circuit.populated & (now > 0.0) & (now < 1.0) & (rest > 0.0) & (rest < 1.0)
        if np.count_nonzero(known) >= _CELLS:
            full = self._circuit.full_scale
            least = (_ROUNDED if noise * full < _DITHER else _LEAST) / full
            self._look(t, now, rest, noise / _FRAMES**0.5, least, known)

    def _look(self, t: float, now, rest, noise: float, least: float, known) -> None:
        line = _another_line(now, rest, max(noise, least), known)
        elapsed = min(max(t - self._looked, 0.0), _UNSEEN)
        limit = _AT_ONCE + _A_SECOND * (elapsed if self._rest is None else 0.0)
        limit += 4.0 * noise / (np.median(rest[known]) * np.count_nonzero(known) ** 0.5)
        self._looked, self._told_at = t, min(self._told_at, t)  # the clock may be set back
        change, even = self._common(now, rest, noise, known, limit)
        if line:
            self._rest, self._line, self._told_at, self.fault = rest, line, t, True
            self.message = (
                f"{line}: does the multiplexer select another line, or were leads exchanged?"
            )
        elif abs(change) > limit and not self._line and not (self.fault and change > 0.0):
            fell = even and change < -_FALL
            if not self.message or fell > self.fault:
                self._rest, self._told_at, self.fault = rest, t, fell
                much = f"{100.0 * abs(np.expm1(change)):.1f} %"
                fewer = change < 0.0
                self.message = (
                    f"all cells conduct {much} {'less' if fewer else 'more'} at once: did the "
                    "supply, the reference or r_par change, or "
                    f"{'was something taken off' if fewer else 'does something lie on'} all of the "
                    "skin?"
                )
            elif not self.fault and t - self._told_at > _KEPT:
                self.forget()
        else:
            self.forget()

    def _common(self, now, rest, noise: float, known, limit: float) -> tuple[float, bool]:
        """Log conductance that nearly all cells have gained, or lost; 0 if some did neither. And
        whether all did evenly, as of the supply: a load that goes leaves no cells so alike.

        A cell that changes moves the readings of others, too: if those say so, the cells are found.
        """
        # r_ref / rho, but for r_par, is what conducts
        a, b = now[known], rest[known]
        change = np.log(a / (1.0 - a) * (1.0 - b) / b)
        spread = noise / np.median(b * (1.0 - b))  # of one reading's change
        middle = float(np.median(change))
        # what is told already need not be found again, unless it grows into a fault
        news = not self.message or (middle < -_FALL and not self.fault)
        if news and abs(middle) > limit and known[self._circuit.populated].all():
            try:
                before = self._conducted(rest)
                after = resting_conductance(now, self._circuit)
                change = np.log(after[known] / before[known])
            except ValueError:  # no cells read so
                pass
            else:  # by what a reading gains with its own cell
                own = readouts.solve(self._circuit, before, derivatives=False).own
                spread = noise / np.median((own * before)[known])
        low, middle, high = np.quantile(change, (_SHARE, 0.5, 1.0 - _SHARE))
        least = (low if middle > 0.0 else -high) + _QUARTILE * spread
        even = high - low < 2.0 * _QUARTILE * (_EVEN * abs(middle) + 1.5 * spread)
        return float(middle) if least > 0.5 * abs(middle) else 0.0, bool(even)

    def _conducted(self, rest: np.ndarray) -> np.ndarray:
        """(rows, cols) conductance [S] of the cells at rest; asked for the same rest again."""
        if rest is not self._asked:
            self._asked, self._conductance = rest, resting_conductance(rest, self._circuit)
        return self._conductance


def _another_line(now: np.ndarray, rest: np.ndarray, noise: float, known: np.ndarray) -> str:
    """Which line reads as another one did; empty if none does.

    Lines are compared by how their cells differ from each other: their level may drift.

    Args:
        noise: RMS of each of `now`, as ADC ratio.
    """
    now, rest = (np.where(known, adc, 0.0) for adc in (now, rest))
    for name, a, b, there in (("row", now, rest, known), ("column", now.T, rest.T, known.T)):
        both = (there[:, None] & there[None]).astype(float)  # (lines, lines, cells of a line)
        n = np.maximum(both.sum(2), 1.0)
        off = (a[:, None] - b[None]) * both
        off -= both * (off.sum(2) / n)[..., None]
        square = np.square(off / noise)
        free = np.maximum(n - 1.0, 1.0)
        beyond = (square.sum(2) - free) / np.sqrt(2.0 * free)  # of chi^2, from each other line
        beyond[n < _CELLS] = np.inf
        own = np.sort(square.diagonal(), axis=0)  # (cells, lines)
        own = own[: round((1.0 - _LEFT_BEHIND) * len(own))].sum(0)
        np.fill_diagonal(beyond, np.inf)
        alike = (beyond < _ALIKE).sum(1)
        found = (beyond.min(1) < _OTHER) & (alike == 1) & (own > _OWN)
        if found.any():
            k = int(found.argmax())
            return f"{name} {k} reads at rest as {name} {beyond[k].argmin()} did, cell for cell"
    return ""
