# SPDX-License-Identifier: Apache-2.0
"""Names of the arrays' types, and arrays that nobody may change."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]
Value = TypeVar("Value", float, Floats)  # a number gives a number, an array an array
Array = TypeVar("Array", Floats, Bools)


def frozen(array: Array) -> Array:
    """Return the same array, read-only from now on."""
    array.setflags(write=False)
    return array
