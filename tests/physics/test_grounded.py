# SPDX-License-Identifier: Apache-2.0
"""The closed form of a grounded matrix, against Kirchhoff's laws for each reading."""

import numpy as np
import pytest
from support.kirchhoff import nodal_reading

from tactile_skin import Circuit
from tactile_skin.physics.readouts import Grounded


def closed_form(circuit, adc, low, high):
    """To a thousandth of a gram."""
    return Grounded.closed_form(circuit, adc, None, (low, high), 1e-9, lambda: False)


def board(shape, driven, r_drive, seed, mask=None):
    """A circuit, conductances [S] of a touched fabric, and their readings."""
    circuit = Circuit(
        *shape,
        r_ref=4700.0,
        r_par=70.0,
        readout="grounded",
        driven=driven,
        r_drive=r_drive,
        mask=mask,
    )
    rng = np.random.default_rng(seed)
    g = np.exp(rng.normal(0.0, 0.1, shape)) / 4e4
    rows, cols = rng.integers(shape[0], size=4), rng.integers(shape[1], size=4)
    g[rows, cols] = 1.0 / rng.uniform(300.0, 3000.0, 4)
    g *= circuit.populated
    with np.errstate(divide="ignore"):
        return circuit, g, nodal_reading(1.0 / g, circuit)


@pytest.mark.parametrize("driven", ["rows", "columns"])
@pytest.mark.parametrize("r_drive", [0.0, 1e-3, 0.5, 25.0, 70.0])
@pytest.mark.parametrize("shape", [(2, 2), (1, 5), (5, 1), (6, 9)])
def test_it_finds_the_cells(shape, driven, r_drive):
    """Continuous in r_drive: 0 is no special board."""
    circuit, g, adc = board(shape, driven, r_drive, seed=3)
    low, high = np.full(shape, 1e-6), np.full(shape, 1e-2)
    found, steps, converged = closed_form(circuit, adc, low, high)
    assert converged
    assert (steps > 0) == (r_drive > 0.0)
    np.testing.assert_allclose(found, g, rtol=1e-6)


@pytest.mark.parametrize("driven", ["rows", "columns"])
@pytest.mark.parametrize("read", [True, False])
def test_cells_that_are_not_there_conduct_nothing(driven, read):
    """Whether the board reads their crossings or not."""
    mask = np.ones((6, 9), bool)
    mask[0, :3] = mask[4, 4] = False
    circuit, g, adc = board((6, 9), driven, 25.0, 4, mask)
    adc = adc if read else adc * mask
    found, _, _ = closed_form(circuit, adc, np.full((6, 9), 1e-6), np.full((6, 9), 1e-2))
    np.testing.assert_allclose(found, g, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("driven", ["rows", "columns"])
def test_readings_without_a_cell_decide_between_a_light_load_and_a_hard_one(driven):
    """A load of a tenth gives the same readings to all cells, and others where there is none."""
    shape = (8, 8)
    mask = np.random.default_rng(2).random(shape) < 0.75
    behind = {"readout": "grounded", "driven": driven, "r_drive": 57.0, "mask": mask}
    circuit = Circuit(*shape, r_ref=3070.0, r_par=1.0, **behind)
    g = np.where(mask, 1.0 / 150.0, 0.0)
    adc = nodal_reading(np.where(mask, 150.0, np.inf), circuit)
    adc = np.round(adc * 32767) / 32767
    found, _, converged = closed_form(circuit, adc, np.full(shape, 2.5e-5), np.full(shape, 1e-1))
    assert converged
    np.testing.assert_allclose(found, g, rtol=0.03)


def test_drivers_that_are_taken_for_ideal_hide_a_touch():
    circuit, g, adc = board((6, 9), "rows", 70.0, seed=3)
    bounds = np.full((6, 9), 1e-6), np.full((6, 9), 1e-2)
    felt = Grounded.guess(circuit, adc, None, bounds)
    assert felt.max() < 0.9 * g.max()


def test_of_a_hard_load_on_all_cells_the_readings_are_met():
    """Only noise is left of 1 - sum v, and steps go on for ever: the best one counts."""
    shape = (8, 8)
    circuit = Circuit(*shape, readout="grounded", r_drive=70.0)
    adc = nodal_reading(np.full(shape, 90.0), circuit)
    adc = np.clip(adc + np.random.default_rng(1).normal(0.0, 1e-3, shape), 0.0, 1.0)
    low, high = np.full(shape, 2.5e-5), np.full(shape, 1.0 / 85.0)
    found, _, _ = closed_form(circuit, adc, low, high)
    assert (found >= low).all() and (found <= high * (1.0 + 1e-9)).all()
    misses = nodal_reading(1.0 / found, circuit) - adc
    assert np.sqrt(np.mean(np.square(misses))) < 5e-3
