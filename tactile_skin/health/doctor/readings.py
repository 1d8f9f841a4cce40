# SPDX-License-Identifier: Apache-2.0
"""Faults of single readings: bits that never change, a ceiling, noise, lines that read nothing."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.optimize import nnls

from ...calibration.rest import NOISY, NOISY_STEPS
from ...findings.finding import Finding, Kind, at, lines
from ...physics.adc import Adc
from ...solvers.suspect import BELOW_REST, LINE_OPEN
from ..bits import EMPTY, GAP_READINGS, HIGH_GAP, gaps
from ..ceiling import Ceiling
from ..check import Windows
from .recorded import Recorded

SEVERAL = 30  # readings, of so many
SEVERAL_CELLS = 3  # cells, that a bit or a ceiling takes: fewer are single cells' faults
# Readings that lie where a stuck bit cannot put them, over those of the emptier neighbour. Of low
# bits the means over some scans fill the gap, on sound boards there are as many or more.
_LOWEST_BIT = 2  # below, noise and averaging fill every gap
_HIGHEST_LOW_BIT = 4
_LOW_GAP = 0.5
_STANDING = 3  # frames in which a reading stands
_AT_REST = 48  # ADC steps about its rest in which a reading does not count, at most
# A wrong bit about whose edge untouched cells rest, where a reading is the mean of some samples:
# share of the variance of their noise that it explains at least.
_EXPLAINED = 0.9
_NEAR_SHORT = 0.97  # of what a short circuit reads: above, hard touches read alike
_EVEN = 0.6  # median over largest noise of a line, where all its readings are noisy
_OPEN_NOISY = 0.3  # of the usual reading, that an open line reads at most where noise adds to it
_TOUCHED_SELDOM = 0.9  # of the frames in which an open line reads no more
_LOOSE = 0.25  # of all lines at most come and go: more are touches on a skin that never rests


def wrong_bits(seen: Recorded, top: tuple[float, Finding] | None) -> list[Finding]:
    """Return bits of the ADC that never change: by the readings that lack, or by noise at rest."""
    return _stuck_bits(seen, top) or _leaping_bit(seen)


def _stuck_bits(seen: Recorded, top: tuple[float, Finding] | None) -> list[Finding]:
    """Return bits whose other value would put readings where there are hardly any."""
    every, base = seen.steps[:, seen.read], seen.base[seen.read]
    if top:  # what piles up there lies beside a gap by chance
        every = np.where(every < top[0] - seen.width, every, base)
    new = every[seen.anew]
    moves = np.abs(np.diff(every, axis=0, prepend=every[:1]))
    moves = maximum_filter1d(moves, _STANDING, axis=0)
    width = seen.width
    standing = np.where(moves < width, every, base)
    # exactly 0 is what a recorder leaves out, too
    fell = (new > 0.0) & (new < BELOW_REST * base - width)
    folded = fell.sum() >= SEVERAL and np.count_nonzero(fell.any(0)) >= SEVERAL_CELLS
    folded &= seen.circuit.readout == "floating"  # a load only raises its readings
    found, bits = [], seen.circuit.adc_bits
    # Where other cells lower readings, as on a grounded matrix, few reach the top bit, but some do.
    lacking = not (every > (1 << bits - 1) + width).any()  # the top bit, throughout

    @cache
    def histograms(rest: int) -> list[np.ndarray]:  # of high bits they are the same
        return [_moved(s, base, rest, bits) for s in (every, new, standing)]

    for bit in range(_LOWEST_BIT, bits):
        low = bit <= _HIGHEST_LOW_BIT
        below = (new < (1 << bit) - width).mean() > EMPTY
        of = [gaps(moved, bit) for moved in histograms(_rest_of(bit))]
        for kept, (all_, once, still) in enumerate(zip(*of, strict=True)):
            if kept and below:
                continue  # a bit that is always 1 leaves no reading below it
            still = all_ if low else still
            # A hand that stands still fills no gap: evidence is what was read once.
            gap = once.near >= GAP_READINGS and still.share < (_LOW_GAP if low else HIGH_GAP)
            if gap or (bit == bits - 1 and all_.empty and folded and (kept or lacking)):
                numbers = {"bit": bit, "kept": kept, "share": all_.share}
                found.append(Finding(Kind.BITS, "gap", numbers=numbers))
    return found


def _leaping_bit(seen: Recorded) -> list[Finding]:
    """Return the wrong bit that shows in the noise at rest.

    It fills the gap of a stuck bit where cells rest at an end of it: samples leap by the bit's
    width, to and fro. Means of n samples that leap from `low` to `high` have the variance
    (m - low) (high - m) / n where they lie at m; cells elsewhere do not leap.
    """
    calm = seen.without(seen.cells, seen.loose + _noisy_lines(seen))
    level, variance = seen.base[calm].astype(float), np.square(seen.noise[calm].astype(float))
    least = (1.0 - _EXPLAINED) * np.square(variance - variance.mean()).sum() if calm.any() else 0.0
    found = None
    for bit in range(_LOWEST_BIT, seen.circuit.adc_bits):
        width = float(1 << bit)
        for low in (0.0, width):
            within = np.mod(level - low, 2.0 * width)
            leaps = np.maximum(within * (width - within), 0.0)
            if np.count_nonzero(leaps) < SEVERAL_CELLS:
                continue
            (share, _), left = nnls(np.stack([leaps, np.ones_like(leaps)], 1), variance)
            most = share * leaps.max()
            if share <= 1.0 and most > NOISY_STEPS**2 and left**2 < least:
                found, least = (bit, most**0.5), left**2
    if found is None:
        return []
    bit, noise = found
    every, base = seen.steps[:, seen.read], seen.base[seen.read]
    moved = _moved(every, base, _rest_of(bit), seen.circuit.adc_bits)
    zero, one = gaps(moved, bit)  # both ends' leaps look alike
    numbers = {"bit": bit, "kept": one.share < zero.share, "noise": noise, "width": 1 << bit}
    return [Finding(Kind.BITS, "leaps", numbers=numbers)]


def _rest_of(bit: int) -> int:
    """ADC steps about its rest in which a reading does not count for a bit."""
    return min(2 << bit, _AT_REST)


def _moved(steps: np.ndarray, base: np.ndarray, rest: int, bits: int) -> np.ndarray:
    """Return how many readings there are at each step, (2^bits,), without those about rest."""
    # At rest all readings are in one place, which may be the edge of a gap.
    moved = steps[np.abs(steps - base) > rest]
    counts = np.clip(np.rint(moved), 0, (1 << bits) - 1).astype(np.int32)
    return np.bincount(counts, minlength=1 << bits).astype(float)


def ceiling(seen: Recorded) -> tuple[float, Finding] | None:
    """Return the height where readings end that should rise further [ADC steps], and the finding.

    As a running skin sees it. None: there is none.
    """
    bits = seen.circuit.adc_bits
    watch, windows = Ceiling(Adc(seen.circuit)), Windows(bits)
    calm = seen.read & (seen.noise < _noise_limit(seen))  # others have more noise on top
    for steps in seen.steps:
        samples = np.rint(np.where(calm, steps, 0.0) * (1 << 16 - bits)).astype(np.uint16)
        watch.look(samples, windows.frame(samples))
    most = seen.circuit.ratio(0.0) * seen.circuit.full_scale
    if watch.height is None or watch.height > _NEAR_SHORT * most:
        return None
    return watch.height, watch.findings()[0]


def _noise_limit(seen: Recorded) -> float:
    """ADC steps RMS from which on a reading is noisy."""
    return max(NOISY * seen.usual_noise, NOISY_STEPS)


def open_lines(seen: Recorded, skip: set) -> list[Finding]:
    """Return lines of which no reading rises."""
    # a noisy line that crosses an open one reads noise
    quiet = seen.without(np.ones(seen.base.shape, bool), _noisy_lines(seen))
    found = []
    for axis in (0, 1):
        base, read = seen.turned(axis, seen.base), seen.turned(axis, seen.read)
        every = seen.turned(axis, np.quantile(seen.steps, _TOUCHED_SELDOM, axis=0))
        across = seen.turned(axis, quiet).copy()
        across[~across.any(1)] = True
        high = np.where(across, every, 0.0).max(1)
        usual = float(np.median(base[base > 0])) if (base > 0).any() else 0.0
        limit = min(max(seen.width, LINE_OPEN * usual), _OPEN_NOISY * usual)
        for k in map(int, np.flatnonzero(high <= limit)):
            numbers = {"count": np.count_nonzero(read[k]), "most": high[k], "usual": usual}
            found.append(Finding(Kind.OPEN, **lines(axis, k), numbers=numbers))
    return found


def loose_lines(seen: Recorded, skip: set) -> list[Finding]:
    """Return lines that are open in some frames."""
    found = seen.loose
    if len(found) > _LOOSE * sum(seen.circuit.shape):
        return []
    shares = {line: float(seen.is_open(line[0])[:, line[1]].mean()) for line in found}
    return [
        Finding(Kind.CONTACT, "line", **lines(*line), numbers={"share": share})
        for line, share in shares.items()
        if line not in skip
    ]


def _noisy_lines(seen: Recorded, skip=()) -> list[tuple[int, int]]:
    """(axis, line) of lines all of whose readings are noisy."""
    noise = _noise(seen, skip)
    turned = [(axis, k, of) for axis in (0, 1) for k, of in enumerate(seen.turned(axis, noise))]
    limit = _noise_limit(seen)
    return [(axis, k) for axis, k, of in turned if np.median(of) > max(limit, _EVEN * of.max())]


def _noise(seen: Recorded, skip) -> np.ndarray:
    """(rows, cols) RMS of each reading [ADC steps], 0 on the lines (axis, line) of skip."""
    return seen.without(np.where(seen.read, seen.noise, 0.0), skip)


def noisy(seen: Recorded, skip: set) -> list[Finding]:
    """Return lines and cells with much more noise than the others."""

    def finding(form: str, of, steps: float) -> Finding:
        numbers = {"noise": steps, "usual": seen.usual_noise}
        return Finding(Kind.NOISY, form, **of, numbers=numbers)

    in_lines, noise = _noisy_lines(seen, skip), _noise(seen, skip)
    found = [
        finding("line", lines(axis, k), float(np.median(seen.turned(axis, noise)[k])))
        for axis, k in in_lines
    ]
    noise = _noise(seen, skip | set(in_lines))
    while noise.max() > _noise_limit(seen):
        row, col = (int(k) for k in np.unravel_index(noise.argmax(), noise.shape))
        found.append(finding("cell", at((row, col)), float(noise[row, col])))
        noise[row], noise[:, col] = 0.0, 0.0
    return found


# (what is recorded, (axis, line) of lines that earlier ones found unusable) -> findings
CHECKS = [open_lines, loose_lines, noisy]
