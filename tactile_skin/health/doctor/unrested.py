# SPDX-License-Identifier: Apache-2.0
"""Whether a recording shows the skin at rest; if not, little can be said of it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from ...calibration.rest import NOISY, resting_conductance
from ...findings.finding import Finding, Kind, at
from .order import equal_lines
from .readings import SEVERAL_CELLS
from .recorded import Recorded

# A load that stands: cells that conduct so many times as much as the usual one, at least so many in
# one piece of several rows and columns, and no more than this share of a line: that is a bad line.
_LOADED = 1.6
_PIECE = 4
_OF_A_LINE = 0.9


def unrested(seen: Recorded) -> Finding | None:
    """Return that the calmest frames are none of an untouched skin; None: they may be."""
    cells = seen.without(seen.cells, seen.loose)
    # Noise changes as much from frame to frame as in all, and so does a bad contact.
    moving = cells & (seen.noise > NOISY * seen.flicker + 1.0)
    if np.count_nonzero(moving) >= SEVERAL_CELLS:
        numbers = {"count": np.count_nonzero(moving), "cells": np.count_nonzero(cells)}
        return Finding(Kind.TOO_LITTLE_SEEN, "moves", numbers=numbers)
    alike = [(axis, k) for axis, *pair in equal_lines(seen, ()) for k in pair]
    standing = _standing(seen, seen.without(cells, alike))  # touching stripes seem loaded
    if not standing.any():
        return None
    middle, numbers = at(np.argwhere(standing).mean(0)), {"count": np.count_nonzero(standing)}
    return Finding(Kind.TOO_LITTLE_SEEN, "lies", **middle, numbers=numbers)


def _standing(seen: Recorded, cells: np.ndarray) -> np.ndarray:
    """Return (rows, cols) bool: the largest load that is there while least touches the skin."""
    circuit, none = seen.circuit, np.zeros(cells.shape, bool)
    if not cells.any():
        return none
    try:
        g = resting_conductance(seen.base / circuit.full_scale, circuit, seen.usual_noise)
    except ValueError:  # no skin rests so: wires, or what is configured, are wrong
        return none
    pieces, n = label(cells & (g > _LOADED * np.median(g[cells])))
    best = none
    for k in range(1, n + 1):
        piece = pieces == k
        spans = min(np.count_nonzero(piece.any(axis)) for axis in (0, 1))
        fills = max(piece.mean(axis).max() for axis in (0, 1))
        if spans > 1 and fills <= _OF_A_LINE and piece.sum() >= max(_PIECE, best.sum() + 1):
            best = piece
    return best
