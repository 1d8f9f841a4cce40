# SPDX-License-Identifier: Apache-2.0
"""Whether the readings are those of a converter that is not linear, whose table is shipped."""

from __future__ import annotations

import numpy as np

from ...findings.finding import Finding, Kind
from ...physics.adc import TABLES, Adc
from ...physics.circuit import Circuit
from .readout import BETTER, Touched, misses

# Times noise and model error by which touches of a linear ADC are missed: of boards with a measured
# ESP32 (benchmarks.boards.esp32, seeds 31, 77 and 78; r_ref 1 to 10 kohm) 0.2 to 6.7, and 0.02 to
# 1.1 with its table; of linear ones with r_par or r_ref off, or an offset, 0.8 at most.
_MISSED = 1.2
_SCALES = 0.9, 1.05, 1.1, 1.2, 1.3, 1.5  # of linear ADCs whose full scale is not the supply


def other(circuit: Circuit, seen: Touched) -> list[Finding]:
    """Return the table that explains touches which a linear ADC does not; none if none does."""
    if not len(seen.touches) or (own := misses(circuit, seen)) <= _MISSED:
        return []
    left, name = min((_missed(Adc(circuit, table=name), seen), name) for name in TABLES)
    if not left < min(_MISSED, BETTER * own):
        return []
    scales = (Adc(circuit, full_scale=scale * circuit.full_scale) for scale in _SCALES)
    alone = left < BETTER * min(_missed(adc, seen) for adc in scales)
    numbers = {"supposed": own, "left": left}
    form = "adc" if alone else "adc or supply"
    return [Finding(Kind.CIRCUIT, form, numbers=numbers, detail=name)]


def _missed(adc: Adc, seen: Touched) -> float:
    """`misses` of touches that this ADC has read."""
    rest, noise, touches = seen.read_by(adc)
    return misses(adc.circuit, Touched(rest, noise, np.where(adc.bounds(touches), np.nan, touches)))
