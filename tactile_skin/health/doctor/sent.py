# SPDX-License-Identifier: Apache-2.0
"""Whether a recording holds what an ADC reads, of a matrix that is connected."""

from __future__ import annotations

import numpy as np

from ...calibration.rest import NOISY
from ...calibration.touched import MOVED
from ...findings.finding import Finding, Kind
from ...readings.multiplied import Multiplied
from ...readings.processed import AT_END
from ...readings.processed import Kind as Done
from ...readings.processed import processed as processing
from .recorded import Recorded

_MOST_NOISE = 0.01  # of full scale: what moves more is no noise
DECIMALS = 2  # of ADC steps, which ratios of single precision keep


def processed(seen: Recorded) -> Finding | None:
    """Return what was done to the readings, whatever polarity is configured; None: none shows."""
    cells = seen.steps[:, seen.cells].astype(float)
    for steps in (cells, seen.circuit.full_scale - cells):
        # a threshold, below which a reading is what an offset makes of 0
        for shift, kinds in ((0.0, set(Done) - {Done.CEILING}), (steps.min(), {Done.THRESHOLD})):
            done = processing(np.round(steps - shift, DECIMALS), seen.circuit.adc_bits)
            if done and done.kind in kinds:
                return Finding(Kind.ZEROS, detail=str(done))
    numbers = Multiplied(seen.circuit.shape, seen.circuit.adc_bits)
    for picture in seen.steps:
        numbers.frame(picture)
    return Finding(Kind.ZEROS, "multiplied") if numbers.found else None


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
