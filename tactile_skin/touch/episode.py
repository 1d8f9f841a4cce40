# SPDX-License-Identifier: Apache-2.0
"""Describes what a hand did to the skin, from its first touch to its last, in 65 numbers.

The features are those of Jung et al., "Touching the Void", ICMI 2014, and "Automatic recognition of
touch gestures in the corpus of social touch", JMUI 2017, without what names places on the sensor,
and with the shape, the rhythm and the way of the touch. All are in newtons, metres and seconds or
are ratios, so that they mean the same on any mat.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

LIMIT = 0.05  # N on a cell, below which it counts as untouched: half of a light fingertip's rim
SILENCE = 0.4  # s without a touch that end a gesture: pats follow each other faster
LONGEST = 10.0  # s of an episode that are kept: what a gesture is shows in less
_TINY_FORCE = 1e-6  # N, keeps logarithms finite
_TINY_LENGTH = 1e-6  # m, the same
_AXES = 1e-4  # m, keeps ratios finite: a touch of one cell has no axes
_STILL = 1e-3  # m: shorter ways of the centre are its own error (tracking._NOISE)
_STRONG = 0.5  # of the hardest cell: cells that carry the touch
_HILL = 0.35  # of the hardest cell: maxima above it are parts of the hand, not texture
RISEN = 0.5  # of the largest force so far: where a peak begins
FALLEN = 0.4  # of the largest force so far: where it ends
_PLATEAU = 0.8  # of the largest force: a hand that rests
# Median change from picture to picture, as a share of the force, that is less than any hand's: of
# its sum and of its cells. Recorded hands at rest, 12 pictures a second, change by 1 % and 4 %, by
# 0.3 % and 2 % at least (docs/lab/gestures.md).
_STEADY_FORCE = 0.0025
_STEADY_CELLS = 0.012
_LONG_ENOUGH = 0.4  # s at rest, in which it can be seen
_SLOWEST = 0.7  # Hz: slower changes are no rhythm, the force of one push among them
_STEADY = 1e-6  # share of a course by which rounding varies it
_SPECTRUM = 64  # samples at least, to which a course is padded

_SPREADS = tuple(
    f"{name}_{part}" for name in ("force", "peak", "area") for part in ("mean", "max", "variation")
)
FEATURES = (
    *("duration", "share_touched", "bouts", "bout_rate"),
    *_SPREADS,
    *("strong_area", "strong_share", "pressure", "peakedness"),
    *("maxima_mean", "maxima_max", "maxima_std", "hills_mean", "hills_max", "hills_std"),
    *("length_mean", "length_max", "length_std", "width_mean", "width_max", "width_std"),
    *("roundness", "time_of_peak", "area_at_peak", "rise", "fall", "rise_relative"),
    *("fall_relative", "change", "change_relative", "halves", "peaks", "peak_rate"),
    *("skewness", "plateau", "path", "net_path", "extent", "straightness", "speed", "top_speed"),
    *("turning", "reversals", "reversal_rate"),
    *("force_frequency", "force_main_frequency", "force_tone"),
    *("place_frequency", "place_main_frequency", "place_tone"),
    *("swept_area", "swept_relative", "entropy", "longest_touched", "lifted", "roughness"),
    "silence",
)


class _Moment(NamedTuple):
    """One picture of an episode, in numbers."""

    force: float  # [N]
    peak: float  # [N] on one cell
    area: float  # [m^2]
    strong: float  # [m^2] of the cells with more than half of the peak
    maxima: int  # cells that no neighbour exceeds
    hills: int  # those of them that are not small beside the peak
    x: float  # [m] along a row, centre of force
    y: float  # [m] along a column
    length: float  # [m], standard deviation of the force along its longest axis
    width: float  # [m], across it
    along_x: float  # [m^2], variance of the force along a row
    along_y: float  # [m^2]
    change: float  # [N], sum over the cells of |change since the last picture|
    rough: float  # 1, differences between neighbours over the force


class _Touched(NamedTuple):
    """The pictures with a touch: of each number the mean, the most and the standard deviation."""

    mean: _Moment
    most: _Moment
    std: _Moment
    roundness: float  # mean of width over length

    @classmethod
    def of(cls, table: np.ndarray) -> _Touched:
        mean = table.mean(0)
        std = np.sqrt(np.square(table - mean).mean(0))
        length, width = (table[:, _Moment._fields.index(name)] for name in ("length", "width"))
        roundness = float((width / (length + _AXES)).mean())
        most = table.max(0)
        return cls(_Moment(*mean), _Moment(*most), _Moment(*std), roundness)


_NOTHING = _Moment(0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Episode:
    """Sums up the pictures of one gesture, one every period [s], of cells with a pitch [m]."""

    def __init__(self, shape: tuple[int, int], pitch: float, period: float):
        self.pitch, self.period = pitch, period
        self._moments: list[_Moment] = []
        self._count = 0  # pictures, those that are not kept any more included
        self._untouched = 0  # pictures since the last touch
        self.last = np.zeros(shape)
        self._sum = np.zeros(shape)
        self._most = np.zeros(shape)
        self._least = np.full(shape, np.inf)
        self._touched = np.zeros(shape)

    @property
    def duration(self) -> float:
        """From the first picture to the last [s]."""
        return self._count * self.period

    def add(self, force: np.ndarray) -> None:
        """Take the next picture: (rows, cols) force on the cells of this gesture [N], else 0."""
        change = float(np.abs(force - self.last).sum())
        self.last = force
        if force.any():
            self._moments.append(_moment(force, self.pitch, change))
            if self._untouched:
                self._least[:] = 0.0
            np.minimum(self._least, force, out=self._least)
            self._untouched = 0
        else:
            self._moments.append(_NOTHING._replace(change=change))
            self._untouched += 1
        self._count += 1
        if len(self._moments) * self.period > LONGEST:
            del self._moments[0]
        self._sum += force
        np.maximum(self._most, force, out=self._most)
        self._touched += force > 0.0

    @property
    def touch(self) -> tuple[float, float, float]:
        """Force of the last picture [N], row and column of its centre; 0 without a touch."""
        last = self._moments[-1]
        return last.force, last.y / self.pitch, last.x / self.pitch

    @property
    def silence(self) -> float:
        """For how long nothing has touched [s]."""
        return self._untouched * self.period

    def lies(self) -> bool:
        """Return whether it has rested so steadily that it is a thing and no hand."""
        force = np.array([moment.force for moment in self._moments])
        change = np.array([moment.change for moment in self._moments])
        on = force > _PLATEAU * force.max()
        both = on[1:] & on[:-1]
        if np.count_nonzero(both) * self.period < _LONG_ENOUGH:
            return False
        usual = float(np.median(force[on]))
        steps = float(np.median(np.abs(np.diff(force))[both]))
        changes = float(np.median(change[1:][both]))
        return steps < _STEADY_FORCE * usual and changes < _STEADY_CELLS * usual

    def features(self) -> np.ndarray:
        """Return (len(FEATURES),) features of the episode so far; amounts are logarithms."""
        end = len(self._moments) - self._untouched
        if end <= 0:
            return np.zeros(len(FEATURES))
        table = np.array(self._moments[:end])
        column = dict(zip(_Moment._fields, table.T, strict=True))
        touched = _Touched.of(table[column["force"] > 0.0])
        values = [
            *_rhythm(column["force"], self.period),
            *_amounts(touched, self.pitch),
            *_shape(touched),
            *_course(column, self.period),
            *_way(column, self.period),
            *_spectra(column, self.period),
            *self._all_together(touched.mean),
            min(self.silence, SILENCE),
        ]
        return np.array(values, float)

    def _all_together(self, mean: _Moment) -> list[float]:
        """Describe what the gesture did to its cells in all."""
        cell = self.pitch**2
        swept = np.count_nonzero(self._touched) * cell
        share = self._sum.ravel() / self._sum.sum()
        share = share[share > 0.0]
        lifted = (self._most - self._least).sum() / self._most.sum()
        return [
            _log(swept, _TINY_LENGTH),
            math.log(swept / mean.area),
            -float(share @ np.log(share)),
            float(self._touched.max()) / (self._count - self._untouched),
            float(lifted),
            mean.rough,
        ]


def _log(value: float, least: float) -> float:
    return math.log(float(value) + least)


def _moment(force: np.ndarray, pitch: float, change: float) -> _Moment:
    rows, cols = force.nonzero()
    f = force[rows, cols]
    total, peak = float(f.sum()), float(f.max())
    share = f / total
    x, y = float(share @ cols), float(share @ rows)
    dx, dy = cols - x, rows - y
    along_x, along_y = float(share @ (dx * dx)), float(share @ (dy * dy))
    across = float(share @ (dx * dy))
    mean = (along_x + along_y) / 2
    root = math.sqrt(max(mean * mean - (along_x * along_y - across * across), 0.0))
    # The box round the touch, with an untouched rim: all neighbours of its cells.
    top, left = rows.min(), cols.min()
    box = np.zeros((rows.max() - top + 3, cols.max() - left + 3))
    box[rows - top + 1, cols - left + 1] = f
    highest = _highest(box)
    rough = np.abs(np.diff(box, axis=0)).sum() + np.abs(np.diff(box, axis=1)).sum()
    cell = pitch * pitch
    return _Moment(
        force=total,
        peak=peak,
        area=f.size * cell,
        strong=np.count_nonzero(f > _STRONG * peak) * cell,
        maxima=highest.size,
        hills=int(np.count_nonzero(highest > _HILL * peak)),
        x=x * pitch,
        y=y * pitch,
        length=math.sqrt(max(mean + root, 0.0)) * pitch,
        width=math.sqrt(max(mean - root, 0.0)) * pitch,
        along_x=along_x * cell,
        along_y=along_y * cell,
        change=change,
        rough=float(rough) / total,
    )


def _highest(box: np.ndarray) -> np.ndarray:
    """Return the force of the cells that exceed their 8 neighbours; of equal ones the first."""
    inner = box[1:-1, 1:-1]
    rows, cols = inner.shape
    top = inner > 0.0
    for i in range(3):
        for j in range(3):
            other = box[i : i + rows, j : j + cols]
            if (i, j) < (1, 1):
                top &= inner > other
            elif (i, j) > (1, 1):
                top &= inner >= other
    return inner[top]


def _rhythm(force: np.ndarray, period: float) -> list[float]:
    on = force > 0.0
    duration = len(on) * period
    bouts = np.count_nonzero(on[1:] & ~on[:-1]) + 1  # it begins with a touch
    return [math.log(duration), float(on.mean()), math.log(bouts), bouts / duration]


def _amounts(touched: _Touched, pitch: float) -> list[float]:
    mean, most, std, _ = touched
    values = []
    for name, least in (("force", _TINY_FORCE), ("peak", _TINY_FORCE), ("area", _TINY_LENGTH)):
        usual = getattr(mean, name)
        variation = getattr(std, name) / usual
        values += [_log(usual, least), _log(getattr(most, name), least), variation]
    on_a_cell = mean.force / (mean.area / pitch**2)
    return [
        *values,
        _log(mean.strong, _TINY_LENGTH),
        mean.strong / mean.area,
        _log(mean.force / mean.area, _TINY_FORCE),
        math.log(mean.peak / on_a_cell),
    ]


def _shape(touched: _Touched) -> list[float]:
    mean, most, std, roundness = touched
    values: list[float] = []
    for name in ("maxima", "hills"):
        values += [getattr(part, name) for part in (mean, most, std)]
    for name in ("length", "width"):
        values += [_log(getattr(part, name), _TINY_LENGTH) for part in (mean, most, std)]
    return [*values, roundness]


def _course(column: dict[str, np.ndarray], period: float) -> list[float]:
    force, change = column["force"], column["change"]
    n, most = len(force), force.max()
    at = int(force.argmax())
    steps = np.diff(force, prepend=0.0) / period
    rise, fall = max(steps.max(), 0.0), max(-steps.min(), 0.0)
    half = n // 2
    halves = 0.0
    if half:
        least = _TINY_FORCE * most
        halves = math.log((force[:half].mean() + least) / (force[half:].mean() + least))
    above, peaks = False, 0
    for share in (force / most).tolist():
        now = share > (FALLEN if above else RISEN)
        peaks += now and not above
        above = now
    std = force.std()
    return [
        (at + 0.5) / n,
        _log(column["area"][at], _TINY_LENGTH),
        _log(rise, _TINY_FORCE),
        _log(fall, _TINY_FORCE),
        _log(rise / most, _TINY_FORCE),
        _log(fall / most, _TINY_FORCE),
        _log(change.mean() / period, _TINY_FORCE),
        _log(change.sum() / force.sum(), _TINY_FORCE),
        halves,
        math.log(peaks),
        peaks / (n * period),
        ((force - force.mean()) ** 3).mean() / std**3 if std > _TINY_FORCE * most else 0.0,
        (force > _PLATEAU * most).mean(),
    ]


def _way(column: dict[str, np.ndarray], period: float) -> list[float]:
    """Describe the way of the centre; between two bouts it did not move, the hand did."""
    on = column["force"] > 0.0
    x, y = column["x"], column["y"]
    both = on[1:] & on[:-1]
    dx, dy = np.diff(x)[both], np.diff(y)[both]
    step = np.hypot(dx, dy)
    path = float(step.sum())
    extent = math.hypot(np.ptp(x[on]), np.ptp(y[on]))
    duration = len(on) * period
    turn = reversals = rate = 0.0
    if len(step) > 1:
        turns = (dx[1:] * dx[:-1] + dy[1:] * dy[:-1]) / (step[1:] * step[:-1] + _TINY_LENGTH**2)
        turn, reversals = turns.mean(), (turns < 0.0).mean()
        rate = np.count_nonzero(turns < 0.0) / duration
    return [
        _log(path, _TINY_LENGTH),
        _log(math.hypot(x[-1] - x[0], y[-1] - y[0]), _TINY_LENGTH),
        _log(extent, _TINY_LENGTH),
        extent / (path + _STILL),
        _log(path / duration, _TINY_LENGTH),
        _log((step.max() if len(step) else 0.0) / period, _TINY_LENGTH),
        turn,
        reversals,
        rate,
    ]


def _spectra(column: dict[str, np.ndarray], period: float) -> list[float]:
    """Describe the rhythm of the force, and of the centre along its longer way."""
    on = column["force"] > 0.0
    x, y = column["x"], column["y"]
    wide = np.var(x[on]) + column["along_x"][on].mean()
    high = np.var(y[on]) + column["along_y"][on].mean()
    place = x if wide > high else y
    courses = np.array([column["force"], np.where(on, place - place[on].mean(), 0.0)])
    varies = courses - courses.mean(1, keepdims=True)
    # rounding has no rhythm
    varies[np.abs(varies).max(1) < _STEADY * np.abs(courses).max(1)] = 0.0
    n = max(_SPECTRUM, len(on))
    frequency = np.fft.rfftfreq(n, period)
    power = np.square(np.abs(np.fft.rfft(varies, n))) * (frequency >= _SLOWEST)
    values = []
    for share in power / np.maximum(power.sum(1, keepdims=True), np.finfo(float).tiny):
        main = share.argmax()
        values += [share @ frequency, frequency[main], share[main]]
    return values
