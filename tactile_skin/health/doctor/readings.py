"""Faults of single readings: bits that never change, a ceiling, noise, lines that read nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.optimize import nnls

from .recorded import Recorded, loose

# Readings that lie where a stuck bit cannot put them, over those of the emptier neighbour: on a
# sound board one or more, of means over some scans of a stuck bit less than this, by the bit.
_LOWEST_BIT = 2  # below, noise and averaging fill every gap
_GAP_SHARE = {2: 0.6, 3: 0.6, 4: 0.4}
_HIGH_GAP_SHARE = 0.25  # of higher bits
# Times the noise by which a reading that stands changes at most, steps from frame to frame while
# it stands, and the share of such readings in a gap: a stuck bit leaps across it, so that less than
# 0.01 stand there, also of means over some scans. Hard fingers on sound boards leave 0.05 or more.
_STANDS = 6.0
_STANDING = 3
_STANDING_SHARE = 0.03
_GAP_READINGS = 200  # on either side of the gaps, at least; of frames that say anything new
_ONCE = 2.0  # times the share of those, in which touches that come and go have more weight
_AT_REST = 48  # ADC steps about its rest in which a reading does not count, at most,
_AT_REST_BESIDES = 8  # and besides
_BELOW = 0.5  # of its reading at rest that no sound cell falls below, and
_BELOW_READINGS = 30  # readings that do with a wrong bit, of so many
_BELOW_CELLS = 3  # cells
_NO_REST = 0.02  # of the readings may lie in the gap of a top bit
_NOISE_WIDTH = 6.0  # times the noise: a ceiling before the ADC has its noise on top
_PILE = 3.0  # times as many readings at a ceiling as in the same width below
_PILE_READINGS = 30  # at a ceiling, of so many
_PILE_CELLS = 3  # cells
# A wrong bit about whose edge untouched cells rest, where a reading is the mean of some samples:
# share of the variance of their noise that it explains, cells there, ADC steps RMS of noise that it
# makes, at least; one over the number of samples, and its error.
_EXPLAINED = 0.9
_LEAPING = 8
_LEAP = 2.0
_FEWEST_SAMPLES = 1 / 64
_MOST_SAMPLES = 1.2
_NEAR_SHORT = 0.97  # of what a short circuit reads: above, hard touches read alike
_AT_TOP = 0.5  # share of the frames that a cell which only touches take to the ceiling is there
_NOISY = 4.0  # times the usual noise that a noisy cell has, and
_LEAST_NOISE = 2.0  # ADC steps
_EVEN = 0.6  # median over largest noise of a line, where all its readings are noisy
_OPEN_STEPS = 3.0  # ADC steps that an open line reads at most
_OPEN = 0.1  # the same, of the usual reading


def stuck_bits(seen: Recorded) -> list[tuple[int, int, float]]:
    """(bit, the value it keeps, share of readings where the other value would put them)."""
    every, base = seen.steps[:, seen.read], seen.base[seen.read]
    if top := ceiling(seen):  # what piles up there lies beside a gap by chance
        every = np.where(every < top[0] - _ceiling_width(seen), every, base)
    new = every[seen.anew]
    moves = np.abs(np.diff(every, axis=0, prepend=every[:1]))
    moves = maximum_filter1d(moves, _STANDING, axis=0)
    standing = np.where(moves < _STANDS * seen.usual_noise + 1.0, every, base)
    # exactly 0 is what a recorder leaves out, too
    fell = (new > 0.0) & (new < _BELOW * base - 3.0) & (base > 10.0)
    folded = fell.sum() >= _BELOW_READINGS and np.count_nonzero(fell.any(0)) >= _BELOW_CELLS
    folded &= seen.circuit.readout == "floating"  # a load only raises its readings
    found, bits = [], seen.circuit.adc_bits
    width = _NOISE_WIDTH * seen.usual_noise + 1.0
    # Where other cells lower readings, as on a grounded matrix, few reach the top bit, but some do.
    lacking = not (every > (1 << bits - 1) + width).any()  # the top bit, throughout
    for bit in range(_LOWEST_BIT, bits):
        limit = _GAP_SHARE.get(bit, _HIGH_GAP_SHARE)
        low = new < (1 << bit) - width
        of = [_gaps(steps, base, bit, bits) for steps in (every, new, standing)]
        for kept, (all_, once, still) in enumerate(zip(*of, strict=True)):
            if kept and low.mean() > _NO_REST:
                continue  # a bit that is always 1 leaves no reading below it
            # A hand that stands still fills no gap: it is there in what it reads once, too.
            gap = once.near >= _GAP_READINGS and once.share < _ONCE * limit and all_.share < limit
            gap &= bit in _GAP_SHARE or still.share < _STANDING_SHARE
            if gap or (bit == bits - 1 and all_.empty and folded and (kept or lacking)):
                found.append((bit, kept, all_.share))
    return found


def leaping_bit(seen: Recorded) -> tuple[int, int, float] | None:
    """(bit, the value it keeps, the most noise that it makes [ADC steps RMS]); None: there is none.

    By the noise at rest, which fills the gap of `stuck_bits` where cells rest at an end of it:
    samples leap by the bit's width, to and fro. Means of n samples that leap from `low` to `high`
    have the variance (m - low) (high - m) / n where they lie at m; cells elsewhere do not leap.
    """
    calm = seen.read & seen.circuit.populated
    for axis, line, _ in (*loose_lines(seen), *noisy(seen, ())[0]):
        seen.turned(axis, calm)[line] = False
    level, variance = seen.base[calm].astype(float), np.square(seen.noise[calm].astype(float))
    least = (1.0 - _EXPLAINED) * np.square(variance - variance.mean()).sum() if calm.any() else 0.0
    bit, noise = -1, 0.0
    for k in range(_LOWEST_BIT, seen.circuit.adc_bits):
        width = float(1 << k)
        for low in (0.0, width):
            within = np.mod(level - low, 2.0 * width)
            leaps = np.maximum(within * (width - within), 0.0)
            if np.count_nonzero(leaps) < _LEAPING:
                continue
            (share, _), left = nnls(np.stack([leaps, np.ones_like(leaps)], 1), variance)
            most = share * leaps.max()
            if _FEWEST_SAMPLES < share < _MOST_SAMPLES and most > _LEAP**2 and left**2 < least:
                bit, noise, least = k, most**0.5, left**2
    if bit < 0:
        return None
    every, base = seen.steps[:, seen.read], seen.base[seen.read]
    zero, one = _gaps(every, base, bit, seen.circuit.adc_bits)  # both ends' leaps look alike
    return bit, int(one.share < zero.share), float(noise)


class _Gap(NamedTuple):
    """Where the other value of a bit would put readings.

    Attributes:
        near: readings beside it, on the emptier side.
        share: of readings within, over that.
        empty: whether there is next to none within.
    """

    near: float
    share: float
    empty: bool


def _gaps(steps: np.ndarray, base: np.ndarray, bit: int, bits: int) -> list[_Gap]:
    """For a bit that is always 0, and for one that is always 1."""
    # At rest all readings are in one place, which may be the edge of a gap.
    moved = steps[np.abs(steps - base) > min(1 << bit, _AT_REST) + _AT_REST_BESIDES]
    counts = np.clip(np.rint(moved), 0, (1 << bits) - 1).astype(np.int32)
    histogram = np.bincount(counts, minlength=1 << bits).astype(float)
    margin = min((1 << bit) // 4, 4)  # noise at a block's ends
    each = histogram.reshape(-1, 1 << bit)[:, margin : (1 << bit) - margin].sum(1)
    found = []
    for kept in (0, 1):
        gap, beside = each[1 - kept :: 2], each[kept::2]
        inner = gap[1:] if kept else gap[:-1]  # those between two others
        near = float(np.minimum(beside[:-1], beside[1:]).sum())
        empty = bool(counts.size and gap.sum() <= _NO_REST * each.sum())
        found.append(_Gap(near, float(inner.sum() / max(near, 1.0)), empty))
    return found


def ceiling(seen: Recorded) -> tuple[float, int, int] | None:
    """(height [ADC steps], readings there, cells): where readings end that should rise further."""
    if not len(seen.peaks):
        return None  # what nothing presses ends at its rest
    limit = _NEAR_SHORT * seen.circuit.ratio(0.0) * seen.circuit.full_scale
    width = _ceiling_width(seen)
    calm = seen.read & (seen.noise < _noise_limit(seen))  # others have more noise on top
    every = seen.steps[:, calm]
    steps = every[seen.anew]
    top = float(steps.max())
    for _ in range(3):  # a cell that stays at the top is stuck there: the next one
        at_top = steps > top - width
        stays = (every > top - width).mean(0) > _AT_TOP
        if not stays.any() or stays.all():
            break
        every, steps = every[:, ~stays], steps[:, ~stays]
        top = float(steps.max())
    below = np.count_nonzero((steps > top - 3.0 * width) & ~(steps > top - width)) / 2.0
    n, cells = int(np.count_nonzero(at_top)), int(np.count_nonzero(at_top.any(0)))
    if top > limit or n < _PILE_READINGS or cells < _PILE_CELLS or n < _PILE * below:
        return None
    return float(np.median(steps[steps > top - width])), n, cells


def at_ceiling(seen: Recorded, height: float) -> np.ndarray:
    """(rows, cols) bool: cells that read as much as the ceiling lets them while nothing touches."""
    return seen.base > height - _ceiling_width(seen)


def _ceiling_width(seen: Recorded) -> float:
    """ADC steps below the highest reading that are at a ceiling."""
    return _NOISE_WIDTH * seen.usual_noise + 1.0


def _noise_limit(seen: Recorded) -> float:
    """ADC steps RMS from which on a reading is noisy."""
    return max(_NOISY * seen.usual_noise, _LEAST_NOISE)


def open_lines(seen: Recorded) -> list[tuple[int, int, float, float]]:
    """(axis, line, its largest usual reading, what an untouched cell reads)."""
    loud = np.zeros(seen.base.shape, bool)  # a noisy line that crosses an open one reads noise
    for axis, line, _ in noisy(seen, ())[0]:
        seen.turned(axis, loud)[line] = True
    found = []
    for axis in (0, 1):
        lines = seen.turned(axis, seen.base)
        every = seen.turned(axis, np.quantile(seen.steps, 0.9, axis=0))
        across = ~seen.turned(axis, loud)
        across[~across.any(1)] = True
        high = np.where(across, every, 0.0).max(1)
        usual = np.median(lines[lines > 0]) if (lines > 0).any() else 0.0
        limit = max(_OPEN_STEPS + 3.0 * seen.usual_noise, _OPEN * usual)
        limit = min(limit, 0.3 * usual)
        for line in np.flatnonzero(high <= limit):
            found.append((axis, int(line), float(high[line]), float(usual)))
    return found


def loose_lines(seen: Recorded) -> list[tuple[int, int, float]]:
    """(axis, line, share of the frames in which it is open)."""
    return [
        (axis, int(line), float((seen.closed[axis][:, line] < 0.45).mean()))
        for axis in (0, 1)
        for line in np.flatnonzero(loose(seen.closed[axis]))
    ]


def noisy(seen: Recorded, skip) -> tuple[list, list]:
    """Noisy lines (axis, line, steps) and noisy cells (row, col, steps).

    Args:
        skip: (axis, line) of lines that are not looked at.
    """
    noise, limit = np.where(seen.read, seen.noise, 0.0), _noise_limit(seen)
    for axis, line in skip:
        seen.turned(axis, noise)[line] = 0.0
    lines, cells = [], []
    for axis in (0, 1):
        turned = seen.turned(axis, noise)
        for line in range(len(turned)):
            if np.median(turned[line]) > max(limit, _EVEN * turned[line].max()):
                lines.append((axis, line, float(np.median(turned[line]))))
    for axis, line, _ in lines:
        seen.turned(axis, noise)[line] = 0.0
    while noise.max() > limit:
        row, col = np.unravel_index(noise.argmax(), noise.shape)
        cells.append((int(row), int(col), float(noise[row, col])))
        noise[row], noise[:, col] = 0.0, 0.0
    return lines, cells
