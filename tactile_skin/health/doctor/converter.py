# SPDX-License-Identifier: Apache-2.0
"""An ADC, or diodes in driven lines, that are not configured.

Diodes take the more the more a line carries, but not in proportion to it, as r_par does. With them
ignored each touch asks for another r_par; with them known all touches agree.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...calibration.rest import resting_conductance
from ...findings.finding import Finding, Kind
from ...physics.adc import TABLES, Adc
from ...physics.circuit import Circuit
from ...solvers.evidence import SOFT, Supposed, series_scale
from .readout import BETTER, Touched, misses
from .recorded import FEW_TOUCHES

# V at 1 mA which are tried: from Schottky diodes to silicon ones at 3.3 V. What is found is right
# to half of a step, and of another supply than `Adc.supply` the same share.
_VOLTS = np.arange(0.06, 0.96, 0.03)
# Touches agree if the r_par that each asks for scatters (in squared standard deviations), and
# differs from the configured one (as share of `series_scale`), by no more: on 8 boards (seeds 21
# and 22) by 2.3 and 0.06 at most where the diode is known, by 3.5 or 0.18 at least where it is not.
_AGREE = 3.0
_OFF = 0.1
_R_PAR_STEPS = 3  # to the r_par that touches ask for
_ALL = 0.9  # share of the touches that any diode explains, that the right one does
# Times noise and model error by which touches of a linear ADC are missed: of boards with a measured
# ESP32 (benchmarks.boards.esp32, seeds 31, 77 and 78; r_ref 1 to 10 kohm) 0.2 to 6.7, and 0.02 to
# 1.1 with its table; of linear ones with r_par or r_ref off, or an offset, 0.8 at most.
_MISSED = 1.2
_SCALES = 0.9, 1.05, 1.1, 1.2, 1.3, 1.5  # of linear ADCs whose full scale is not the supply


class _Agreement(NamedTuple):
    """What touches say together."""

    touches: int  # how many say anything
    scatter: float  # median squared distance of the r_par of each from that of all, in its variance
    off: float  # of that from the configured one, as share of `series_scale`

    @property
    def misfit(self) -> float:
        """Of both, in what is allowed; below 1: they agree."""
        if self.touches <= FEW_TOUCHES:
            return np.inf
        return max(self.scatter / _AGREE, abs(self.off) / _OFF)


def unknown_diode(circuit: Circuit, seen: Touched, quiet: int) -> list[Finding]:
    """Return the diode with which a loaded matrix's touches agree; none if they agree as it is."""
    if circuit.readout != "loaded" or not len(seen.touches):
        return []
    by_r_par = _with_r_par(circuit, seen, quiet)
    if by_r_par is None:
        return []
    tried = {
        volts: _agreement(circuit, seen.read_by(Adc(circuit, diode=volts)), quiet)
        for volts in _VOLTS
    }
    volts = min(tried, key=lambda v: tried[v].misfit)
    found = tried[volts]
    if found.misfit >= 1.0 or found.touches < _ALL * max(a.touches for a in tried.values()):
        return []
    if by_r_par.misfit < 1.0 and by_r_par.touches >= _ALL * found.touches:
        return []  # another r_par does as well, and needs no part that nobody mentioned
    share = float(volts) / Adc.supply
    numbers = {"share": share, "of_5": 5.0 * share, "of_3": 3.3 * share}
    return [Finding(Kind.CIRCUIT, "diode", numbers=numbers)]


def _with_r_par(circuit: Circuit, seen: Touched, quiet: int) -> _Agreement | None:
    """Return the touches with the r_par that they ask for; None: it is the configured one."""
    for step in range(_R_PAR_STEPS + 1):
        found = _agreement(circuit, seen, quiet)
        if found.misfit < 1.0:
            return found if step else None
        if not np.isfinite(found.off):
            break
        r_par = circuit.r_par + found.off * series_scale(circuit)
        circuit = replace(circuit, r_par=max(r_par, 0.0))
    return found


def _agreement(circuit: Circuit, seen: Touched, quiet: int) -> _Agreement:
    try:
        conductance = resting_conductance(seen.rest, circuit, seen.noise / quiet**0.5)
        supposed = Supposed(circuit, conductance, SOFT)
        each = [supposed.evidence(touch, seen.noise) for touch in seen.touches]
    except ValueError:  # no cells read so
        each = []
    told = [(e.score[0], e.information[0, 0]) for e in each if e is not None]
    if not told:
        return _Agreement(0, np.inf, np.inf)
    score, information = np.array(told).T
    shift = score.sum() / information.sum()
    scatter = np.median(np.square(score - shift * information) / information)
    return _Agreement(len(told), float(scatter), float(shift / series_scale(circuit)))


def other_adc(circuit: Circuit, seen: Touched) -> list[Finding]:
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
