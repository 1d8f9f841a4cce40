# SPDX-License-Identifier: Apache-2.0
"""How a matrix is read: from the conductances of a frame to its readings and their derivatives.

    floating.py        one row is driven, one column is read, all other lines are open
    loaded.py          one row is driven, each column has its own r_ref, other rows are open
    grounded.py        the same, other rows are at 0 V, all rows behind r_drive
    virtual_ground.py  one row is driven, an amplifier holds each column at 0 V
    readout.py         what all of them answer         driven.py    what the middle two share

In the last three rows and columns may change places. What differs between readouts stands in their
classes, and nobody else asks which one it is. A fifth readout is a file here, its place in `_ALL`,
and a line in tests/physics/test_readouts.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..arrays import Floats
from .floating import Floating
from .grounded import Grounded
from .loaded import Loaded
from .readout import BOUND as BOUND
from .readout import Readout as Readout
from .virtual_ground import VirtualGround

if TYPE_CHECKING:
    from ..circuit import Circuit

_ALL: tuple[type[Readout], ...] = Floating, Loaded, Grounded, VirtualGround
BY_NAME = {readout.name: readout for readout in _ALL}
READOUTS = tuple(BY_NAME)
PASSIVE = tuple(readout.name for readout in _ALL if readout.passive)
DRIVEN = "rows", "columns"


def solve(circuit: Circuit, g: Floats, derivatives: bool = True) -> Readout:
    """Return the network of cells g (rows, cols) [S]: see `Readout`."""
    return circuit.readout_class(circuit, g, derivatives)


def apparent(circuit: Circuit, adc: Floats) -> tuple[Floats | float, float]:
    """Return `Readout.apparent` of the circuit's readout."""
    return circuit.readout_class.apparent(circuit, adc)
