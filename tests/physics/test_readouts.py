# SPDX-License-Identifier: Apache-2.0
"""The loaded and the grounded readout: the literal network, and derivatives by differences."""

from dataclasses import replace

import numpy as np
import pytest
from support.kirchhoff import nodal_reading

from tactile_skin import Circuit, forward
from tactile_skin.physics import readouts
from tactile_skin.physics.circuit import circuit_from

IDEAL = [("grounded", "rows"), ("grounded", "columns")]
HELD = [("grounded", "rows", "40"), ("grounded", "columns", "0.3")]  # r_drive [ohm]
KINDS = [("loaded", "rows"), ("loaded", "columns"), *IDEAL, *HELD]
ALL = [("floating", "rows"), ("virtual_ground", "rows"), ("virtual_ground", "columns"), *KINDS]


def skin(rows, cols, kind, **others) -> Circuit:
    readout, driven, *r_drive = kind
    others["r_drive"] = float(r_drive[0]) if r_drive else 0.0
    return Circuit(rows, cols, readout=readout, driven=driven, **others)


def fabric(shape, seed=0) -> np.ndarray:
    """(rows, cols) [ohm] over the whole range of the curve."""
    return 10.0 ** np.random.default_rng(seed).uniform(1.9, 4.7, shape)


@pytest.mark.parametrize("kind", ALL, ids="-".join)
@pytest.mark.parametrize("shape", [(2, 2), (1, 5), (4, 7), (16, 16), (32, 32)], ids=str)
def test_forward_is_the_literal_network(shape, kind):
    circuit, resistance = skin(*shape, kind), fabric(shape)
    literal = nodal_reading(resistance, circuit)
    assert np.abs(forward(circuit, resistance) - literal).max() < 1e-9


@pytest.mark.parametrize("kind", ALL, ids="-".join)
def test_forward_with_missing_cells(kind):
    mask = np.ones((5, 6), bool)
    mask[0, :3] = mask[4, 5] = False
    circuit = skin(5, 6, kind, mask=mask)
    resistance = fabric((5, 6))
    literal = nodal_reading(np.where(mask, resistance, np.inf), circuit)
    assert np.abs(forward(circuit, resistance) - literal).max() < 1e-9


@pytest.mark.parametrize("kind", ALL, ids="-".join)
def test_what_changes_the_readings_by_so_much(kind):
    """`cells_for` inverts `change`, `readings_for` inverts `pull`."""
    rng, mask = np.random.default_rng(2), np.ones((6, 9), bool)
    mask[2, 3] = False
    g = mask * 10.0 ** rng.uniform(-4.6, -4.0, mask.shape)
    network, cells = readouts.solve(skin(6, 9, kind, mask=mask), g), np.flatnonzero(mask)
    b = rng.standard_normal(mask.shape)
    conductance, reading = network.cells_for(cells, b), network.readings_for(cells, b)
    assert conductance[2, 3] == reading[2, 3] == 0.0
    assert network.change(conductance)[mask] == pytest.approx(b[mask], rel=1e-4, abs=1e-4)
    assert network.pull(reading)[mask] == pytest.approx(b[mask], rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_a_line_without_a_cell_reads_nothing(kind):
    circuit, resistance = skin(3, 4, kind), fabric((3, 4))
    resistance[1], resistance[:, 2] = np.inf, np.inf
    adc = forward(circuit, resistance)
    assert np.abs(adc - nodal_reading(resistance, circuit)).max() < 1e-12
    assert (adc[1] == 0).all() and (adc[:, 2] == 0).all()


def test_a_hand_solved_2x2():
    """1 kohm everywhere; the driven row's currents return through both columns."""
    resistance = np.full((2, 2), 1000.0)
    loaded = Circuit(2, 2, r_ref=1000.0, r_par=0.0, readout="loaded")
    assert forward(loaded, resistance) == pytest.approx(np.full((2, 2), 0.5), abs=1e-12)
    grounded = replace(loaded, readout="grounded")  # 1 kohm up, two times 1 kohm down
    assert forward(grounded, resistance) == pytest.approx(np.full((2, 2), 1 / 3), abs=1e-12)


def test_columns_driven_is_the_transposed_board():
    resistance = fabric((4, 7))
    for readout in ("loaded", "grounded"):
        one = forward(Circuit(4, 7, readout=readout, driven="columns"), resistance)
        other = forward(Circuit(7, 4, readout=readout), resistance.T)
        assert one == pytest.approx(other.T, abs=1e-15)


@pytest.mark.parametrize("kind", ALL, ids="-".join)
def test_derivatives_are_those_of_differences(kind):
    circuit = skin(4, 6, kind)
    g = 1.0 / fabric((4, 6), 5)
    network = readouts.solve(circuit, g)
    n = g.size
    by_g = np.empty((n, n))
    for cell in range(n):
        step = np.zeros(n)
        step[cell] = 1e-5 * g.flat[cell]
        ends = [readouts.solve(circuit, g + way * step.reshape(g.shape)).adc for way in (1, -1)]
        by_g[:, cell] = (ends[0] - ends[1]).ravel() / (2.0 * step[cell])
    close = {"rel": 1e-5, "abs": 1e-6 * np.abs(by_g).max()}
    assert network.own.ravel() == pytest.approx(by_g.diagonal(), **close)
    rng = np.random.default_rng(1)
    p, w = rng.standard_normal((2, *g.shape))
    assert network.change(p).ravel() == pytest.approx(by_g @ p.ravel(), **close)
    assert network.pull(w).ravel() == pytest.approx(w.ravel() @ by_g, **close)
    row, col = np.divmod(np.arange(n, dtype=np.int32), np.int32(6))
    readings = np.arange(0, n, 2, dtype=np.int32)
    found = network.sensitivity(w, readings, row, col + np.int32(4))
    assert found == pytest.approx((w.reshape(-1, 1) * by_g)[::2], rel=1e-4, abs=1e-5)
    more, less = (
        readouts.solve(replace(circuit, r_par=circuit.r_par + step), g).adc for step in (0.1, -0.1)
    )
    assert network.by_r_par == pytest.approx((more - less) / 0.2, rel=1e-6)
    if circuit.readout_class.knows_r_drive:
        steps = np.maximum(circuit.r_drive + np.array([1e-3, -1e-3]), 0.0)
        more, less = (readouts.solve(replace(circuit, r_drive=r), g).adc for r in steps)
        by_difference = (more - less) / (steps[0] - steps[1])
        assert network.by_second == pytest.approx(by_difference, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_a_short_between_lines_by_differences(kind):
    """Lines, not only cells: a conductance between two neighbouring lines, read literally."""
    circuit, resistance = skin(4, 6, kind), fabric((4, 6), 2)
    network = readouts.solve(circuit, 1.0 / resistance)
    ones = np.ones(circuit.shape)
    for line in (0, 2, 4, 8):  # two pairs of rows, two of columns
        one = np.array([line], np.int32)
        found = network.sensitivity(ones, np.arange(24, dtype=np.int32), one, one + np.int32(1))
        step = 1e-9
        ends = [nodal_reading(resistance, circuit, (line, line + 1, way)) for way in (0.0, step)]
        expected = ((ends[1] - ends[0]) / step).ravel()
        assert found[:, 0] == pytest.approx(expected, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("kind", IDEAL, ids="-".join)
def test_grounded_is_inverted_in_closed_form(kind):
    circuit, resistance = skin(4, 6, kind), fabric((4, 6), 3)
    adc = forward(circuit, resistance)
    scale, offset = circuit.readout_class.apparent(circuit, adc)
    assert circuit.r_ref * scale / adc - offset == pytest.approx(resistance, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_described_and_back(kind):
    circuit = skin(3, 4, kind)
    assert circuit_from(circuit.describe()) == circuit
    assert circuit != Circuit(3, 4)


def test_what_is_refused():
    with pytest.raises(ValueError, match=r"readout = 'grounded lines'.*floating, loaded, grounded"):
        Circuit(readout="grounded lines")
    with pytest.raises(ValueError, match=r"driven = 'cols'.*rows, columns"):
        Circuit(driven="cols")
    with pytest.raises(ValueError, match=r"r_line = 5.0 ohm.*readout = 'loaded'"):
        Circuit(readout="loaded", r_line=5.0)
    with pytest.raises(ValueError, match=r"r_drive = -1.0 ohm: must be finite and 0 or more"):
        Circuit(readout="grounded", r_drive=-1.0)
    with pytest.raises(ValueError, match=r"r_drive = 5.0 ohm: .*'loaded', where .* part of r_par"):
        Circuit(readout="loaded", r_drive=5.0)


def test_drivers_share_their_row_s_voltage_by_hand():
    """1 kohm everywhere, drivers of 500 ohm: both columns are alike, as one of 500 ohm a row."""
    circuit = Circuit(2, 2, r_ref=1000.0, r_par=0.0, readout="grounded", r_drive=500.0)
    assert forward(circuit, np.full((2, 2), 1000.0)) == pytest.approx(np.full((2, 2), 0.25))


@pytest.mark.parametrize("driven", ["rows", "columns"])
@pytest.mark.parametrize("seed", range(4))
def test_no_load_elsewhere_takes_more_of_a_loaded_reading(driven, seed):
    rng = np.random.default_rng(seed)
    circuit = Circuit(*rng.integers(6, 12, 2), r_par=25.0, readout="loaded", driven=driven)
    cells = 5e4 * np.exp(1.2 * rng.standard_normal(circuit.shape))  # ohm
    hands = (rng.random((50, *circuit.shape)) < 0.3) * rng.uniform(-6.0, 0.0, circuit.shape)
    rest, *touched = (
        (adc := forward(circuit, ohm)) / readouts.apparent(circuit, adc)[0]
        for ohm in (cells, *(cells * np.exp(hands)))
    )
    least = circuit.readout_class.least(circuit, rest)
    assert (least <= rest).all()
    assert (np.array(touched) >= 0.9 * least).all()  # exact where r_ref conducts more than cells


def test_a_hand_elsewhere_takes_most_of_what_the_best_cell_of_a_loaded_line_reads():
    circuit = Circuit(6, 6, readout="loaded")
    cells = np.full(circuit.shape, 1e5)
    cells[0, 0] = 1e4
    hand = cells.copy()
    hand[1:] = 300.0
    rest, touched = forward(circuit, cells), forward(circuit, hand)
    least = circuit.readout_class.least(circuit, rest)
    assert 0.9 * least[0, 0] < touched[0, 0] < 0.4 * rest[0, 0]
