# SPDX-License-Identifier: Apache-2.0
"""Whether frames come from a board that is alive: no clock and no port of its own.

A board can go on sending without measuring: a scan that hangs while the sending goes on, a buffer
that is sent again and again, a link that delivers now what it held back. Three things give that
away. Real samples carry noise, so that frames do not repeat; the board's clock advances with ours;
and a working board does not restart all the time.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from .frame import Frame

# --- the way from the board ---------------------------------------------------------------------

JITTER = 0.02  # s that a good link may vary: USB converters hold bytes back for up to 16 ms
_SKEW = 0.01  # by which a board's clock may run slow; a ceramic resonator is within 0.005
_HEALING = 1e-4  # the same while frames lag: a board that lost a few ms of its clock recovers
_SETTLING = 0.2  # s in which frames must come at the board's own pace before they count as new
_DRAINING = 0.015  # s by which the lag may fall in that time; more, and a queue is being emptied
_GAP = 3.0  # usual intervals without a frame after which text frames may have been queued
_HURRY = 1.25  # times the usual pace, from which on a queue is being emptied
_INTERVALS = 64  # that the usual one is taken from
_FEW = 3  # of them, at least
_EVEN = 5  # longer ones in a row that are another pace, and no link that stalls again
_HALF_WRAP = 1 << 31  # us; a larger step of the board's clock is one backward


class Delay:
    """How long each frame was on its way, by the clock of the board or by its pace."""

    def __init__(self):
        self._last: tuple[float, int | None] | None = None  # arrival [s], board's time [us]
        self._board = 0.0  # s, the board's clock, unwrapped
        self._floor = math.inf  # s, arrival minus board's clock of a frame that did not wait
        self._lag = 0.0
        self._floors: deque[tuple[float, float]] = deque()  # of the last _SETTLING seconds
        self._since = math.inf  # arrival of the first frame since the start or a restart
        self._intervals: deque[float] = deque(maxlen=_INTERVALS)  # s, while nothing was queued
        self._stretch = 0.0, 0  # s, and frames in it, of text that may have been queued
        self._apart: list[float] = []  # s, the last intervals that were long and alike

    def frame(self, t: float, device_time_us: int | None) -> tuple[float, bool]:
        """Take a frame that arrived at t [s]; return its lag [s], and if the clock went back."""
        backward = False
        before, board = self._last or (t, None)
        if self._last is None:
            self.restart(t)
        elif device_time_us is None or board is None:
            self._by_pace(t - before)
        else:
            step = (device_time_us - board) % (2 * _HALF_WRAP)
            backward = step >= _HALF_WRAP
            if backward:
                self.restart(t)
            else:
                self._board += step * 1e-6
                self._by_clock(t, t - before)
        self._last = t, device_time_us
        return self._lag, backward

    def restart(self, t: float) -> None:
        """Forget the board's clock, since it restarted."""
        self._since, self._board, self._lag, self._floor = t, 0.0, 0.0, t
        self._floors.clear()
        self._floors.append((t, t))

    def _by_clock(self, t: float, elapsed: float) -> None:
        slow = _SKEW * min(elapsed, 0.1) if self._lag < JITTER else _HEALING * elapsed
        here = t - self._board
        self._floor = min(self._floor + slow, here)
        self._lag = here - self._floor
        self._floors.append((t, self._floor))
        while len(self._floors) > 1 and self._floors[1][0] <= t - _SETTLING:
            self._floors.popleft()

    def _by_pace(self, elapsed: float) -> None:
        # A gap may have queued frames. Each of them stands for one usual interval; at the usual
        # pace none is queued, and what is missing was lost. The mean interval is the usual one,
        # since USB delivers frames in groups, which of a fast board are no gap.
        usual = math.fsum(self._intervals) / max(len(self._intervals), 1)
        if self._slower(elapsed, usual):
            self._lag = 0.0
            self._intervals = deque(self._apart, _INTERVALS)
            self._apart = []
            return
        if len(self._intervals) >= _FEW and elapsed > usual + max((_GAP - 1.0) * usual, JITTER):
            self._lag, self._stretch = self._lag + elapsed - usual, (0.0, 0)
            return
        if self._lag == 0.0:
            self._intervals.append(elapsed)
            return
        self._lag = max(0.0, self._lag + elapsed - usual)
        time, frames = self._stretch[0] + elapsed, self._stretch[1] + 1
        self._stretch = time, frames
        if time >= _SETTLING and frames >= _FEW:
            if frames * usual < _HURRY * time:
                self._lag = 0.0
                self._intervals.extend([time / frames] * frames)
            self._stretch = 0.0, 0

    def _slower(self, elapsed: float, usual: float) -> bool:
        """Whether frames come evenly, and less often than usual: those of a queue come faster."""
        lately = [*self._apart, elapsed]
        if max(lately) > _GAP * min(lately):
            lately = [elapsed]
        self._apart = lately if elapsed >= _HURRY * usual else []
        return len(self._apart) >= _EVEN and math.fsum(self._apart) >= _SETTLING

    @property
    def settled(self) -> bool:
        """Whether frames have come at the board's own pace for a while: no queue is emptied."""
        if self._last is None or self._last[0] - self._since < _SETTLING:
            return False
        return self._floors[0][1] - self._floor <= _DRAINING


# --- the samples --------------------------------------------------------------------------------

_CHANCE = 1e-9  # that frames of a working board look frozen, at one time
_RARELY = 0.02  # share of frames by which a working board repeats itself, until it is measured
_FORGET = 1.0 / 300.0  # share of that measurement which each frame renews
_LONGEST = 2.0  # s after which repeated frames are frozen, however often the board repeats itself
_REMEMBERED = 4096  # frames, 40 s at 100 a second, among which a frame is looked for again
_STILL_FOR = 0.2  # s in which a cell with noise moves,
_STILL_FRAMES = 20  # and frames
_MOVING = 0.9  # of the cells must do so, or the board is too quiet to tell a line that does not
_LINE = 3  # cells at least of a line that is judged: fewer stand still by chance together
_OTHERS = 8  # cells at least of the others
_RARE = math.log(_CHANCE)
_STILL = 0.02  # of a sound board's cells may stay still in that time, at least


class Repeats:
    """Frames that come again: a scan that froze, or a buffer that is sent in a ring.

    How often a working board repeats a frame is measured; a repetition is frozen when chance would
    bring one as long once in 1e9.
    """

    def __init__(self, after: float):
        self._after = after  # s
        self._share = _RARELY
        self._count = 0
        self._place: dict[int, int] = {}  # hash of a frame -> its number
        self._hashes: deque[int] = deque(maxlen=_REMEMBERED)
        self._period = 0  # frames after which the present repetition comes again
        self._run, self._since = 0, math.inf

    def frame(self, t: float, samples: np.ndarray, full_scale: int) -> str:
        """Return what is wrong with the frame that arrived at t [s]; empty if nothing.

        Where all readings lie at an end of the scale, as of a sheet that is open at rest, they
        repeat. The text is the same for as long as the fault lasts: another one is another reason
        to stop.
        """
        if not ((samples > 0) & (samples < full_scale)).any():  # no room for noise
            self._run, self._since = 0, t
            return ""
        key = hash(samples.tobytes())
        known = len(self._hashes)
        again = 0 < self._period <= known and self._hashes[known - self._period] == key
        if not again:
            before = self._place.get(key)
            self._period = 0 if before is None else self._count - before
            self._run, self._since = 0, t
        repeats = self._period > 0
        self._run += repeats
        if known == _REMEMBERED and self._place.get(self._hashes[0]) == self._count - known:
            del self._place[self._hashes[0]]
        self._hashes.append(key)
        self._place[key] = self._count
        self._count += 1
        lasts = t - self._since
        enough = math.log(_CHANCE) / math.log(max(self._share, _RARELY))
        if repeats and lasts >= self._after and (self._run >= enough or lasts >= _LONGEST):
            if self._period == 1:
                return "the same frame repeats to the last bit: the scan is frozen"
            return f"the same {self._period} frames repeat: the board sends a buffer, not its scan"
        self._share += _FORGET * (repeats - self._share)
        return ""


class StillLines:
    """Lines whose cells do not move while those of all others do: a part of the scan is frozen.

    How often a cell stands still is measured: of all of them, and of each by itself, since one that
    reads the middle of an ADC step moves less. Lines of which each cell stands still are left out
    of that, and are frozen when chance would make them all stand so long once in 1e9.

    Attributes:
        rows, cols: lines that are frozen by the last frame.
    """

    def __init__(self, shape: tuple[int, int], full_scale: int):
        self.rows: tuple[int, ...] = ()
        self.cols: tuple[int, ...] = ()
        self._full_scale = full_scale
        self._last: np.ndarray | None = None
        self._since = np.zeros(shape)  # s, when each cell moved last, and
        self._frames = np.zeros(shape, np.int32)  # frames since then
        self._own = np.zeros(shape)  # share of frames in which a cell stands still
        self._stood = self._seen = 0.0  # times that a cell did, of so many

    def frame(self, t: float, samples: np.ndarray) -> str:
        """Return what is wrong with the frame that arrived at t [s]; empty if nothing."""
        self.rows = self.cols = ()
        moved = samples != self._last if self._last is not None else np.ones(samples.shape, bool)
        self._last = samples
        self._since[moved] = t
        self._frames += 1
        self._frames[moved] = 0
        still = (t - self._since >= _STILL_FOR) & (self._frames >= _STILL_FRAMES)
        self._stood, self._seen = (1.0 - _FORGET) * self._stood, (1.0 - _FORGET) * self._seen
        if not still.any():
            self._own *= 1.0 - _FORGET
            self._seen += still.size / _STILL_FRAMES
            return ""
        # a reading at either end of the scale has no room for noise
        known = (samples > 0) & (samples < self._full_scale)
        still &= known
        cells = [known.sum(axis) for axis in (1, 0)]
        dead = [(still.sum(1 - k) == n) & (n >= _LINE) for k, n in enumerate(cells)]
        alive = known & ~dead[0][:, None] & ~dead[1]
        n, quiet = np.count_nonzero(alive), np.count_nonzero(still & alive)
        self._own[alive] += _FORGET * (still[alive] - self._own[alive])
        self._stood += quiet / _STILL_FRAMES
        self._seen += n / _STILL_FRAMES
        usual = (self._stood + 1.0) / (self._seen + 1.0)
        if n < _OTHERS or max(usual, quiet / n) > 1.0 - _MOVING:
            return ""
        chance = np.log(np.maximum(self._own, max(usual, _STILL))) * known / _STILL_FRAMES
        frames = np.where(known, self._frames, np.iinfo(np.int32).max)
        self.rows, self.cols = (
            tuple(np.flatnonzero(lines).tolist())
            if (chance.sum(axis) * frames.min(axis))[lines].sum() < _RARE
            else ()
            for axis, lines in ((1, dead[0]), (0, dead[1]))
        )
        names = [f"row {k}" for k in self.rows] + [f"column {k}" for k in self.cols]
        if not names:
            return ""
        more = "" if len(names) <= 4 else f" and {len(names) - 4} more"
        return f"{', '.join(names[:4])}{more}: samples do not change, those of other lines do"


# --- the board ----------------------------------------------------------------------------------

_RESTARTS = 3  # of the board, and
_RESTARTS_WITHIN = 10.0  # s in which they are too many


class Verdict(NamedTuple):
    """Of one frame."""

    lag: float  # how long it was on its way [s]; 0 for one that did not wait
    settled: bool  # whether frames come at the board's own pace; until then they may be old
    trouble: str  # why the frames are no measurement; empty if they are
    # rows, cols: lines that are frozen
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()


class Liveness:
    """Judges the frames of one connection to a board.

    Args:
        shape: (rows, cols) of a frame.
        frozen_after: how long frames may repeat [s]; 0: for ever, for a board that averages so well
            that two valid frames are equal.
    """

    def __init__(self, shape: tuple[int, int], frozen_after: float):
        self._delay = Delay()
        self._repeats = Repeats(frozen_after) if frozen_after else None
        self._shape = shape
        self._lines: StillLines | None = None
        self._restarts: deque[float] = deque(maxlen=_RESTARTS)

    def frame(self, t: float, frame: Frame, restarted: bool = False) -> Verdict:
        """Take a frame that arrived at t, of a monotonic clock [s].

        Args:
            restarted: whether its number says that the board restarted.
        """
        lag, backward = self._delay.frame(t, frame.device_time_us)
        if restarted or backward:
            self._restarts.append(t)
            if not backward:
                self._delay.restart(t)
        trouble = ""
        rows: tuple[int, ...] = ()
        cols: tuple[int, ...] = ()
        if len(self._restarts) == _RESTARTS and t - self._restarts[0] < _RESTARTS_WITHIN:
            trouble = (
                f"the board restarted {_RESTARTS} times within {_RESTARTS_WITHIN:g} s: "
                "is its supply or its plug loose?"
            )
        if self._repeats is not None:
            full_scale = (1 << 16) - (1 << 16 - frame.adc_bits)
            if self._lines is None:
                self._lines = StillLines(self._shape, full_scale)
            repeats = self._repeats.frame(t, frame.samples, full_scale)
            trouble = trouble or repeats or self._lines.frame(t, frame.samples)
            rows, cols = self._lines.rows, self._lines.cols
        return Verdict(lag, self._delay.settled, trouble, rows, cols)
