# SPDX-License-Identifier: Apache-2.0
"""Effects that a textile, its wires and its board add, one at a time."""

from dataclasses import replace

import numpy as np
import pytest
from support.kirchhoff import DIODES, adc_ratio, behind_diodes
from support.lab.parts import Diode
from support.troubled import expose

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.simulation.network import NOWHERE, Wiring, voltage_ratio
from tactile_skin.simulation.textile import Textile

CIRCUIT, CURVE = Circuit(), PressureCurve()
SMALL = Circuit(5, 4)


@pytest.fixture(scope="module")
def resistance():
    force = scenes.sample("blobs", 3, 16, 16, np.random.default_rng(0))
    return CURVE.resistance(force)


def two_terminal(resistance, stripe=0.0, damage=lambda wiring: None):
    """Resistance [ohm] between the leads of a wiring that is damaged."""
    wiring = replace(Wiring.sound(*resistance.shape[-2:]), stripe=stripe, leakage=0.0)
    damage(wiring)
    frames = resistance.reshape(-1, *resistance.shape[-2:])
    divider = Circuit(*frames.shape[1:], r_par=0.0)
    adc = voltage_ratio(1.0 / frames, wiring, divider).reshape(resistance.shape)
    with np.errstate(divide="ignore"):  # of a line that reads nothing
        return divider.r_ref / adc - divider.r_ref


def seen(skin: Textile, force, seed=0, circuit=CIRCUIT):
    return expose(skin, circuit, CURVE, force, np.random.default_rng(seed))


# --- the richer model ---


def test_a_skin_that_differs_in_nothing_is_the_solvers(resistance):
    ratio = CIRCUIT.ratio(two_terminal(resistance))
    np.testing.assert_allclose(ratio, forward(CIRCUIT, resistance), rtol=1e-12)
    force = CURVE.force(resistance[0])
    np.testing.assert_allclose(seen(Textile(), force), forward(CIRCUIT, resistance[0]), rtol=1e-9)


def test_the_model_meets_the_papers_equations():
    resistance = np.random.default_rng(1).uniform(100, 5000, (5, 4))
    rho = two_terminal(resistance)
    np.testing.assert_allclose(SMALL.ratio(rho), adc_ratio(resistance, 1780.0, 326.0), rtol=1e-10)


def test_stripe_resistance_by_hand():
    """The path is row, cell, column; two cells of a row share its first half."""
    assert two_terminal(np.array([[100.0]]), stripe=7.0) == pytest.approx(114.0)
    near, far = two_terminal(np.array([[100.0, 300.0]]), stripe=8.0)[0]
    assert near == pytest.approx(4 + 100 + 8)  # half the row, the cell, the whole column
    assert far == pytest.approx(8 + 300 + 8)


def test_stripe_resistance_by_the_whole_network():
    """Against a nodal solve with a node at each crossing of each stripe."""
    rows, cols, line = 3, 4, 20.0
    cell = np.random.default_rng(2).uniform(100, 2000, (rows, cols))
    n = rows * cols
    laplacian = np.zeros((2 * n + rows + cols,) * 2)  # row sides, column sides, leads

    def resistor(a, b, ohm):
        laplacian[[a, b], [a, b]] += 1 / ohm
        laplacian[[a, b], [b, a]] -= 1 / ohm

    for i in range(rows):
        for j in range(cols):
            k = i * cols + j
            resistor(k, n + k, cell[i, j])
            resistor(k, k - 1 if j else 2 * n + i, line / cols)
            resistor(n + k, n + k - cols if i else 2 * n + rows + j, line / rows)
    inverse = np.linalg.pinv(laplacian)
    a, b = np.meshgrid(2 * n + np.arange(rows), 2 * n + rows + np.arange(cols), indexing="ij")
    expected = inverse[a, a] + inverse[b, b] - 2 * inverse[a, b]
    np.testing.assert_allclose(two_terminal(cell, line), expected, rtol=1e-9)


def test_a_cut_lead_reads_nothing_and_harms_no_other_line(resistance):
    def cut(wiring):
        wiring.rows[3] = wiring.cols[4] = NOWHERE

    rho = two_terminal(resistance[0], damage=cut)
    sound = two_terminal(resistance[0])
    assert np.isinf(rho[3]).all() and np.isinf(rho[:, 4]).all()
    others = np.ix_(np.arange(16) != 3, np.arange(16) != 4)
    np.testing.assert_allclose(rho[others], sound[others], rtol=1e-10)


def test_a_broken_stripe_is_two_stripes(resistance):
    """The far part has no lead: as a network of 17 rows of which the last is not read."""
    rho = two_terminal(resistance[0], damage=lambda wiring: wiring.cut(0, 3, 5))
    split = np.full((17, 16), 1e12)
    split[:16] = resistance[0]
    split[16, 5:], split[3, 5:] = resistance[0, 3, 5:], 1e12
    np.testing.assert_allclose(rho, two_terminal(split)[:16], rtol=1e-6)


def test_shorted_lines_read_nearly_alike(resistance):
    def touch(wiring):
        wiring.ties += [(0, 6, 0, 7, 1.0), (1, 9, 1, 10, 1.0)]

    rho = two_terminal(resistance[0], damage=touch)
    assert np.abs(rho[6] - rho[7]).max() < 1.0 and np.abs(rho[:, 9] - rho[:, 10]).max() < 1.0


def test_open_leads_and_lines_at_full_scale_are_as_many_as_asked():
    force = np.zeros((16, 16))
    for n in (1, 3):
        adc = seen(Textile(open=n), force)
        assert (adc == 0).all(1).sum() + (adc == 0).all(0).sum() == n
        adc = seen(Textile(full_scale=n), force)
        assert (adc == 1).all(1).sum() + (adc == 1).all(0).sum() == n


def test_stuck_cells_conduct_without_a_load():
    adc = seen(Textile(stuck=2), np.zeros((16, 16)))
    rest = forward(CIRCUIT, np.full((16, 16), CURVE.rest_resistance))
    assert (adc > 2 * rest).sum() >= 2


def test_a_contact_that_moves_reads_otherwise():
    force = scenes.finger(16, 16, 7.5, 7.5, 10.0)
    still, moved = (seen(Textile(moving=m), force, seed=3) for m in (0.0, 6.0))
    change = np.abs(moved - still).max(1)
    assert change.max() > 20 / 1023
    slow = seen(Textile(moving=0.01), force, seed=3)
    assert np.abs(slow - still).max() < 3 / 1023


def test_the_readout_saturates_and_has_the_noise_asked_for():
    ratio = np.full((60, 60), 0.6)
    circuit = Circuit(60, 60)
    rng = np.random.default_rng(4)
    assert Textile(ceiling=0.5).converter(circuit).frame(ratio, rng).max() <= 0.5005
    steps = Textile(noise=4.0).converter(circuit).frame(ratio, rng) * 1023
    assert steps.std() == pytest.approx(2.0, rel=0.1)  # the mean of four


def test_coupling_leaks_into_neighbours_only():
    force = np.zeros((16, 16))
    force[8, 8] = 500 * GRAM
    change = np.abs(seen(Textile(lateral=0.05), force) - seen(Textile(), force))
    assert change[8, 9] > 5 / 1023 and change[8, 9] > 5 * change[2, 2]


@pytest.mark.parametrize("readout", ["floating", "loaded"])
@pytest.mark.parametrize("name", DIODES)
def test_a_line_behind_a_diode_has_the_operating_point_of_shockleys_law(name, readout, resistance):
    circuit = Circuit(readout=readout, driven="columns" if readout == "loaded" else "rows")
    ideal = forward(circuit, resistance)
    found = Diode(*DIODES[name], 3.3).ratio(ideal, circuit)
    np.testing.assert_allclose(found[0], behind_diodes(ideal[0], circuit, name, 3.3), rtol=1e-9)
