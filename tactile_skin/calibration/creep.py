# SPDX-License-Identifier: Apache-2.0
"""Creep: a fabric conducts more and more under a load that stands (docs/derivation.md).

What a load adds to a cell's conductance grows by a share in each decade of time, by 10 to 46 % on
Velostat, from 0.03 s on. The share is measured with one object that stands for two minutes, or by
presses on a scale (reference.py), and what a load has gained up to now is taken out of each frame.
"""

from __future__ import annotations

import numpy as np

from ..physics.circuit import Circuit
from ..physics.creep import LEAST_TIME, MAX_SHARE, Creep
from ..physics.curve import PressureCurve
from ..solvers import compensate
from ..solvers.evidence import MODEL
from .rest import Rest, check_frames, check_times

LIMIT = 0.2  # share of what a cell conducts that is taken out at most
_END = 0.99  # of the curve's last force, from which on a cell may bear any load, and gains nothing
LAID = 5.0  # s that an object has lain there, about, when its weight is known: see `as_it_comes`
_DECADES = 6  # of time that are followed: days are no standing load
_GONE = 0.8  # of what it was, below which a load has gone, or a part of it, and its gain with it
_RELEASE = 0.2  # s in which that is forgotten; a single frame that drops out does no harm
_STILL = 0.02  # of all loads, by which they may differ and stand: what is left of them stays known
_OLD = 10.0 ** (_STILL / MAX_SHARE) - 1.0  # of the time they stood: no fabric gains as much in it
SETTLED = 1.0  # s that a touch takes to come; what it gains later is creep, and no push
_GAP = 30.0  # s between two frames in which other loads may have come
_SPAN = 30.0  # s of a standing load at least that tell its creep
_SETTLES = 0.5  # s in which an object is laid down
_STEPS = 20  # frames a decade of time, means of those that were read
_LOADED = 0.1  # of the most loaded cell, from which on a cell is used
_STOOD = 0.7  # of the usual reading, above which the object is there
_TIMES = np.geomspace(LEAST_TIME, 10.0, 26)  # s that are tried as `Creep.time`
# What stands may change from one mean to the next, of what it added first, and times the usual step
_JUMP = 0.05
_STRAY = 8.0
_FALLS = 0.02  # in a decade of time, more than what a bottle that cools or drifts may do
_PRESS = 3.0  # s that a thing stands at least to count as a press,
_PRESSES = 3  # of which there must be so many
_USUAL_TIME = 0.1  # s after which it begins: Velostat under a robot 0.03 to 0.1 s
_NOT_TOLD = 0.1  # standard deviation of a share by presses that contradict one another
_SPREAD = 0.5  # standard deviation of its log10, about the usual one


def as_it_comes(curve: PressureCurve, creep: Creep, known: Creep | None = None) -> PressureCurve:
    """Return the curve of a load that has just come, from one by objects that lay for `LAID` s.

    What a cell conducts at rest has not crept.

    Args:
        known: creep by which the curve is such already; None: it is not.
    """
    factor = float(creep.gain(LAID) / (known or Creep()).gain(LAID))
    force, resistance = np.array(curve.points).T
    conducts = 1.0 / resistance
    came = PressureCurve(force, 1.0 / (conducts[0] + (conducts - conducts[0]) / factor))
    return came.with_gain(curve.gain)


def measure_creep(
    frames, times, circuit: Circuit, rest: Rest, curve: PressureCurve | None = None
) -> Creep:
    """How much a standing load gains with time, by one object that stands for two minutes.

    Args:
        frames: (n, rows, cols) ADC ratio; NaN where a crossing was not read. The object comes
            during them, or with the first; it is not moved, nor taken off.
        times: (n,) when each was read, rising [s].
        circuit: as `identify` found it.
        rest: `measure_rest` of the same skin.
        curve: of the usual cell, in which the object's cells are told from noise.

    Raises:
        ValueError: shapes that differ, times that do not rise, no object, less than 30 s of it,
            one that was moved or taken off, or what it adds falls or jumps.
    """
    frames = rest.quiet(check_frames(frames, circuit))
    frames, t = _standing(frames, check_times("times", times, len(frames)), circuit, rest)
    means, t = _means(frames, t)
    return _fit(t, _conductance(means, circuit, rest, curve or PressureCurve()))


def creep_of_presses(
    frames, times, circuit: Circuit, rest: Rest, curve: PressureCurve | None = None
) -> Creep:
    """How much loads gain with time, by things that are laid on, stay for five seconds, and go.

    Five presses show the share; when it begins stays the usual one, since none is known by its
    force as it comes: `fit_reference` finds that, too.

    Args:
        frames, times, circuit, rest, curve: as for `measure_creep`; the things weigh what they do,
            a hand does not.

    Raises:
        ValueError: fewer than 3 that stand for 3 s, or that contradict one another by 0.1 a decade.
    """
    frames = rest.quiet(check_frames(frames, circuit))
    times = check_times("times", times, len(frames))
    rise = np.nansum(np.maximum(frames - rest.adc, 0.0), axis=(1, 2))
    on = rise > (1.0 - _STOOD) * np.quantile(rise, 0.9)
    edges = np.flatnonzero(np.diff(np.r_[False, on, False].astype(int)))
    shares = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        t = times[first:end] - times[first]
        if t[-1] < _PRESS:
            continue
        half = int(np.argmax(rise[first:end] > 0.5 * np.median(rise[first:end])))
        t, kept = t - t[half], (t > t[half]) & (t < t[-1] - _SETTLES)
        means, at = _means(frames[first:end][kept], t[kept])
        total = _conductance(means, circuit, rest, curve or PressureCurve()).sum(1)
        # what gains more than any fabric does is still being laid on
        comes = np.diff(total) > MAX_SHARE * np.diff(np.log10(at)) * total[1:]
        laid = int(np.max(np.flatnonzero(comes & (at[1:] < 0.5 * at[-1])), initial=-2)) + 2
        decades = np.stack([np.ones(at.size), np.log10(1.0 + at / _USUAL_TIME)], 1)[laid:]
        (level, slope), *_ = np.linalg.lstsq(decades, total[laid:], rcond=None)
        shares.append(slope / level)
    if len(shares) < _PRESSES:
        raise ValueError(
            f"{len(shares)} things stood for {_PRESS:g} s: {_PRESSES} or more are needed, 5 are "
            "good: lay one on within a second, leave it for five, take it off"
        )
    share, std = float(np.median(shares)), float(np.std(shares, ddof=1) / len(shares) ** 0.5)
    if not std < _NOT_TOLD or share < -_FALLS:
        raise ValueError(
            f"the presses do not show creep: shares of {min(shares):.0%} to {max(shares):.0%} in a "
            "decade of time. Were they pressed by hand, in place of a thing that lies?"
        )
    return Creep(float(np.clip(share, 0.0, MAX_SHARE)), _USUAL_TIME, std)


def _standing(frames, times, circuit: Circuit, rest: Rest) -> tuple[np.ndarray, np.ndarray]:
    """Frames of the object, and (m,) for how long it has stood [s]."""
    rise = np.nansum(np.maximum(frames - rest.adc, 0.0), axis=(1, 2))
    usual = float(np.median(rise))
    noise = max(rest.noise, 0.5) / circuit.full_scale
    if usual < noise * np.count_nonzero(circuit.populated):
        raise ValueError("nothing stands on the skin for most of the time")
    first = int(np.argmax(rise > _STOOD * usual))
    t = times[first:] - times[first]
    if t[-1] < _SPAN:
        raise ValueError(f"the object stands for {int(t[-1])} s: {_SPAN:.0f} s or more are needed")
    gone = (rise[first:] < _STOOD * usual) & (t > _SETTLES)
    if gone.any():
        raise ValueError(f"the object was taken off after {t[gone.argmax()]:.0f} s")
    return frames[first:][t > _SETTLES], t[t > _SETTLES]


def _means(frames: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, rows, cols) mean frames and (m,) times, so many a decade of time."""
    bins = np.unique(np.floor(_STEPS * np.log10(t)), return_inverse=True)[1]
    count = np.bincount(bins)
    known = np.isfinite(frames)
    total = np.zeros((2, len(count), *frames.shape[1:]))
    np.add.at(total[0], bins, np.where(known, frames, 0.0))
    np.add.at(total[1], bins, known)
    with np.errstate(invalid="ignore"):
        return total[0] / total[1], np.bincount(bins, t) / count


def _conductance(frames, circuit: Circuit, rest: Rest, curve: PressureCurve) -> np.ndarray:
    """(m, cells) [S] that each of the object's cells conducts beyond its rest."""
    cells = circuit.populated
    tared = curve.resting_at(1.0 / np.where(cells, rest.conductance, 1e-6))
    force = compensate(frames, circuit, tared, "map", missing=True).force
    middle = np.median(force, axis=0)
    return _added(curve, force)[:, middle > _LOADED * middle.max()]


def _added(curve: PressureCurve, force: np.ndarray) -> np.ndarray:
    """Conductance [S] that forces [N] on cells add to what they conduct at rest."""
    return 1.0 / curve.resistance(force) - 1.0 / curve.points[0][1]


def _fit(t: np.ndarray, conducts: np.ndarray) -> Creep:
    """By (m, cells) [S] at t [s]: the mean of what is probable of a fit with each of `_TIMES`."""
    total, found = conducts.sum(1), []
    for time in _TIMES:
        decades = np.stack([np.ones(t.size), np.log10(1.0 + t / time)], 1)
        (first, slope), *_ = np.linalg.lstsq(decades, total, rcond=None)
        error = (total - decades @ (first, slope)) / first
        found.append((slope / first, np.square(error).sum(), decades))
    share, square, decades = map(np.array, zip(*found, strict=True))
    variance = max(square.min() / max(t.size - 3, 1), MODEL**2)
    improbable = square / variance + np.square(np.log10(_TIMES / Creep.time) / _SPREAD)
    weight = np.exp(-0.5 * (improbable - improbable.min()))
    weight /= weight.sum()
    best = float(weight @ share)
    decades = decades[weight.argmax()]
    by_noise = variance * np.linalg.inv(decades.T @ decades)[1, 1]
    by_noise += weight @ np.square(share - best)
    first, slope = np.linalg.lstsq(decades, conducts, rcond=None)[0]
    # another object lies on other cells, of which each has a share of its own
    by_cell = np.square(slope - best * first).sum() / first.sum() ** 2
    std = float(np.sqrt(by_noise + by_cell * first.size / max(first.size - 1, 1)))
    _check_course(t, total / first.sum(), decades @ (1.0, best), best)
    taken = float(np.clip(best, 0.0, MAX_SHARE))
    return Creep(taken, float(10.0 ** (weight @ np.log10(_TIMES))), std)


def _check_course(t: np.ndarray, found: np.ndarray, fitted: np.ndarray, share: float) -> None:
    """ValueError: what stands falls or jumps; (m,) at t [s], over what it added first."""
    steps = np.diff(found - fitted)
    noise = float(np.median(np.abs(steps)))
    k = int(np.abs(steps).argmax())
    if abs(steps[k]) > max(_JUMP, _STRAY * noise):
        raise ValueError(
            f"what the object adds jumps by {steps[k]:+.0%} after {t[k + 1]:.0f} s: it was pressed "
            "or lifted, or it slid"
        )
    if share < -_FALLS:
        raise ValueError(
            f"what the object adds falls by {-share:.0%} in a decade of time: a load that stands "
            "gains. It was lifted or carried by something else, or the fabric had not settled"
        )


class Gained:
    """What cells conduct by loads that had just come, by what they conduct now.

    A cell's gain is a sum of what remembers its load for a third of `time` to a day. A change of
    the load is seen at once and in full. What a load that goes had gained goes with it.

    Args:
        share, time: of `Creep`, (..., 1) each: several at once.
        cells: how many there are.
    """

    def __init__(self, share, time, cells: int):
        self._last = -np.inf  # s
        self._slow = time * 10.0 ** (np.arange(_DECADES) - 0.5)  # (..., decades) [s]
        weight = share * np.exp(-time / self._slow)
        # of all that has stood, and of what has for `SETTLED` or longer
        self._weight = np.stack([weight, weight * (self._slow > SETTLED)], -2)
        # (..., decades, cells) [S] that is remembered, and that there was in the last frame
        self._remembered = np.zeros((*self._slow.shape, cells))
        self._load = np.zeros((*self._slow.shape[:-1], 1, cells))

    def update(self, t: float, added: np.ndarray, cells=None) -> np.ndarray:
        """(..., 2, cells) [S] as it came, and at most, of (cells,) that they conduct beyond rest.

        At most: only what was gained by what has stood for `SETTLED`, or longer, is taken out.

        Args:
            t: when the frame was read [s]; set back, or after a gap, it begins anew.
            added: in that frame [S].
            cells: indices of those that are loaded, or have been: `added` has these alone.
        """
        elapsed, self._last = t - self._last, t
        if not 0.0 <= elapsed < _GAP:
            self.forget(slice(None))
            elapsed = 0.0
        remembered, last = self._remembered, self._load
        if cells is not None:
            remembered, last = remembered.take(cells, -1), last.take(cells, -1)
        if elapsed:
            keeps = np.exp(-elapsed / self._slow)[..., None]
            gone = last < _GONE * remembered
            if gone.any():
                slow = np.minimum(self._slow, _RELEASE)
                keeps = np.where(gone, np.exp(-elapsed / slow)[..., None], keeps)
            remembered = last + keeps * (remembered - last)
        load, least = added, (1.0 - LIMIT) * added
        for _ in range(2):  # each leaves a fifth of the error of the one before, or less
            both = np.maximum(added - self._weight @ np.minimum(remembered, load), least)
            load = both[..., :1, :]
        if cells is None:
            self._remembered, self._load = remembered, load.copy()  # what is returned stays
        else:
            self._remembered[..., cells], self._load[..., cells] = remembered, load
        return both

    def forget(self, cells) -> None:
        """Take cells for untouched."""
        self._remembered[..., cells] = self._load[..., cells] = 0.0


class Standing:
    """Takes out of each frame's forces what the loads have gained up to then: `Gained`.

    The force is never raised, and never reduced by more than `LIMIT` of what the cell conducts, nor
    at all at the end of the curve: there it is a lower bound, and the stop must not lose it.

    Attributes:
        most: (rows, cols) [N] that loads may be at most, for all that is known of creep: the force
            before creep is taken out, but for what a load gains after it has stood for `SETTLED`.
            A touch never reads low as it comes, and one that stands does not grow by creep.
    """

    def __init__(self, creep: Creep, curve: PressureCurve):
        self._curve, self._creep, self._gain = curve.usual, creep, curve.gain
        self._at_rest = 1.0 / curve.points[0][1]  # S
        self._at = self._since = self._looked = np.inf  # s, see `update` and `_left`
        self._before = np.zeros(())  # (rows, cols) [N] that was found at `_at`
        self._shares = self.most = np.zeros(())  # (2, rows, cols) of it: as it came, and at most

    def update(self, t: float, force: np.ndarray) -> np.ndarray:
        """(rows, cols) [N] of a load that had just come.

        Args:
            t: when the frame was read [s]; set back, or after a gap, it begins anew.
            force: (rows, cols) that was found in it [N], by the curve "as it comes".
        """
        if t < self._at:
            self._gained = Gained(self._creep.share, np.array([self._creep.time]), force.size)
            self._recent = self._follows = np.zeros(force.size, bool)  # of which it knows loads
            self._before, self._since, self._looked = np.full(force.shape, np.nan), t, t
        changed = not np.abs(force - self._before).sum() <= _STILL * self._before.sum()
        if changed or t - self._at >= min(_OLD * (t - self._since), _RELEASE):
            self._at, self._before, self._since = t, force, t if changed else self._since
            left = self._left(t, force.ravel()).reshape(-1, *force.shape)
            self._shares = np.divide(left, force, out=np.ones_like(left), where=force > 0.0)
        self.most = self._shares[1] * force
        return self._shares[0] * force

    def _left(self, t: float, force: np.ndarray) -> np.ndarray:
        """(2, cells) [N] as it came, and at most, of (cells,) that were found."""
        loaded = force > 0.0
        self._recent = self._recent | loaded
        if t - self._looked > 5.0 * _RELEASE:  # what was not loaded since then remembers none
            self._gained.forget(self._follows & ~self._recent)
            self._recent, self._follows, self._looked = loaded, self._recent, t
        self._follows = self._follows | loaded
        cells = np.flatnonzero(self._follows)
        own, gain = force[cells], 1.0 if self._gain is None else self._gain.ravel()[cells]
        added = 1.0 / self._curve.resistance(own / gain) - self._at_rest
        left = self._gained.update(t, added, cells) + self._at_rest
        left = np.minimum(gain * self._curve.force_at(np.log(left)), own)
        left = np.where(own < gain * (_END * self._curve.max_force), left, own)
        found = np.stack([force, force])
        found[:, cells] = left
        return found
