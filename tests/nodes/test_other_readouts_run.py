# SPDX-License-Identifier: Apache-2.0
"""Boards with loaded and grounded lines through all nodes, from the simulated board's bytes."""

import numpy as np
import pytest
from support.chain import Chain
from support.simulated import remembering

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.simulation.simulator import SCANS_PER_SECOND, Board


def pushed(t: float) -> np.ndarray:
    """(rows, cols) [N]: 2 s of rest, then 40 N."""
    return scenes.finger(8, 10, 3.5, 4.5, 40.0 if t > 2.0 else 0.0, 1.5)


@pytest.mark.parametrize("driven", ["rows", "columns"])
@pytest.mark.parametrize("readout", ["loaded", "grounded"])
def test_a_push_stops_and_nothing_else_does(readout, driven):
    circuit = Circuit(8, 10, readout=readout, driven=driven)
    board, chain = remembering(Board(circuit, PressureCurve(), pushed)), Chain(circuit)
    free = []
    try:
        for scan in range(3 * SCANS_PER_SECOND):
            t = scan / SCANS_PER_SECOND
            if data := board.scan():
                chain.feed(t, data)
            if 1.6 < t < 2.0:
                free.append(not chain.stop)
        assert all(free), chain.reason
        assert chain.stop and "push" in chain.reason
        assert chain.force.sum() == pytest.approx(pushed(3.0).sum(), rel=0.1)
        assert chain.errors == 0
    finally:
        chain.close()
