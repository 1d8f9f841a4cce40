# SPDX-License-Identifier: Apache-2.0
"""The characteristic curve: monotone, exactly invertible, strict about its file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from tactile_skin import PressureCurve
from tactile_skin.physics.curve import GRAM

CURVE = PressureCurve()


@given(st.floats(0.0, 1000.0))
def test_force_and_resistance_are_each_others_inverse(grams):
    force = grams * GRAM
    assert CURVE.force(CURVE.resistance(force)) == pytest.approx(force, abs=1e-9)


def test_passes_through_the_default_points():
    grams = np.array([0, 5, 10, 20, 50, 100, 200, 500, 1000])
    ohm = [40000, 12000, 6500, 3500, 1500, 800, 420, 170, 85]
    np.testing.assert_allclose(CURVE.resistance(grams * GRAM), ohm, rtol=1e-9)


@given(st.lists(st.floats(0.01, 3.0), min_size=2, max_size=12), st.randoms())
def test_between_its_points_it_is_scipys_pchip(falls, dice):
    """An independent computation of the same cubic."""
    resistance = 10.0 * np.exp(np.cumsum(falls)[::-1])
    force = np.concatenate([[0.0], np.cumsum([dice.uniform(0.01, 5.0) for _ in falls[1:]])])
    curve = PressureCurve(force, resistance)
    theirs = PchipInterpolator(np.sqrt(force), np.log(resistance))(curve._root)
    np.testing.assert_allclose(-curve._log_g, theirs, rtol=1e-12)


def test_falls_everywhere():
    assert (np.diff(CURVE.resistance(np.linspace(0.0, CURVE.max_force, 10_001))) < 0).all()


def test_is_clipped_at_both_ends():
    assert CURVE.force(np.inf) == 0.0
    assert CURVE.force(1e6) == 0.0
    assert CURVE.force(0.0) == pytest.approx(CURVE.max_force)
    assert CURVE.resistance(2 * CURVE.max_force) == pytest.approx(CURVE.least_resistance)
    assert CURVE.resistance(-1.0) == pytest.approx(CURVE.rest_resistance)


def test_slope_equals_finite_differences():
    force = np.array([0.03, 0.3, 1.1, 6.0])
    step = 1e-6
    resistance = CURVE.resistance(force)
    numeric = (CURVE.force(resistance * (1 + step)) - CURVE.force(resistance * (1 - step))) / (
        2 * step
    )
    np.testing.assert_allclose(CURVE.slope(force), numeric, rtol=1e-2)


def test_round_trip_through_a_file(tmp_path):
    file = tmp_path / "curve.yaml"
    file.write_text("force: [0, 1, 5]\nresistance: [20000, 900, 100]\n")
    curve = PressureCurve.load(file)
    assert curve == PressureCurve([0, 1, 5], [20000, 900, 100])
    assert curve.resistance(1.0) == pytest.approx(900.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("force: [0, 1]\nresistance: [1, 2]", "must fall"),
        ("force: [1, 2]\nresistance: [2, 1]", "must start at 0"),
        ("force: [0, 1, 2]\nresistance: [2, 1]", "same number"),
    ],
)
def test_a_bad_file_is_named(tmp_path, text, message):
    """What is no curve; what is no such file: test_files.py."""
    file = tmp_path / "curve.yaml"
    file.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        PressureCurve.load(file)
    assert str(file) in str(error.value)


def test_a_gain_scales_the_force():
    """Both ways, its slope, and its end; the points and the resistance at rest stay."""
    gain = np.array([[0.5, 1.0], [2.0, 1.3]])
    usual, own = PressureCurve(), PressureCurve().with_gain(gain)
    force = np.full((2, 2), 1.5)
    np.testing.assert_allclose(own.resistance(force * gain), usual.resistance(force))
    np.testing.assert_allclose(own.force(own.resistance(force)), force)
    step = 1e-4
    higher = own.force(own.resistance(force) * np.exp(step))
    np.testing.assert_allclose(own.slope(force), (higher - force) / step, rtol=1e-2)
    np.testing.assert_array_equal(own.resistance(force[0, :1]), usual.resistance(force[0, :1]))
    assert own.max_force == 0.5 * usual.max_force
    assert own.rest_resistance == usual.rest_resistance
    assert own != usual and own == PressureCurve().with_gain(gain) and own.usual == usual
    rested = own.resting_at(np.full((2, 2), 30e3))
    np.testing.assert_allclose(rested.force(rested.resistance(force)), force)
    assert rested.usual == usual


@pytest.mark.parametrize("gain", [[0.0, 1.0], [1.0, np.nan], [np.inf, 1.0], [-1.0, 1.0]])
def test_a_gain_that_is_none_is_refused(gain):
    with pytest.raises(ValueError, match="a cell of gain"):
        PressureCurve().with_gain(gain)


def test_a_curve_goes_on_as_it_ended():
    """To the force that is asked for, on the cell of the least gain too; as it was before."""
    short = PressureCurve([0.0, 1.0, 5.0], [40000.0, 800.0, 150.0])
    gain = np.array([[0.8, 1.0], [1.1, 1.2]])
    longer = short.with_gain(gain).up_to(9.8)
    assert longer.max_force == pytest.approx(9.8)
    np.testing.assert_array_equal(longer.gain, gain)
    np.testing.assert_allclose(longer.resistance([1.0, 5.0]), [800.0, 150.0])
    added = np.diff(1.0 / longer.usual.resistance([1.0, 5.0, longer.points[-1][0]]))
    assert added[1] / (longer.points[-1][0] - 5.0) == pytest.approx(added[0] / 4.0)
    assert longer.up_to(9.8) is longer
