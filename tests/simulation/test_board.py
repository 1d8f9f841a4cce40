# SPDX-License-Identifier: Apache-2.0
"""The board that can be damaged: its physics, and that each fault does what it says."""

import numpy as np
import pytest
from support import faulty
from support.faulty import SHAPE, board_of, frames, pressed
from support.kirchhoff import adc_ratio, nodal_reading
from support.lab.board import FaultBoard
from support.lab.damage import ELECTRICAL
from support.lab.parts import BadFabric

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.simulation.network import NOWHERE, Wiring, voltage_ratio


def cells(shape=SHAPE, seed=0):
    return np.random.default_rng(seed).uniform(100.0, 5000.0, shape)


def read(resistance, wiring: Wiring) -> np.ndarray:
    return voltage_ratio(1.0 / resistance[None], wiring, Circuit(*resistance.shape))[0]


def literal(resistance, wiring: Wiring) -> np.ndarray:
    """Resistance between the leads, one reading at a time: a current of 1 A in, and out."""
    rows, cols = resistance.shape
    n_rows = max(int(wiring.row_of.max()) + 1, rows)
    nodes = n_rows + max(int(wiring.col_of.max()) + 1, cols)
    branches = [
        (wiring.row_of[i, j], n_rows + wiring.col_of[i, j], 1.0 / resistance[i, j])
        for i in range(rows)
        for j in range(cols)
    ]
    branches += [(a + ka * n_rows, b + kb * n_rows, g) for ka, a, kb, b, g in wiring.ties]
    nodal = np.zeros((nodes, nodes))
    for a, b, g in branches:
        nodal[[a, b], [a, b]] += g
        nodal[[a, b], [b, a]] -= g
    rho = np.full((rows, cols), np.inf)
    for i, row in enumerate(wiring.rows):
        for j, col in enumerate(wiring.cols):
            if row == NOWHERE or col == NOWHERE:
                continue
            into = np.zeros(nodes)
            into[row], into[n_rows + col] = 1.0, -1.0
            voltage = np.zeros(nodes)  # of the last node: 0
            voltage[:-1] = np.linalg.solve(nodal[:-1, :-1], into[:-1])
            rho[i, j] = voltage[row] - voltage[n_rows + col]
    return rho + wiring.row_lead[:, None] + wiring.col_lead


# --- the truth ---


def test_a_sound_wiring_meets_the_papers_equations():
    resistance = cells()
    expected = adc_ratio(resistance, 1780.0, 326.0)
    np.testing.assert_allclose(read(resistance, Wiring.sound(*SHAPE)), expected, rtol=1e-5)


@pytest.mark.filterwarnings("ignore:Could not import `badcrossbar.plot`")
def test_leads_meet_badcrossbar():
    """Driven from both ends, its currents give the admittance between all leads."""
    badcrossbar = pytest.importorskip("badcrossbar")
    resistance, rows = cells(), SHAPE[0]

    def admittance(r):
        """Of a unit voltage on each word line, every bit line at 0 V."""
        found = badcrossbar.compute(np.eye(len(r)), r, r_i=1e-3)
        device, output = np.asarray(found.currents.device), np.asarray(found.currents.output)
        return device.sum(1), output.T  # (words, words), (bits, words)

    of_rows, rows_to_cols = admittance(resistance)
    of_cols, _ = admittance(resistance.T[::-1, ::-1])
    y = np.block([[of_rows, -rows_to_cols.T], [-rows_to_cols, of_cols[::-1, ::-1]]])
    k = np.linalg.pinv((y + y.T) / 2.0)
    expected = k.diagonal()[:rows, None] + k.diagonal()[rows:] - 2.0 * k[:rows, rows:]
    found = read(resistance, Wiring.sound(*SHAPE))
    np.testing.assert_allclose(found, Circuit(*SHAPE).ratio(expected), rtol=1e-3)


WIRES = [
    fault.name
    for fault in ELECTRICAL
    if fault.name.split()[0] in ("open", "bad", "broken", "short", "address", "swapped", "line")
]


@pytest.mark.parametrize("name", WIRES)
def test_damaged_wires_meet_a_solve_of_each_reading(name):
    board = damaged(name, SHAPE)
    resistance = cells()
    found = read(resistance, board.matrix.wiring)
    expected = Circuit(*SHAPE).ratio(literal(resistance, board.matrix.wiring))
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    sound = read(resistance, Wiring.sound(*SHAPE))
    assert not np.allclose(found, sound, rtol=1e-3)


def fault_of(name: str):
    return faulty.named(ELECTRICAL, name)


def damaged(name: str, shape=SHAPE, **kinds) -> FaultBoard:
    board = board_of(shape, **kinds)
    fault_of(name).damage(board)
    return board


def samples(name: str, seconds=0.5, **kinds) -> np.ndarray:
    return faulty.samples(fault_of(name), seconds, **kinds)


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_a_sound_board_reads_like_the_forward_model(kind):
    board = board_of(protocol=kind)
    found = frames(board, pressed(0.5))
    assert len(found) in (48, 49, 50)
    assert board.ratio(pressed(0.1))[0] == pytest.approx(
        adc_ratio(1.0 / board.matrix.fabric.conductance(pressed(0.1))[0], 1780.0, 326.0), rel=1e-5
    )
    steps = np.mean([frame.samples / 64.0 for _, frame in found[10:]], 0)
    assert np.abs(steps - board.ratio(pressed(0.1))[0] * 1023).max() < 1.0


def test_bits_ceilings_and_drifts():
    assert (samples("bit 5 stuck at 1", readout="single").astype(int) & 32 == 32).all()
    assert (samples("bit 5 stuck at 0", readout="single").astype(int) & 32 == 0).all()
    force_free = samples("saturated at 40 %", readout="single")
    assert force_free.max() <= 0.4 * 1023 + 0.5
    low, sound = samples("supply falls", 4.0)[-1], samples("open row", 4.0)[-1]
    assert (sound < 3.0).all(1).sum() == 1
    assert low.max() < 0.9 * board_of().ratio(pressed(0.1))[0].max() * 1023
    loose = samples("loose lead", 3.0, readout="single") <= 4.0
    line = loose.all(2) if loose.all(2).any() else loose.all(1)
    assert 0.1 < line.any(1).mean() < 0.9


@pytest.mark.parametrize("readout", ["loaded", "grounded", "virtual_ground"])
@pytest.mark.parametrize("driven", ["rows", "columns"])
def test_other_readouts_are_read_as_the_circuit_says(readout, driven):
    """And behind an open lead nothing is, while a lead of 1 kohm lowers its line's readings.

    Lines that touch read as a solve of each reading says.
    """
    circuit = Circuit(4, 6, r_ref=300.0, readout=readout, driven=driven)
    resistance = 10.0 ** np.random.default_rng(4).uniform(2.0, 4.5, (2, 4, 6))
    wiring = Wiring.sound(4, 6)
    sound = voltage_ratio(1.0 / resistance, wiring, circuit)
    assert sound == pytest.approx(forward(circuit, resistance), abs=2e-5)  # a driver has 1 mohm
    for lead, line in (wiring.row_lead, np.s_[:, 1]), (wiring.col_lead, np.s_[:, :, 1]):
        lead[1] = 1000.0
        led = voltage_ratio(1.0 / resistance, wiring, circuit)
        assert (led[line] < sound[line]).all()
        lead[1] = 0.0
    for axis, line in (0, 1), (1, 4 + 1):  # of rows and then columns
        wiring.ties = [(axis, 1, axis, 2, 0.05)]
        expected = [nodal_reading(ohm, circuit, (line, line + 1, 0.05)) for ohm in resistance]
        found = voltage_ratio(1.0 / resistance, wiring, circuit)
        assert found == pytest.approx(np.array(expected), abs=1e-4)
    wiring.ties = []
    wiring.rows[3] = wiring.cols[0] = NOWHERE
    cut = voltage_ratio(1.0 / resistance, wiring, circuit)
    assert (cut[:, 3] == 0.0).all() and (cut[:, :, 0] == 0.0).all() and (cut[:, 0, 1:] > 0).all()


CIRCUIT, CURVE = Circuit(4, 5), PressureCurve()


def fabric() -> BadFabric:
    return BadFabric.everyday(CIRCUIT, CURVE, np.random.default_rng(1))


def test_beyond_the_curves_end_the_fabric_goes_on_conducting_more():
    end = np.full((1, *CIRCUIT.shape), CURVE.max_force)
    cells = fabric()
    assert (cells.conductance(1.5 * end) > 1.3 * cells.conductance(end)).all()
