# SPDX-License-Identifier: Apache-2.0
"""The most that each cell of a picture may feel, given what is not known of its skin.

A reading is that of R_felt [ohm] if circuit and curve are as they were entered. With h ohm more in
series, of which n cells of the touch share the current, the cell has R_felt - h n. If the converter
reads only a share s of the ratio (supply, full scale, r_ref), all that lies in a reading's path,
S + R_felt, is as much larger than it is: the cell has s R_felt - (1 - s) S n. Together
    R = s R_felt - ((1 - s) S + s h) n,
and the force is that of the curve there, times the factor to which newtons are proved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from .touched import AT_REST

# What a driver and two multiplexers have in series, at most [ohm]: the paper's two 74HD4067 have
# 326, two CD4051 250 at 5 V, and all parts scatter by 20 %.
PARTS = 400.0
ONE_IN_TWENTY = 1.64  # standard deviations beyond which one cell in twenty lies
# Times what the curve says that a fabric of its kind conducts at rest, at least: those of the
# laboratory's unknown boards are 0.74 to 1.35. What conducts less may be read on another scale.
_USUAL = 0.7
# Times what is felt that a force counts at most as long as the skin rests as the curve says: then
# touches of less than a quarter of the limit never stop a robot.
_MOST = 3.5
# The same of one cell, by the circuit alone: a fingertip of 4 N on a board without
# multiplexers does not stop it before touches have shown that nothing is in series.
_MOST_PEAK = 2.0


class Unknown(NamedTuple):
    """What is not known of a skin.

    Attributes:
        series: by how much what lies in series may exceed the circuit's [ohm].
        scale: share of the true ratio that readings may be, at least, by how the skin rests.
        factor: times what the curve says that a force may be.
        proved: whether an absolute force was ever seen.
    """

    series: float = 0.0
    scale: float = 1.0
    factor: float = 1.0
    proved: bool = True


def scale_at_rest(circuit: Circuit, curve: PressureCurve) -> float:
    """Return the share of the true ratio that readings may be, by what the skin reads at rest.

    It is 1 for a skin that rests about as its curve says: with less the usual cell conducts less,
    as a supply, a full scale or an r_ref does that is entered too large.

    Args:
        curve: with the rest that was measured with this circuit.
    """
    cells = circuit.populated
    rest = np.broadcast_to(curve.rest_resistance, circuit.shape)[cells]
    expected, product = curve.points[0][1], circuit.readout_class.product(circuit)
    series = circuit.readout_class.in_series(circuit)
    found = float(np.median(rest))
    if not found * _USUAL > expected:
        return 1.0
    return (expected * product + series) / (found * product + series)


def upper_bound(
    force: np.ndarray,
    std: np.ndarray | None,
    circuit: Circuit,
    curve: PressureCurve,
    unknown: Unknown,
) -> np.ndarray:
    """Return (rows, cols, 2) the most that each cell may feel [N]: by the circuit, and in all.

    Args:
        force: (rows, cols) felt [N].
        std: (rows, cols) of cells that were not read, 0 elsewhere [N]; None: all were read.
        curve: of this skin, with its rest.
    """
    peak = float(force.max())
    if not 0.0 < peak < np.inf:
        return np.stack([force, force], -1)
    by_circuit, readout = force, circuit.readout_class
    s, series = unknown.scale, unknown.series
    if s < 1.0 or series > 0.0:
        ohm = curve.resistance(force)
        sharing = readout.sharing(circuit, max(float(force.sum()) / peak, 1.0), ohm)
        hidden = ((1.0 - s) * readout.in_series(circuit) + s * series) * sharing
        least = curve.least_resistance
        by_circuit = np.maximum(curve.force(np.maximum(s * ohm - hidden, least)), force)
        by_circuit = np.where(force > 0.0, by_circuit, 0.0)
    not_read = force
    if std is not None:
        not_read = np.where(force > AT_REST, force + ONE_IN_TWENTY * std, force)
        by_circuit = np.maximum(by_circuit, not_read)
    in_all = unknown.factor * by_circuit
    if not unknown.proved and s == 1.0:
        in_all = np.maximum(np.minimum(in_all, _MOST * force), not_read)
        by_circuit = np.maximum(np.minimum(by_circuit, _MOST_PEAK * force), not_read)
    return np.stack([by_circuit, in_all], -1)
