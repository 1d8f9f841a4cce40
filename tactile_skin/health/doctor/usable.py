# SPDX-License-Identifier: Apache-2.0
"""Whether a recording can be judged: it holds what an ADC reads, of a matrix, and its rest."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from ...calibration.rest import NOISY, resting_conductance
from ...calibration.touched import MOVED
from ...findings.finding import Finding, Kind, at
from ...readings.processed import AT_END, Done
from ...readings.processed import processed as processing
from .order import equal_lines
from .readings import SEVERAL_CELLS
from .recorded import Recorded

_MOST_NOISE = 0.01  # of full scale: what moves more is no noise
# Share of all change that falls below the usual reading, up to which a board rests: sound floating
# and loaded boards had 0.005 at most (seeds 50000, 61000), such with feet that walk 0.5 to 0.88.
HARDLY_FALLS = 0.2
DECIMALS = 2  # of ADC steps, which ratios of single precision keep
# A load that stands: cells that conduct so many times as much as the usual one, at least so many in
# one piece of several rows and columns, and no more than this share of a line: that is a bad line.
_LOADED = 1.6
_PIECE = 4
_OF_A_LINE = 0.9


def processed(seen: Recorded, opens: float) -> Finding | None:
    """Return what was done to the readings, whatever polarity is configured; None: none shows.

    opens: as of `readings.processed`.
    """
    cells = seen.steps[:, seen.cells].astype(float)
    for steps in (cells, seen.circuit.full_scale - cells):
        # a threshold, below which a reading is what an offset makes of 0
        for shift, kinds in ((0.0, set(Done) - {Done.CEILING}), (steps.min(), {Done.THRESHOLD})):
            values = np.round(steps - shift, DECIMALS)
            done = processing(values, seen.circuit.adc_bits, opens=opens)
            if done and done.kind in kinds:
                return Finding(Kind.ZEROS, detail=str(done))
    return None


def at_an_end(seen: Recorded) -> Finding | None:
    """Return that readings stay at an end, as of an offset or a limit; None: they do not."""
    steps = np.rint(seen.steps[:, seen.cells])
    for end in (0.0, float(seen.circuit.full_scale)):
        at_end = steps == end
        if np.median(at_end.mean(0)) > AT_END:
            numbers = {"share": float(at_end.mean()), "steps": end}
            return Finding(Kind.ZEROS, "at an end", numbers=numbers)
    return None


def one_voltage(seen: Recorded) -> Finding | None:
    """Return that all cells read one voltage throughout; None: they do not."""
    level, noise = seen.base[seen.cells], seen.usual_noise
    noise = min(noise, _MOST_NOISE * seen.circuit.full_scale)
    moves = float(np.ptp(seen.steps[:, seen.cells], axis=0).max())
    if moves > 2.0 * MOVED * noise or level.std() > NOISY * noise:
        return None
    numbers = {"steps": float(level.mean()), "moves": moves}
    return Finding(Kind.NO_SIGNAL, "throughout", numbers=numbers)


def unrested(seen: Recorded) -> Finding | None:
    """Return that the calmest frames are none of an untouched skin; None: they may be."""
    cells = seen.without(seen.cells, seen.loose)
    # Noise changes as much from frame to frame as in all, and so does a bad contact.
    moving = cells & (seen.noise > NOISY * seen.flicker + 1.0)
    if np.count_nonzero(moving) >= SEVERAL_CELLS:
        return _never_left_alone(moving, cells)
    alike = [(axis, k) for axis, *pair in equal_lines(seen, ()) for k in pair]
    standing = _standing(seen, seen.without(cells, alike))  # touching stripes seem loaded
    if standing.any():
        middle, numbers = at(np.argwhere(standing).mean(0)), {"count": np.count_nonzero(standing)}
        return Finding(Kind.TOO_LITTLE_SEEN, "lies", **middle, numbers=numbers)
    if seen.circuit.readout_class.shares_sum:  # a touch lowers what its line's other cells read
        return None
    left = cells & (seen.steps.min(0) < seen.base - seen.width)  # a load that stands at times
    if seen.fell > HARDLY_FALLS and np.count_nonzero(left) >= SEVERAL_CELLS:
        return _never_left_alone(left, cells)
    return None


def _never_left_alone(touched: np.ndarray, cells: np.ndarray) -> Finding:
    numbers = {"count": np.count_nonzero(touched), "cells": np.count_nonzero(cells)}
    return Finding(Kind.TOO_LITTLE_SEEN, "touched", numbers=numbers)


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
