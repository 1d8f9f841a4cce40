# SPDX-License-Identifier: Apache-2.0
"""Scenes and readouts are what simulation/scenes.py says they are."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes


@pytest.mark.parametrize("family", scenes.FAMILIES)
def test_loads_lie_within_one_kilogram(family):
    force = scenes.sample(family, 200, 16, 16, np.random.default_rng(1))
    assert force.shape == (200, 16, 16)
    assert force.min() >= 0.0 and force.max() <= 1000 * GRAM + 1e-12
    assert force.max() > 500 * GRAM


@pytest.mark.parametrize("family", ["blobs", "rects"])
def test_a_rectangle_has_2_to_9_cells_a_side(family):
    force = scenes.sample(family, 400, 20, 20, np.random.default_rng(2))
    touched = force > 0
    sides = np.concatenate([touched.any(2).sum(1), touched.any(1).sum(1)])
    assert sides.min() >= 2
    assert (touched.sum((1, 2)) < 4 * 81 + 1).all()


def test_families_differ_as_named():
    rng = np.random.default_rng(3)
    means = {f: scenes.sample(f, 600, 16, 16, rng).mean() / GRAM for f in scenes.FAMILIES}
    assert means["blobs"] < means["rects"] < means["random"]
    assert means["random"] == pytest.approx(250.0, rel=0.1)


def test_small_skins_get_scenes_too():
    assert scenes.sample("rects", 20, 3, 5, np.random.default_rng(4)).shape == (20, 3, 5)


def test_an_unknown_family_is_named():
    with pytest.raises(ValueError, match="family 'dots'"):
        scenes.sample("dots", 1, 4, 4, np.random.default_rng(0))


@pytest.mark.parametrize(("readout", "noise"), [("ideal", 0.0), ("adc10", 0.289), ("scan", 0.52)])
def test_readouts_err_as_named(readout, noise):
    """RMS error in ADC steps: none; of rounding, 1/sqrt(12); of 4 noisy, rounded scans."""
    rng = np.random.default_rng(5)
    circuit, curve = Circuit(), PressureCurve()
    ideal = forward(circuit, curve.resistance(scenes.sample("random", 50, 16, 16, rng)))
    error = (scenes.read_out(circuit, ideal, readout, rng) - ideal) * 1023
    assert np.sqrt(np.square(error).mean()) == pytest.approx(noise, abs=0.01)


@pytest.mark.parametrize("name", scenes.SCRIPTS)
def test_scripted_scenes_are_forces(name):
    scene = scenes.script(name, 16, 16)
    for t in np.linspace(0.0, 20.0, 41):
        force = scene(t)
        assert force.shape == (16, 16) and force.min() >= 0.0


def test_a_finger_weighs_what_it_is_told():
    assert scenes.finger(16, 16, 5.3, 8.8, 7.0).sum() == pytest.approx(7.0)


@pytest.mark.parametrize("family", ["bodies", "pictures"])
@pytest.mark.parametrize("shape", [(16, 16), (4, 4), (3, 20), (1, 8)])
def test_free_touches_are_within_the_papers_loads(family, shape):
    force = scenes.sample(family, 30, *shape, np.random.default_rng(4)) / GRAM
    assert force.shape == (30, *shape)
    assert force.min() >= 0.0 and 30.0 < force.max() <= scenes.MAX_LOAD
    assert (force > 0.0).any((1, 2)).mean() > 0.7  # a body may hang over the edge


def _twist(family: str) -> float:
    """Median of the mixed second difference of the log load, which is 0 for a product."""
    x = np.log(scenes.sample(family, 40, 16, 16, np.random.default_rng(5)) / GRAM + 1.0)
    touched = x > 0.0
    touched = touched[1:, 1:] & touched[:-1, 1:] & touched[1:, :-1] & touched[:-1, :-1]
    return np.median(np.abs(x[1:, 1:] - x[:-1, 1:] - x[1:, :-1] + x[:-1, :-1])[touched])


def test_bodies_are_no_products_of_rows_and_columns():
    assert _twist("bodies") > 2.0 * _twist("rects")
