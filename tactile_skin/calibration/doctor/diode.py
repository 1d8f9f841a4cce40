"""Diodes in the driven lines of a loaded matrix that the configuration does not know.

They take the more the more a line carries, but not in proportion to it, as r_par does. With them
ignored each touch asks for another r_par; with them known all touches agree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...physics.adc import Adc
from ...physics.circuit import Circuit
from ...solvers.score import series_scale
from ..evidence import SOFT, Supposed
from ..rest import Rest, resting_conductance
from .readout import Touched

# V at 1 mA, and V of the supply: usual diodes, silicon and Schottky. Others are near one of them.
USUAL = tuple((volts, supply) for supply in (5.0, 3.3) for volts in (0.58, 0.55, 0.3, 0.25, 0.22))
# Touches agree if the r_par that each asks for scatters (in squared standard deviations), and
# differs from the configured one (as share of `series_scale`), by no more: on 8 boards (seeds 21
# and 22) by 2.3 and 0.06 at most where the diode is known, by 3.5 or 0.18 at least where it is not.
_AGREE, _OFF = 3.0, 0.1
_FEWEST = 6  # touches; with 8 one of five boards of 8 x 8 (seeds 51 to 57) was not told


class Agreement(NamedTuple):
    """What touches say together.

    Attributes:
        touches: how many say anything.
        scatter: median squared distance of the r_par of each from that of all, in its variance.
        off: of that from the configured one, as share of `series_scale`.
    """

    touches: int
    scatter: float
    off: float

    @property
    def good(self) -> bool:
        return self.touches >= _FEWEST and self.scatter < _AGREE and abs(self.off) < _OFF


def unknown_diode(circuit: Circuit, seen: Touched, quiet: int) -> tuple[float, float] | None:
    """Volts at 1 mA and of the supply of a diode with which the touches agree; None: there is none.

    Args:
        quiet: frames that the rest is the mean of.
    """
    own = _agreement(circuit, seen, quiet)
    if own.good:
        return None
    found = []
    for volts, supply in USUAL:
        adc = Adc(circuit, diode=volts, supply=supply)
        rest, touches = (adc.ratio(p * circuit.full_scale) for p in (seen.rest, seen.touches))
        other = _agreement(circuit, Touched(rest, seen.noise, touches), quiet)
        if other.good and other.touches >= own.touches:
            found.append((abs(other.off), (volts, supply)))
    return min(found)[1] if found else None


def _agreement(circuit: Circuit, seen: Touched, quiet: int) -> Agreement:
    noise = max(seen.noise, 0.3)
    try:
        conductance = resting_conductance(seen.rest, circuit, noise / quiet**0.5)
        supposed = Supposed(circuit, Rest(seen.rest, noise, quiet, conductance), SOFT)
        each = [supposed.evidence(touch, noise) for touch in seen.touches]
    except ValueError:  # no cells read so
        return Agreement(0, np.inf, np.inf)
    told = [(e.score[0], e.information[0, 0]) for e in each if e is not None]
    if not told:
        return Agreement(0, np.inf, np.inf)
    score, information = np.array(told).T
    shift = score.sum() / information.sum()
    scatter = np.median(np.square(score - shift * information) / information)
    return Agreement(len(told), float(scatter), float(shift / series_scale(circuit)))
