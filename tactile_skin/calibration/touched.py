# SPDX-License-Identifier: Apache-2.0
"""What counts as touched: three levels of force, one of a reading; and when a touch stands."""

from __future__ import annotations

import numpy as np

from ..physics.curve import GRAM

AT_REST = 2.0 * GRAM  # N: what conducts more is no rest, and is not taken for one
# N by the curve that a cell of a skin at rest bears at most: `cell_threshold`, below which no
# contact is found, as it is shipped.
RESTS = 0.2
TOUCHED = 15.0 * GRAM  # N: a touch; lines that are shorted at rest read as 13 g
# N on so many cells: a touch that begins, not noise
STIRRED = 1.0 * GRAM
STIRRED_CELLS = 3
# Times its noise by which a reading has changed: noise exceeds 6 standard deviations once in 5e8
# readings, a recording has 1e7; what drifts in a minute, and noise itself, are not known better.
MOVED = 8.0
# Times the noise, RMS: by which a frame may differ from the one before, since a touch that moves is
# read row by row; and by which it differs from the last that was asked.
_STANDS = 2.5
_NEW = 4.0


def stands_anew(adc, before, last, noise: float) -> bool:
    """Whether a touch stands, and is another one than the last that was asked.

    Args:
        adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
        before: a frame shortly before it.
        last: the last that was asked; None: there is none.
        noise: RMS of a reading, as ADC ratio.
    """
    stands = _rms(adc - before) <= _STANDS * noise
    return stands and (last is None or _rms(adc - last) > _NEW * noise)


def _rms(values: np.ndarray) -> float:
    return float(np.nan_to_num(np.square(values)).mean() ** 0.5)
