# SPDX-License-Identifier: Apache-2.0
"""A recording of ordinary use, summed up for the doctor: rest, noise, and the touches in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from ...calibration.rest import Rest, check_frames
from ...calibration.touched import MOVED
from ...physics.circuit import Circuit
from ...physics.readouts import apparent
from ...solvers.reading import ROUNDING_NOISE
from ...solvers.suspect import LINE_OPEN

FEW_TOUCHES = 5  # that must agree in what no single one shows
_QUIET = 0.15  # share of the frames, the calmest ones, that count as untouched
_FEWEST = 20  # frames that a recording has at least
_APART = 0.003  # share of the frames by which two touches are apart, and
_LEAST_APART = 10  # frames at least
_LINE_CLOSED = 0.6  # of the usual reading, above which a line is connected
_HALF_CLOSED = 0.5 * (LINE_OPEN + _LINE_CLOSED)  # neither, of a line that does not say


@dataclass(frozen=True, eq=False)
class Recorded:
    """Readings of a board, with what every check asks of them."""

    circuit: Circuit  # as it is supposed
    steps: np.ndarray  # (n, rows, cols) readings [ADC steps]
    read: np.ndarray  # (rows, cols) bool, crossings that were ever read
    base: np.ndarray  # (rows, cols) reading of the untouched skin [ADC steps]
    quiet: np.ndarray  # (n,) bool, frames in which nothing touches it
    noise: np.ndarray  # (rows, cols) RMS of a reading in the quiet frames [ADC steps]
    # the same by what changes from one of them to the next: without what moves slowly
    flicker: np.ndarray
    # frames that differ from the one before of them: a hand that stands still says nothing new
    anew: np.ndarray
    peaks: np.ndarray  # frames in which touches are strongest
    touches: np.ndarray  # those of them that differ from the one before: one for each touch
    # for rows and columns, (n, lines) reading of each line, its usual one 1
    closed: tuple[np.ndarray, np.ndarray]
    # share of all change, squared, by which readings are below their usual ones, loose lines left
    # out
    fell: float

    @property
    def ratio(self) -> np.ndarray:
        """(n, rows, cols) readings as ADC ratio; NaN: never read."""
        return np.where(self.read, self.steps / self.circuit.full_scale, np.nan)

    @property
    def cells(self) -> np.ndarray:
        """(rows, cols) bool, those that exist and were ever read."""
        return self.read & self.circuit.populated

    @property
    def usual_noise(self) -> float:
        """RMS of a reading [ADC steps], of rounding at least."""
        return float(max(np.median(self.noise[self.cells]), ROUNDING_NOISE))

    @property
    def width(self) -> float:
        """ADC steps by which noise, and rounding, may move a reading."""
        return MOVED * self.usual_noise + 1.0

    def is_open(self, axis: int) -> np.ndarray:
        """(n, lines) bool: frames in which each row, or column, is nearer to open than closed."""
        return self.closed[axis] < _HALF_CLOSED

    def turned(self, axis: int, picture: np.ndarray) -> np.ndarray:
        """Return the picture (..., rows, cols) with the lines of an axis first of the last two."""
        return picture if axis == 0 else picture.swapaxes(-1, -2)

    def without(self, picture: np.ndarray, lines) -> np.ndarray:
        """Return a copy of a picture that is 0 on these lines (axis, line)."""
        picture = picture.copy()
        for axis, line in lines:
            self.turned(axis, picture)[line] = 0
        return picture

    @property
    def loose(self) -> list[tuple[int, int]]:
        """(axis, line) of lines that are open in some frames and closed in others."""
        return [(axis, int(k)) for axis in (0, 1) for k in np.flatnonzero(loose(self.closed[axis]))]


def record(frames, circuit: Circuit, rest: Rest | None) -> Recorded:
    """Sum up the frames; ValueError: they are none of this circuit, too few, or none was read."""
    frames = check_frames(frames, circuit)
    if len(frames) < _FEWEST:
        raise ValueError(f"{len(frames)} frames: give {_FEWEST} or more, of about a minute of use")
    steps = (frames * circuit.full_scale).astype(np.float32)
    absent = np.isnan(steps)
    read = ~absent.all(0)
    if not read.any():
        raise ValueError("no crossing was ever read")
    usual = np.where(read, np.nanmedian(np.where(read, steps, 0.0), axis=0), 0.0)
    steps = np.where(absent, usual, steps)
    closed = _closed(0, steps, usual, circuit), _closed(1, steps, usual, circuit)
    change = steps - usual
    rows, cols = (~loose(share) for share in closed)
    power = np.square(change) * rows[:, None] * cols
    fell = float(power[change < 0.0].sum() / max(power.sum(), 1e-9))
    # A finger on a grounded matrix lowers the other readings of its line: by their mean it is rest.
    level = _activity(np.abs(change) if circuit.readout_class.shares_sum else change, closed)
    quiet = level <= np.quantile(level, _QUIET)
    calm, n = np.where(absent, 0.0, steps)[quiet], np.maximum((~absent)[quiet].sum(0), 1)
    mean = np.where((~absent)[quiet].any(0), calm.sum(0) / n, usual)
    base = mean if rest is None else rest.adc * circuit.full_scale
    base = np.where(np.isfinite(base), base, 0.0)
    noise = np.sqrt((np.square(calm - mean) * (~absent)[quiet]).sum(0) / n)
    pairs = np.flatnonzero(quiet[1:] & quiet[:-1])
    changes = np.square(steps[pairs + 1] - steps[pairs])
    flicker = np.sqrt(0.5 * changes.mean(0)) if pairs.size else noise
    cells = read & circuit.populated
    limit = MOVED * np.maximum(noise, max(np.median(noise[cells]), ROUNDING_NOISE))[cells]
    anew = _anew(steps[:, cells], limit, range(len(steps)))
    peaks = _peaks(level, len(frames), float(np.median(level[quiet])))
    touches = _anew(steps[:, cells], limit, peaks)
    return Recorded(
        circuit, steps, read, base, quiet, noise, flicker, anew, peaks, touches, closed, fell
    )


def _anew(steps: np.ndarray, limit: np.ndarray, frames) -> np.ndarray:
    """Those of the frames in which a reading differs from the last one of them by its limit."""
    taken: list[int] = []
    for k in frames:
        if not taken or (np.abs(steps[k] - steps[taken[-1]]) > limit).any():
            taken.append(k)
    return np.array(taken, dtype=int)


def _closed(axis: int, steps: np.ndarray, usual: np.ndarray, circuit: Circuit) -> np.ndarray:
    """(n, lines): each line's reading over what the other lines usually read there.

    Where a touch lowers its line's other readings, by what the touch leaves of them.
    """
    scale, _ = apparent(circuit, steps / circuit.full_scale)
    usual = usual / apparent(circuit, usual / circuit.full_scale)[0]
    others = np.maximum(np.median(usual, axis=axis, keepdims=True), 1.0)
    share = np.where(scale < LINE_OPEN, _HALF_CLOSED, steps / (scale * others))
    return share.mean(2 - axis)  # a stripe that is cut reads before the cut


def loose(share: np.ndarray) -> np.ndarray:
    """(lines,) bool: lines that are open in some frames and closed in others."""
    is_open, is_closed = (share < LINE_OPEN).mean(0), (share > _LINE_CLOSED).mean(0)
    return (is_open > 0.005) & (is_closed > 0.02)


def _activity(change: np.ndarray, closed) -> np.ndarray:
    """(n,) how much the most touched line is raised [ADC steps], loose lines left out."""
    level = np.zeros(len(change))
    for axis in (0, 1):
        lines = np.delete(change, np.flatnonzero(loose(closed[1 - axis])), axis=2 - axis)
        if not lines.shape[2 - axis]:
            continue
        mean = lines.mean(2 - axis)
        mean[:, loose(closed[axis])] = -np.inf
        # The second largest: a single noisy line is no touch.
        level += np.partition(mean, -2, axis=1)[:, -2] if mean.shape[1] > 1 else mean[:, 0]
    return uniform_filter1d(np.where(np.isfinite(level), level, 0.0), 3)


def _peaks(level: np.ndarray, n: int, calm: float) -> np.ndarray:
    """Return the strongest frame of each touch."""
    noise = float(np.std(level[level <= np.quantile(level, 2 * _QUIET)]))
    size = max(_LEAST_APART, int(_APART * n)) * 2 + 1
    least = calm + MOVED * max(noise, ROUNDING_NOISE)
    return np.flatnonzero((level == maximum_filter1d(level, size)) & (level > least))
