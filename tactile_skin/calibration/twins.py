"""Two lines that read the same at rest: both addresses select one, or they are shorted.

The cells of a fabric differ at rest, by 3 % and more, and with them what any two lines read. Lines
that read alike cell for cell, to the noise, while other pairs are apart, are one line. How alike
two sound ones may be by chance follows from the number of cells that they are compared by: with
four a measurement is seldom fine enough to tell. A fabric may vary smoothly: how much, the lines
across tell, which lie side by side.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincinv

_CHANCE = 1e-4  # of a sound skin's having such a pair
_FEWEST = 4  # cells that two lines are compared by
_ALIKE = 0.1  # squared difference over the usual one, at most
_NOISE = 3.0  # times what noise explains of a squared difference
_WHOLE = 0.01, 0.3  # ADC steps off a whole one, and share of readings that may be so near to it


def twins(steps: np.ndarray, noise: float, cells: np.ndarray) -> tuple[str, int, int] | None:
    """The pair of lines that are one, as ("row" or "column", k, l); None: there is none.

    Args:
        steps: (rows, cols) mean reading of an untouched skin [ADC steps].
        noise: RMS of each [ADC steps].
        cells: (rows, cols) bool, those that exist.
    """
    near, share = _WHOLE
    if np.mean(np.abs(steps - np.rint(steps))[cells] < near) > share:
        return None  # rounded without noise that would average it away: many read alike
    sides = ("row", steps, cells), ("column", steps.T, cells.T)
    for name, values, there in sides:
        one, other = np.triu_indices(len(values), 1)
        both = there[one] & there[other]  # (pairs, cells of a line)
        n = both.sum(1)
        one, other, both, n = (of[n >= _FEWEST] for of in (one, other, both, n))
        beside = there[:, 1:] & there[:, :-1]  # of the other lines, next to one another
        if not n.size or not beside.any():
            continue
        apart = (np.square(values[one] - values[other]) * both).sum(1) / n
        usual = np.median(apart)
        if usual * _ALIKE < 2.0 * noise**2:
            continue  # noise is all that they differ by: a simulated fabric
        # the smoother the fabric, the fewer of its cells are independent of those beside them
        across = np.square(np.diff(values, axis=1))[beside].mean()
        free = 0.5 * n * min(1.0, across / max(usual, 1e-300))
        # of normal differences the sum of n squares is chi^2, whose small values are rare
        alike = gammaincinv(free, _CHANCE / (2.0 * n.size)) / free
        most = np.minimum(np.minimum(alike, _ALIKE) * usual, _NOISE * 2.0 * noise**2)
        k = int((apart - most).argmin())
        if apart[k] < most[k]:
            return name, int(one[k]), int(other[k])
    return None
