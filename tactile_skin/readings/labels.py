# SPDX-License-Identifier: Apache-2.0
"""Whether numbers that stand next to readings are names of something, as the class of a picture."""

from __future__ import annotations

import numpy as np

_BELOW = 4.0  # times that cells read at least what a name of something reaches


def reads_below(numbers: np.ndarray, level: float) -> bool:
    """Return whether a column of numbers stays so far below cells that read `level` at least."""
    return bool(_BELOW * numbers.max() < level)
