"""Two lines that read the same at rest: both addresses select one, or they are shorted.

The cells of a fabric differ at rest, by 3 % and more, and with them what any two lines read. Lines
that read alike cell for cell, to the noise, while other pairs are apart, are one line. How alike
two sound ones may be by chance follows from the number of cells that they are compared by: with
four a measurement is seldom fine enough to tell. A fabric may vary smoothly: how much, the lines
across tell, which lie side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

_CHANCE = 1e-4  # of a sound skin's having such a pair
_FEWEST = 4  # cells that two lines are compared by
_SHORTEST = 2  # the same, of lines of which many pairs are compared
_ALIKE = 0.1  # squared difference over the usual one, at most
_NOISE = 3.0  # times what noise explains of a squared difference
_PAIRS = 2  # of lines, at least, that an address bit makes one
_WHOLE = 0.01, 0.3  # ADC steps off a whole one, and share of readings that may be so near to it


def twins(steps: np.ndarray, noise: float, cells: np.ndarray) -> tuple[str, int, int] | None:
    """The pair of lines that are one, as ("row" or "column", k, l); None: there is none.

    Args:
        steps: (rows, cols) mean reading of an untouched skin [ADC steps].
        noise: RMS of each [ADC steps].
        cells: (rows, cols) bool, those that exist.
    """
    for name, pairs in _sides(steps, cells, _FEWEST):
        if not pairs.differ(noise):
            continue
        apart, n = pairs.square / pairs.count, pairs.count
        most = np.minimum(pairs.alike(n), _NOISE * 2.0 * noise**2)
        k = int((apart - most).argmin())
        if apart[k] < most[k]:
            return name, int(pairs.one[k]), int(pairs.other[k])
    return None


def stuck_bits(
    steps: np.ndarray, noise: float, cells: np.ndarray
) -> tuple[str, tuple[int, ...]] | None:
    """The address bits, as ("row" or "column", bits), without which all lines are read.

    Lines that differ in these bits only read alike; together they tell more surely than each pair.
    Other lines as near to one another, or nearer, must be apart: those of a smooth fabric are not.

    Args:
        as of `twins`.
    """
    for name, pairs in _sides(steps, cells, _SHORTEST):
        if not pairs.differ(noise):
            continue
        bits, distance = pairs.one ^ pairs.other, pairs.other - pairs.one
        for mask in range((1 << int(pairs.other.max()).bit_length()) - 2, 0, -1):
            group = bits & ~mask == 0
            others = (distance <= distance[group].max(initial=0)) & ~group
            if np.count_nonzero(group) < _PAIRS or not others.any():
                continue
            n = pairs.count[group].sum()
            apart = pairs.square[group].sum() / n
            near = np.median((pairs.square / pairs.count)[others])
            most = min(pairs.alike(n), _ALIKE * near, _NOISE * 2.0 * noise**2)
            if apart < most:
                return name, tuple(k for k in range(mask.bit_length()) if mask >> k & 1)
    return None


class _Pairs(NamedTuple):
    """All pairs of rows, or of columns, that have cells to be compared by.

    Attributes:
        one, other: (pairs,) lines.
        square: (pairs,) squared differences, summed [ADC steps squared]; count: of so many.
        across: mean squared difference of neighbours along the lines [ADC steps squared].
    """

    one: np.ndarray
    other: np.ndarray
    square: np.ndarray
    count: np.ndarray
    across: float

    @property
    def usual(self) -> float:
        return float(np.median(self.square / self.count))

    def differ(self, noise: float) -> bool:
        """Whether lines differ by more than noise: those of a simulated fabric may not."""
        return self.usual * _ALIKE >= 2.0 * noise**2

    def alike(self, n):
        """Mean squared difference of n cells, below which it is no chance."""
        # the smoother the fabric, the fewer of its cells are independent of those beside them
        free = 0.5 * n * min(1.0, self.across / max(self.usual, 1e-300))
        # of normal differences the sum of n squares is chi^2, whose small values are rare
        alike = gammaincinv(free, _CHANCE / (2.0 * self.count.size)) / free
        return np.minimum(alike, _ALIKE) * self.usual


def _sides(steps: np.ndarray, cells: np.ndarray, fewest: int):
    """("row" or "column", _Pairs with so many cells or more) of both, if they can be compared."""
    near, share = _WHOLE
    if not cells.any() or np.mean(np.abs(steps - np.rint(steps))[cells] < near) > share:
        return  # rounded without noise that would average it away: many read alike
    for name, values, there in (("row", steps, cells), ("column", steps.T, cells.T)):
        one, other = np.triu_indices(len(values), 1)
        both = there[one] & there[other]  # (pairs, cells of a line)
        n = both.sum(1)
        one, other, both, n = (of[n >= fewest] for of in (one, other, both, n))
        beside = there[:, 1:] & there[:, :-1]  # of the other lines, next to one another
        if n.size and beside.any():
            square = (np.square(values[one] - values[other]) * both).sum(1)
            across = np.square(np.diff(values, axis=1))[beside].mean()
            yield name, _Pairs(one, other, square, n, float(across))


def which_are_one(steps: np.ndarray, noise: float, cells: np.ndarray) -> tuple[str, bool]:
    """What to say of lines that are one, empty if there are none; whether half or more are."""
    if found := stuck_bits(steps, noise, cells):
        name, bits = found
        which = " and ".join(map(str, bits))
        bits_are = (
            f"bits {which} of the {name}s' multiplexer are"
            if bits[1:]
            else (f"bit {which} of the {name}s' multiplexer is")
        )
        return (
            f"address {bits_are} stuck, or not connected: {name}s 0 and {1 << bits[0]} read the "
            "same, cell for cell, and so do all such lines"
        ), True
    if (found := twins(steps, noise, cells)) is None:
        return "", False
    name, one, other = found
    return (
        f"{name}s {one} and {other} read the same, cell for cell: does the multiplexer select one "
        "line twice, or are they shorted?"
    ), False
