# SPDX-License-Identifier: Apache-2.0
"""Single cells that are bad, and single readings that are taken badly."""

import numpy as np
import pytest
from support.lab.parts import BadConverter, BadFabric
from support.lab.unknown import Creeping, Unknown

from tactile_skin import Circuit, PressureCurve

CIRCUIT, CURVE = Circuit(4, 5), PressureCurve()
CELL, OTHER = (1, 2), (3, 4)
IN_CELL, IN_OTHER = (slice(None), *CELL), (slice(None), *OTHER)


def fabric() -> BadFabric:
    return BadFabric.everyday(CIRCUIT, CURVE, np.random.default_rng(1))


def test_a_loose_cell_conducts_nothing_for_its_share_of_the_time():
    cells = fabric()
    cells.loose[CELL] = 0.4
    g = cells.conductance(np.zeros((2000, *CIRCUIT.shape)))
    assert (g[IN_CELL] == 0.0).mean() == pytest.approx(0.4, abs=0.1)
    assert np.ptp(g[IN_OTHER]) == 0.0 and cells.unsteady


def test_a_fixed_cell_feels_no_load_and_an_added_conductance_comes_on_top():
    cells, force = fabric(), np.full((1, *CIRCUIT.shape), 2.0)
    before = cells.conductance(force)[0]
    cells.fixed[CELL], cells.added[OTHER] = 0.0, 1e-3
    after = cells.conductance(force)[0]
    assert after[CELL] == 0.0 and after[OTHER] == pytest.approx(before[OTHER] + 1e-3)


def test_beyond_the_curves_end_the_fabric_goes_on_conducting_more():
    end = np.full((1, *CIRCUIT.shape), CURVE.max_force)
    cells = fabric()
    assert (cells.conductance(1.5 * end) > 1.3 * cells.conductance(end)).all()


def test_dips_take_their_share_of_the_samples():
    converter = BadConverter(1023, noise=0.0, dips={CELL: (0.25, 0.5)})
    found = converter.count(np.full((2000, *CIRCUIT.shape), 0.6), np.random.default_rng(2))
    assert set(np.unique(found[IN_CELL])) == {307, 614}
    assert (found[IN_CELL] == 307).mean() == pytest.approx(0.25, abs=0.04)
    assert (found[IN_OTHER] == 614).all()


def test_an_unknown_board_is_the_same_by_its_seed_and_its_curve_may_be_set():
    one, other = Unknown((4, 4), 3), Unknown((4, 4), 3)
    force = np.full((4, 4), 2.0)
    np.testing.assert_array_equal(one.frames([force] * 3), other.frames([force] * 3))
    other.curve = PressureCurve()
    assert np.abs(one.expose(force) - other.expose(force)).max() > 1e-3


def test_a_load_that_stands_gains_its_share_in_a_decade():
    board = Creeping((4, 4), 3, share=0.1, time=1.0)
    force, times = np.full((4, 4), 2.0), np.array([0.0, 9.0, 99.0])
    rest = board.expose(np.zeros((4, 4)))
    first, *later = (frame - rest for frame in board.standing(times, force, np.ones(3)))
    assert (later[0].mean() > first.mean()) and (later[1].mean() > later[0].mean())
    still = Creeping((4, 4), 3, share=0.0, time=1.0).standing(times, force, np.ones(3))
    assert np.abs(still[2] - still[0]).max() < 4 / 1023
