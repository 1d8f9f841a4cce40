"""Whether the readings are those of a converter that is not linear, whose table is shipped."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...physics.adc import TABLES, Adc
from ...physics.circuit import Circuit
from .readout import Touched, misses

# Times noise and model error by which touches of a linear ADC are missed: of boards with a measured
# ESP32 (benchmarks.boards.esp32, seeds 31, 77 and 78; r_ref 1 to 10 kohm) 0.2 to 6.7, and 0.02 to
# 1.1 with its table; of linear ones with r_par or r_ref off, or an offset, 0.8 at most.
_MISSED = 1.2
_MET = 1.1  # the same, of a table that explains them
_BETTER = 0.5  # times what a linear ADC misses
_SCALES = 0.9, 1.05, 1.1, 1.2, 1.3, 1.5  # of linear ADCs whose full scale is not the supply


class Converter(NamedTuple):
    """A table that explains touches which the ADC as it is configured does not.

    Attributes:
        name: of `TABLES`.
        left, supposed: times noise and model error by which it, and a linear ADC, miss them.
        alone: whether no other full scale of a linear ADC explains them as well.
    """

    name: str
    left: float
    supposed: float
    alone: bool


def other(circuit: Circuit, seen: Touched) -> Converter | None:
    """Return the table that explains the touches; None: a linear ADC does, or no table."""
    if not len(seen.touches) or (own := misses(circuit, seen)) <= _MISSED:
        return None
    found = min((_missed(Adc(circuit, table=name), seen), name) for name in TABLES)
    if not found[0] < min(_MET, _BETTER * own):
        return None
    scales = (Adc(circuit, full_scale=scale * circuit.full_scale) for scale in _SCALES)
    linear = min(_missed(adc, seen) for adc in scales)
    return Converter(found[1], found[0], own, found[0] < _BETTER * linear)


def _missed(adc: Adc, seen: Touched) -> float:
    """`misses` of what a linear ADC was supposed to have read, if this one has."""
    rest, touches = (adc.ratio(p * adc.circuit.full_scale) for p in (seen.rest, seen.touches))
    touches = np.where(adc.bounds(touches), np.nan, touches)
    return misses(adc.circuit, Touched(rest, seen.noise, touches))
