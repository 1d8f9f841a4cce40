# SPDX-License-Identifier: Apache-2.0
"""Curve and creep by a scale or force sensor that feels all that presses (docs/derivation.md).

What cells conduct under presses, from the first 0.03 s on, is turned to that of loads that had just
come, as a running skin does it, by each of some shares and times of creep. That whose curve
predicts presses best that were left out is kept, or none, where it does not predict them better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..physics.circuit import Circuit
from ..physics.creep import LEAST_TIME, Creep
from .creep import Gained
from .curve_fit import FIRST, FittedCurve, Knots, added_conductance, explained
from .identify import FEWEST
from .rest import Rest, check_frames, check_times, supposing
from .totals import Fit, Totals
from .touched import MOVED

MAX_LAG = 2.0  # s that a reference may be early or late,
_LAG_STEP = 0.01  # s, in steps of which that is looked for
_FOLLOWS = 0.5  # correlation of its root, which a sum of readings is like, with the skin, at least
_LIGHTEST = 0.02  # of a reference's largest force, above which the skin is pressed,
_LIGHT = 0.05  # and frames are used
_QUIET = 0.1  # of the usual largest reading, below which nothing presses, where rest drifts
_BLUR = 0.1  # of a force at most that it may change until the reference's next reading
_SHORTEST = 3.0  # s of it
_PAUSE = 0.1  # s without a load between two presses
_GAP = 1.0  # s without a frame, after which it is another press
_RELEASED = 0.7  # of the largest force within FIRST, below which it is let go: fabric lags then
_DENSE = 0.03  # s of the first frames of a press that are used, and
_STEP = 0.07  # of the time since it began, the step between further ones
_MOST = 240  # samples at most that determine a curve,
_EACH = 4  # of a press's first 0.3 s, and as many, or one a second, of what stands
_BLOCK = 20.0  # s of a load that stands, of which each counts as a press
_APART = 100.0  # s between presses, as creep is taken out: each comes to a fabric that has rested
_FOLDS = 8  # in which presses are left out
_SHARES = 0.05, 0.1, 0.15, 0.2, 0.3, 0.4  # a decade, that are tried,
_TIMES = LEAST_TIME, 0.1, 0.3, 1.0  # with each of these [s]
_SURE = 2.0  # standard errors by which creep must help
_STIFF = 0.08, 0.04, 0.12  # noise, scatter and step of the curves that are compared


def fit_reference(
    frames, times, reference, reference_times, circuit: Circuit, rest: Rest
) -> tuple[FittedCurve, float]:
    """Find curve and creep by a scale or a force sensor that feels all that presses on the skin.

    Five presses that come within a second, stay for five and are let go determine the creep; more,
    all over the skin, the cells' gains. How much later than the skin the reference says a force is
    found by their correlation, its zero where nothing touches.

    Args:
        frames: (n, rows, cols) ADC ratio; NaN where a crossing was not read. The skin rests, is
            pressed here and there, lightly and hard, and rests.
        times: (n,) [s], rising.
        reference: (m,) total force [N], with any zero.
        reference_times: (m,) [s], rising, of a clock within `MAX_LAG` of the skin's.
        circuit, rest: as for `fit_curve`.

    Returns:
        curve and creep, and by how much the reference is late [s].

    Raises:
        ValueError: shapes that differ, times that do not rise, less than 3 s of both, fewer than 3
            presses, or a reference that does not follow the skin.
    """
    frames = rest.quiet(check_frames(frames, circuit))
    reference = np.asarray(reference, dtype=float)
    times = check_times("times", times, len(frames), _SHORTEST)
    at = check_times("reference_times", reference_times, len(reference), _SHORTEST)
    rise = np.nansum(np.maximum(frames - rest.adc, 0.0), axis=(1, 2))
    late = _lag(times, rise, at, reference)
    known = (times + late >= at[0]) & (times + late <= at[-1])
    force = np.interp(times + late, at, reference)
    moved = np.nanmax(frames - rest.adc, axis=(1, 2))
    least = MOVED * max(rest.noise, 0.5) / circuit.full_scale
    calm = moved < max(least, _QUIET * float(np.quantile(moved, 0.9)))
    quiet = known & ~np.isin(_presses(times, ~calm), np.unique(_presses(times, ~calm))[1:])
    if not quiet.any():
        raise ValueError("the skin never rests in these frames: the reference's zero is unknown")
    force -= np.median(force[quiet])
    blur = np.abs(np.gradient(force, times)) * np.median(np.diff(at)) / 2.0  # N, as it rises
    press = _presses(times, known & (moved > least) & (force > _LIGHTEST * force.max()))
    since, used = np.zeros(len(times)), _sampled(times, force, press)
    for k in np.unique(press)[1:]:
        since[press == k] = times[press == k] - times[press == k][0]
    clear = (force > _LIGHT * force.max()) & (blur < _BLUR * force)
    blocks = np.unique([press, since // _BLOCK], axis=1, return_inverse=True)[1]
    if (found := len(np.unique(blocks[used & clear]))) < FEWEST:
        raise ValueError(f"{found} presses: {FEWEST} or more are needed, 30 are good")
    at_rest = supposing(rest, circuit).conductance
    usual = float(np.median(at_rest[circuit.populated]))  # S
    knots = Knots.of(circuit, usual)
    added, doubts = added_conductance(frames[used], circuit, at_rest, usual, knots)
    force, since, press, blocks = force[used], since[used], press[used], blocks[used]
    shown = clear[used] & (added.sum((1, 2)) > 0.0)
    chosen = _chosen(since, press, shown)
    creep, words = _creep(added, since, press, chosen, force, blocks, knots)
    known = np.array([[creep.share]]), np.array([[creep.time]])
    loads = _loads(added, since, press, *known)[chosen, 0]
    fitted = explained(loads, force[chosen], blocks[chosen], circuit, usual, doubts, since[chosen])
    message = f"{words}; {fitted.message}"
    return replace(fitted, creep=creep, message=message), late


def _presses(times: np.ndarray, on: np.ndarray) -> np.ndarray:
    """(n,) number of the press that each frame belongs to, from 1; 0: none."""
    number, last, count = np.zeros(len(times), int), -1, 0
    for k in np.flatnonzero(on):
        gap = times[k] - times[last] if last >= 0 else np.inf
        count += int(gap > (_PAUSE if k > last + 1 else _GAP))
        number[k], last = count, int(k)
    return number


def _sampled(times: np.ndarray, force: np.ndarray, press: np.ndarray) -> np.ndarray:
    """(n,) bool frames that are used: denser where a press begins, none where it is let go."""
    used = np.zeros(len(times), bool)
    for number in np.unique(press)[1:]:
        mine = np.flatnonzero(press == number)
        t, next_ = times[mine] - times[mine[0]], -np.inf
        before = np.searchsorted(t, t - FIRST)
        for k, index in enumerate(mine):
            held = force[index] >= _RELEASED * force[mine[before[k] : k + 1]].max()
            if held and t[k] >= next_:
                used[index], next_ = True, t[k] + max(_STEP * t[k], _DENSE / _EACH)
    return used


def _chosen(since: np.ndarray, press: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Return indices of samples that determine a curve: as many of first moments as of holds."""
    taken: list[int] = []
    presses = np.unique(press[shown])
    each = max(1, min(_EACH, _MOST // (2 * len(presses))))
    for number in presses:
        mine = np.flatnonzero(shown & (press == number))
        t, end = since[mine], since[mine[-1]]
        stands = max(each, min(int(end), _MOST // len(presses)))
        goals = np.r_[
            FIRST * (np.arange(each) + 1.0) / each,
            np.linspace(FIRST, max(end, FIRST), stands + 1)[1:],
        ]
        taken += mine[np.abs(t[:, None] - goals).argmin(0)].tolist()
    return np.unique(taken)


def _loads(added, since, press, share, time) -> np.ndarray:
    """(n, tried, rows, cols) [S] of loads as they came, by (tried, 1) shares and times of creep."""
    gained, flat = Gained(share, time, added[0].size), added.reshape(len(added), -1)
    t = since + _APART * _count(press)
    loads = [gained.update(at, now)[:, 0] for at, now in zip(t, flat, strict=True)]
    return np.array(loads).reshape(len(added), -1, *added.shape[1:])


def _count(press: np.ndarray) -> np.ndarray:
    return np.cumsum(np.diff(press, prepend=press[0]) != 0)


def _creep(added, since, press, chosen, force, blocks, knots: Knots) -> tuple[Creep, str]:
    """Return what predicts presses best that are left out; words with the evidence."""
    share, time = (grid.reshape(-1, 1) for grid in np.meshgrid((0.0, *_SHARES), _TIMES))
    loads = _loads(added, since, press, share, time)[chosen]
    off = np.array(
        [_off(knots.ramps(loads[:, k]), force[chosen], blocks[chosen]) for k in range(len(share))]
    )
    names = np.unique(blocks[chosen])
    by_press = np.array([off[:, blocks[chosen] == k].mean(1) for k in names])  # (presses, tried)
    best = int(by_press.mean(0).argmin())
    gains = by_press[:, 0] - by_press[:, best]
    error = gains.std(ddof=1) / len(names) ** 0.5
    first, last = np.median(off[0]), np.median(off[best])
    if share[best, 0] == 0.0 or gains.mean() <= _SURE * error:
        return Creep(), (
            f"creep does not help: presses left out are off by {first:.0%} without it, by "
            f"{np.median(off[1:], axis=1).min():.0%} with it: curve.creep is 0"
        )
    alike = (by_press - by_press[:, [best]]).std(0, ddof=1) / len(names) ** 0.5
    alike = by_press.mean(0) - by_press.mean(0)[best] <= alike
    found = Creep(float(share[best, 0]), float(time[best, 0]), float(share[alike].std()))
    return found, (
        f"a load gains {found.share:.0%} in a decade of time, from {found.time:g} s on: with that "
        f"presses left out are off by {last:.0%}, without it by {first:.0%}"
    )


def _off(ramps: np.ndarray, force: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """(n,) by how much each total is off, relative, its press left out."""
    totals, off = Totals.of(ramps, force), np.empty(len(force))
    names = np.unique(blocks)
    for fold in np.array_split(names, min(_FOLDS, len(names))):
        mine = np.isin(blocks, fold)
        fit: Fit = totals.only(~mine).solve(*_STIFF)
        off[mine] = np.abs(np.log(np.maximum(fit.of(totals.only(mine)), 0.1)))
    return off


def _lag(times, rise, at, reference) -> float:
    """By how much the reference is later than the readings' rise [s]."""
    lags = np.arange(-MAX_LAG, MAX_LAG + _LAG_STEP / 2, _LAG_STEP)
    root, found = np.sqrt(reference - reference.min()), []
    for lag in lags:
        known = (times + lag >= at[0]) & (times + lag <= at[-1])
        both = rise[known], np.interp(times[known] + lag, at, root)
        sure = np.count_nonzero(known) > len(times) / 2 and min(np.ptp(v) for v in both) > 0.0
        found.append(np.corrcoef(*both)[0, 1] if sure else -1.0)
    best = int(np.argmax(found))
    if found[best] < _FOLLOWS or best in (0, len(lags) - 1):
        raise ValueError(
            f"the reference does not follow the skin (correlation {found[best]:.2f} at best, with "
            f"it up to {MAX_LAG:g} s early or late): are both of the same time?"
        )
    before, here, after = found[best - 1 : best + 2]
    turn = before - 2.0 * here + after  # the top of a parabola
    return float(lags[best] + _LAG_STEP * 0.5 * (before - after) / min(turn, -1e-12))
