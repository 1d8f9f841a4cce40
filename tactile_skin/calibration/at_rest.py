# SPDX-License-Identifier: Apache-2.0
"""What a second of rest shows: no matrix, lines that are one, a cell or a line that is no fabric's.

The cells of a fabric differ at rest, by 3 % and more. Lines that read alike cell for cell, to the
noise, while other pairs are apart, are one line; how alike sound ones may be by chance follows from
the number of their cells, and from how smoothly the lines across say that the fabric varies.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.special import gammainccinv, gammaincinv, ndtri

from ..findings.finding import Finding, Kind, Severity, largest, lines
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from .rest import MAD, UNLIKE, usual_resistance
from .touched import AT_REST, RESTS

# RMS by which readings of one voltage differ at most: as channels may [ADC steps]; by chance, once
# in so many seconds; and times the noise of a mean, as a low-pass before it leaves more.
_CHANNELS = 0.2
_CHANCE = 1e-4
_LOW_PASS = 1.3
_ABOUT_0 = 0.03  # ADC ratio: who misses it lacks 3 % of the range
LEAST_STEPS = 3.0  # ADC steps below which the board may take something off
# Share of what cells of such a fabric differ by, below which each reads as its zero is set.
_EVEN = 0.25
_LEAST_SCATTER = 0.03  # RMS of log resistance of a good fabric's cells at rest, chosen
# Changes of log conductance that are no fabric's, chosen on simulated boards (tests/calibration;
# benchmarks.faults): of a line beside the others; of a line since the start.
_MAX_LINE_OFFSET = 0.2
LINE_FALL = 0.05  # the least that may hide a push
# Times the median deviation of its cells, over the root of their number, by which a line's median
# may differ, and a cell: four standard deviations.
_MOST_DEVIATIONS = 6.0
# N a cell that cells bear on average, over the usual one, as their conductance scatters: by a log
# of 1 about it they bear 0.02 by the shipped curve. A hand bears more.
_UNEVEN = 0.03
NO_REST = "rest"  # form of what keeps the rest from being measured
_PATCH = 3  # cells along each side that are looked at together
_CALMEST = 0.25  # of the cells, which nothing touches
_QUARTILE = -ndtri(_CALMEST)  # standard deviations that the quartile of normal ones lies off
_DEVIATIONS = 5.0  # of a patch's mean, beyond which none of some 1,000 is by chance
_OPEN = 1e-6  # times what the usual cell conducts: nothing
ALIKE = 0.1  # squared difference over the usual one, at most
OF_NOISE = 3.0  # times what noise explains of a squared difference
_NEAR_WHOLE = 0.01  # ADC steps off a whole one,
_WHOLE = 0.3  # and share of readings that may be so near to it


def equal_lines(steps: np.ndarray, noise: float, cells: np.ndarray) -> list[tuple[int, int, int]]:
    """Return (axis, line, line) of each pair of lines that are one.

    Args:
        steps: (rows, cols) mean reading of an untouched skin [ADC steps].
        noise: RMS of each [ADC steps].
        cells: (rows, cols) bool, those that exist.
    """
    if not cells.any() or np.mean(np.abs(steps - np.rint(steps))[cells] < _NEAR_WHOLE) > _WHOLE:
        return []  # rounded without noise that would average it away: many read alike
    found, by_noise = [], 2.0 * noise**2
    for axis, values, there in ((0, steps, cells), (1, steps.T, cells.T)):
        one, other = np.triu_indices(len(values), 1)
        both = there[one] & there[other]  # (pairs, cells of a line)
        one, other, both = (of[both.any(1)] for of in (one, other, both))
        n, beside = both.sum(1), there[:, 1:] & there[:, :-1]  # of the other lines
        if not (n.size and beside.any()):
            continue
        square = (np.square(values[one] - values[other]) * both).sum(1) / n
        usual = float(np.median(square))
        if usual * ALIKE < by_noise:  # those of a simulated fabric may not differ
            continue
        # the smoother the fabric, the fewer of its cells are independent of those beside them
        across = np.square(np.diff(values, axis=1))[beside].mean()
        free = 0.5 * min(1.0, across / max(usual, 1e-300))

        def most(n, free=free, pairs=n.size, usual=usual):
            """Return the mean square of n cells below which it is noise, and no chance."""
            # of normal differences the sum of n squares is chi^2, whose small values are rare
            by_chance = gammaincinv(free * n, _CHANCE / (2.0 * pairs)) / (free * n)
            return np.minimum(np.minimum(by_chance, ALIKE) * usual, OF_NOISE * by_noise)

        equal = square < most(n)
        # Lines that differ in some address bits only show it together more surely than each pair,
        # if those as near to one another are apart: on a smooth fabric they are not.
        distance = other - one
        for bits in range(1, (1 << int(other.max()).bit_length()) - 1):
            group = (one ^ other) & ~bits == 0
            near = (distance <= distance[group].max(initial=0)) & ~group
            if np.count_nonzero(group) > 1 and near.any():
                mean = np.average(square[group], weights=n[group])
                if mean < min(most(n[group].sum()), ALIKE * np.median(square[near])):
                    equal |= group
        pairs = zip(one[equal].tolist(), other[equal].tolist(), strict=True)
        found += [(axis, *pair) for pair in pairs]
    return found


def address_bits(pairs: list[tuple[int, int]], count: int) -> list[int]:
    """Return the address bits without which `count` lines are read, by the pairs that are one."""
    found = []
    for bit in range((count - 1).bit_length()):
        expected = {(k, k | 1 << bit) for k in range(count) if not k >> bit & 1}
        if len(pairs) > 1 and {pair for pair in expected if pair[1] < count} <= set(pairs):
            found.append(bit)
    return found


def which_are_one(steps: np.ndarray, noise: float, cells: np.ndarray) -> Finding | None:
    """Return which of `equal_lines` are one, a fault if half of all are; None: there are none."""
    found = equal_lines(steps, noise, cells)
    for axis, count in enumerate(steps.shape):
        if bits := address_bits([(a, b) for at, a, b in found if at == axis], count):
            of = lines(axis, 0, *(1 << bit for bit in bits))
            return Finding(Kind.DOUBLED, "address bits", severity=Severity.FAULT, **of)
    return Finding(Kind.DOUBLED, "live", **lines(*found[0])) if found else None


def one_voltage(mean: np.ndarray, frames: int, noise: float, circuit: Circuit) -> Finding | None:
    """Return that a second of rest shows no matrix; None: its cells differ.

    Args:
        mean: (rows, cols) of so many frames, ADC ratio.
        noise: of a reading [ADC steps].
    """
    cells, n = circuit.populated, np.count_nonzero(circuit.populated)
    if n == 1:  # there is nothing to compare it with
        return None
    half = 0.5 * (n - 1)
    by_chance = _LOW_PASS * (gammainccinv(half, _CHANCE) / half) ** 0.5
    at_most = max(_CHANNELS, by_chance * noise / frames**0.5)
    spread = float(mean[cells].std()) * circuit.full_scale
    expected = _fabric_spread(mean, circuit)
    numbers = {"steps": float(mean[cells].mean()) * circuit.full_scale}
    if spread > at_most:
        even = min(_EVEN, (gammaincinv(half, _CHANCE) / half) ** 0.5)
        if not spread < even * expected < np.inf:
            return None
        numbers |= {"spread": spread, "expected": expected}
        return Finding(Kind.NO_SIGNAL, "even", severity=Severity.FAULT, numbers=numbers)
    if numbers["steps"] < LEAST_STEPS:  # whatever presses there would look like all that there is
        return Finding(Kind.NO_SIGNAL, "offset", severity=Severity.FAULT, numbers=numbers)
    severity = Severity.FAULT if expected > _CHANNELS else Severity.WARN
    return Finding(Kind.NO_SIGNAL, severity=severity, numbers=numbers)


def _fabric_spread(mean: np.ndarray, circuit: Circuit) -> float:
    """Return the RMS by which cells of a good fabric that reads so on average differ [ADC steps].

    Those of a megohm differ by less than channels do.
    """
    cells = circuit.populated
    usual = usual_resistance(mean, cells, circuit)
    if not 0.0 < usual < np.inf:
        return np.inf
    scatter = np.random.default_rng(0).standard_normal(mean.shape)
    adc = forward(circuit, usual * np.exp(_LEAST_SCATTER * scatter))
    return float(adc[cells].std()) * circuit.full_scale


def open_up_to(circuit: Circuit, curve: PressureCurve, floor: float = 0.0) -> float:
    """Return the ADC ratio of a cell that hardly anything touches, if the fabric may rest open.

    It may where untouched cells read about 0 by the curve: no zero shows an offset then. 0: they
    conduct, or the ADC hides a touch.

    Args:
        floor: ADC ratio below which the ADC reads 0.
    """
    reads = forward(circuit, np.full(circuit.shape, curve.points[0][1]))[circuit.populated]
    if np.median(reads) >= max(LEAST_STEPS / circuit.full_scale, _ABOUT_0):
        return 0.0
    touched = float(circuit.ratio(float(curve.resistance(AT_REST))))
    return touched if floor < touched else 0.0


def odd_cell(
    conducts: np.ndarray, cells: np.ndarray, curve: PressureCurve, step: float = 0.0
) -> Finding | None:
    """Return a cell that bears a load or has no contact, or one that only conducts more.

    The form of the first two is `NO_REST`.

    Args:
        conducts: (rows, cols) of each cell [S].
        cells: (rows, cols) bool, those that exist.
        curve: of the fabric, which says what a load adds.
        step: what an ADC step stands for, over the usual cell's conductance.
    """
    usual = float(np.median(conducts[cells]))
    times = np.where(cells, conducts / usual, 1.0)
    usually = float(np.median(np.abs(np.log(np.maximum(times, _OPEN)))[cells]))
    # what reads little conducts up to a step more
    off = np.abs(np.log(np.maximum(times + np.where(times < 1.0, step, 0.0), _OPEN)))
    unlike = off > max(np.log(UNLIKE), _MOST_DEVIATIONS * usually)
    bears = curve.force(1.0 / (usual * np.maximum(times, _OPEN))) - curve.force(1.0 / usual)
    loaded = np.where(unlike, bears, 0.0).max() > RESTS
    if (
        loaded
        or np.maximum(bears, 0.0)[cells].mean() > _UNEVEN
        or _lies(times, cells, curve, usual)
    ):
        most = bears.argmax()
        numbers = {"times": times.flat[most], "force": bears.flat[most]}
        return Finding(Kind.STUCK, NO_REST, **largest(bears), numbers=numbers)
    if not unlike.any():
        return None
    numbers = {"times": times.flat[off.argmax()]}
    if numbers["times"] < 1.0:
        return Finding(Kind.DEAD, NO_REST, **largest(off), numbers=numbers)
    return Finding(Kind.STUCK, "unlike", **largest(off), numbers=numbers)


def _lies(times: np.ndarray, cells: np.ndarray, curve: PressureCurve, usual: float) -> bool:
    """Whether neighbouring cells conduct more by what a light touch adds, and more alike.

    What lies on a skin does so; cells of an uneven fabric differ from those on both sides, too.
    """
    if min(times.shape) < _PATCH:
        return False
    change = np.log(np.maximum(times, _OPEN))
    bends = [
        np.diff(turned, 2, axis=0)[there[2:] & there[1:-1] & there[:-2]]
        for turned, there in ((change, cells), (change.T, cells.T))
    ]
    scatter = float(np.median(np.abs(np.concatenate(bends)))) / (MAD * 6**0.5)
    many, total = (
        uniform_filter(of * cells, _PATCH, mode="constant") * _PATCH**2
        for of in (np.ones(cells.shape), change)
    )
    many = np.maximum(many, 1.0)
    least = float(np.quantile(change[cells], _CALMEST)) + _QUARTILE * scatter
    at_rest = float(curve.force(np.exp(-least) / usual))
    touch = np.log(curve.resistance(at_rest) / curve.resistance(at_rest + AT_REST))
    most = np.maximum(touch, _DEVIATIONS * scatter / np.sqrt(many))
    return bool((cells & (total / many - least > most)).any())


def weak_line(change: np.ndarray, cells: np.ndarray, *, first: bool) -> Finding | None:
    """Return a line whose lead breaks: a resistance before it, which hides most of a push.

    Fabric scatters cell by cell, or changes as a whole; all of a line are off because of the
    circuit. Later it must have fallen both by itself and against the others: where a palm lay,
    cells conduct more for a while.

    Args:
        change: (rows, cols) log of each cell's conductance over the curve's, or the first one.
        first: whether it is the first that is measured.
    """
    form, most = ("rest", _MAX_LINE_OFFSET) if first else ("fading", LINE_FALL)
    common = np.median(change[cells])
    deviation = np.median(np.abs(change[cells] - common))
    for axis, across in ((0, 1), (1, 0)):
        median = np.ma.median(np.ma.array(change, mask=~cells), axis=across).filled(common)
        off = median - common
        fall = -np.abs(off) if first else np.maximum(median, off)
        fall += _MOST_DEVIATIONS * deviation / np.maximum(cells.sum(across), 1) ** 0.5
        worst = int(fall.argmin())
        if fall[worst] < -most:
            numbers = {"share": float(np.expm1(off[worst]))}
            return Finding(Kind.LEAD, form, **lines(axis, worst), numbers=numbers)
    return None
