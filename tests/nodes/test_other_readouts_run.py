# SPDX-License-Identifier: Apache-2.0
"""Boards of each readout through all nodes, from their bytes: a push stops, also where readings
are at the converter's end or lost in its steps, and nothing else does.
"""

import numpy as np
import pytest
from support.chain import Chain
from support.simulated import remembering
from support.strangers import boards
from support.strangers.sim import counts, fabric, finger

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.simulation.simulator import SCANS_PER_SECOND, Board

RATE = 20.0  # frames a second, as text
PALM, FINGER = (45.0, 1.1), (8.0, 0.8)  # N, cells


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


def stopped(circuit: Circuit, force: float, width: float, seed: int) -> np.ndarray:
    """Return whether each decision is a stop, from 0.3 s after the touch began to 1.5 s."""
    curve, rng = fabric(circuit, seed=seed), np.random.default_rng(seed)
    middle = (circuit.rows - 1) / 2, (circuit.cols - 1) / 2
    touch = finger(circuit.shape, *middle, force, width)
    chain = Chain(circuit, "text", {"stop_on_push": {"debounce": 0.01, "lead": 0.0}})
    decisions = []
    for k in range(int(6.5 * RATE)):
        pressed = k >= 5.0 * RATE
        steps = counts(circuit, curve, touch if pressed else 0.0 * touch, rng)
        chain.feed(k / RATE + 0.1, boards.sent(boards.TEXT["frame_a_line"], steps[None], k))
        if k >= 5.3 * RATE:
            decisions.append(chain.stop)
    assert not chain.errors
    chain.close()
    return np.array(decisions)


@pytest.mark.parametrize(
    ("readout", "r_ref"),
    [("floating", 1e6), ("grounded", 47e3), ("virtual_ground", 1780.0), ("loaded", 1e6)],
)
def test_a_palm_at_the_end_of_the_range_stops(readout, r_ref):
    assert stopped(Circuit(8, 8, r_ref=r_ref, r_par=70.0, readout=readout), *PALM, seed=31).all()


@pytest.mark.parametrize(
    ("readout", "r_ref"),
    [("floating", 1780.0), ("floating", 47e3), ("loaded", 47e3), ("grounded", 500.0)],
)
def test_a_finger_that_is_read_well_does_not(readout, r_ref):
    circuit = Circuit(8, 8, r_ref=r_ref, r_par=70.0, readout=readout)
    assert not stopped(circuit, *FINGER, seed=31).any()
