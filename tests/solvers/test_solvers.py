# SPDX-License-Identifier: Apache-2.0
"""Every method through the same door: the same scenes, the same mistakes."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS

CIRCUIT, CURVE = Circuit(), PressureCurve()


def one_touch(grams=300.0):
    """A flat object on 3 x 4 cells."""
    force = np.zeros((16, 16))
    force[4:7, 8:12] = grams * GRAM
    return force


def reading(force):
    return forward(CIRCUIT, CURVE.resistance(force))


@pytest.mark.parametrize("method", METHODS)
def test_an_untouched_skin_feels_nothing(method):
    estimate = compensate(reading(np.zeros((16, 16))), CIRCUIT, CURVE, method)
    assert estimate.status == "ok"
    assert estimate.force.max() < 5 * GRAM or method == "naive"


@pytest.mark.parametrize("method", METHODS)
def test_one_touch_is_found(method):
    force = one_touch()
    estimate = compensate(reading(force), CIRCUIT, CURVE, method)
    assert ((estimate.force > 100 * GRAM) == (force > 0)).all()
    inside = estimate.force[force > 0].mean() / GRAM
    if method == "naive":
        assert inside > 400.0, "parallel paths make it overestimate"
    else:
        assert inside == pytest.approx(300.0, rel=0.15)


@pytest.mark.parametrize("method", METHODS)
def test_each_cell_feels_its_gain_times_the_force(method):
    """And is as sure of it, and of the frame; the next frame goes on from it."""
    gain = np.random.default_rng(0).uniform(0.7, 1.4, (16, 16))
    own, adc = CURVE.with_gain(gain), reading(one_touch())
    usual = compensate(adc, CIRCUIT, CURVE, method)
    found = compensate(adc, CIRCUIT, own, method)
    np.testing.assert_allclose(found.force, gain * usual.force, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.std, gain * usual.std, rtol=1e-3, atol=1e-6)
    assert found.status == usual.status
    after = compensate(adc, CIRCUIT, own, method, start=found)
    np.testing.assert_allclose(after.force, found.force, rtol=0.02, atol=GRAM)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda a: a[:8], r"shape \(8, 16\)"),
        (
            lambda a: np.where(np.eye(16) > 0, np.nan, a),
            "16 of 256 values .* nan at row 0, column 0; say missing=True",
        ),
        (lambda a: a + 0.9, "not in"),
        (lambda a: a - 0.9, "not in"),
        (lambda a: np.where(np.eye(16) > 0, np.inf, a), "inf at row 0"),
    ],
)
def test_a_bad_reading_is_named(method, spoil, message):
    with pytest.raises(ValueError, match=message):
        compensate(spoil(reading(one_touch())), CIRCUIT, CURVE, method)


def test_an_unknown_method_is_named_with_those_there_are():
    with pytest.raises(ValueError, match=r"method 'magic'.*naive.*fixed_point.*cnn"):
        compensate(reading(one_touch()), CIRCUIT, CURVE, "magic")


def test_the_fixed_point_meets_the_reading():
    """Within an ADC step on a light touch; the naive method misses by many."""
    estimate = compensate(reading(one_touch(50.0)), CIRCUIT, CURVE, "fixed_point")
    assert estimate.residual < 1.0
    assert compensate(reading(one_touch(50.0)), CIRCUIT, CURVE, "naive").residual > 10.0
    assert np.abs(estimate.force - one_touch(50.0)).max() < 10 * GRAM


def test_methods_without_a_network_serve_any_circuit():
    mask = np.ones((6, 11), bool)
    mask[2, 3] = mask[5, 10] = False
    circuit = Circuit(6, 11, r_ref=3000.0, r_par=100.0, adc_bits=12, mask=mask)
    force = np.zeros((6, 11))
    force[1, 4] = force[4, 8] = 1.5
    adc = forward(circuit, CURVE.resistance(force))
    estimate = compensate(adc, circuit, CURVE, "fixed_point")
    assert estimate.force[~mask].max() == 0.0
    assert np.abs(estimate.force - force).max() < 0.1
    naive = compensate(adc, circuit, CURVE, "naive")
    assert naive.residual > 3 * estimate.residual


def test_weights_of_another_circuit_are_refused_by_name():
    other = Circuit(r_ref=2200.0)
    adc = forward(other, CURVE.resistance(one_touch()))
    with pytest.raises(ValueError, match=r"r_ref = 1780.0 \(yours: 2200.0\)"):
        compensate(adc, other, CURVE, "cnn")
    with pytest.raises(ValueError, match="another pressure curve"):
        compensate(adc, CIRCUIT, PressureCurve([0, 5], [30000, 100]), "cnn")


# --- what the paper says, on the paper's scenes ---------------------------------------------------


def errors(method, family, n, seed):
    """Mean absolute error [g a cell] of the method on n ideal frames."""
    force = scenes.sample(family, n, 16, 16, np.random.default_rng(seed))
    adc = reading(force)
    found = [compensate(a, CIRCUIT, CURVE, method).force for a in adc]
    return np.abs(np.array(found) - force).mean() / GRAM


@pytest.mark.parametrize(("family", "share"), [("blobs", 7), ("rects", 5), ("random", 10)])
def test_the_network_beats_the_naive_method(family, share):
    """At most a seventh, a fifth and a tenth of the naive error on the three families."""
    naive, cnn = (errors(m, family, 300, seed=20261) for m in ("naive", "cnn"))
    print(f"{family}: naive {naive:.1f}, cnn {cnn:.1f} g a cell")
    if family != "random":
        assert 120.0 < naive < 220.0
    assert cnn < naive / share


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("value", "word"), [(0.0, "open"), (1.0, "r_par")])
def test_a_line_that_no_skin_can_read_is_suspect_whatever_the_method(method, value, word):
    adc = np.full((16, 16), 0.3)
    adc[5] = value
    noisy = scenes.read_out(Circuit(), adc, "adc10", np.random.default_rng(0))
    found = compensate(noisy, Circuit(), PressureCurve(), method)
    assert found.status == "suspect" and "row 5" in found.message and word in found.message


@pytest.mark.parametrize("method", ["newton", "map", "auto"])
@pytest.mark.parametrize("grams", [300.0, 900.0])
def test_a_saturated_input_is_suspect_and_a_flat_touch_is_not(method, grams):
    """Both read alike in many cells; only of a flat touch are there cells that read so."""
    force = one_touch(grams)
    force[9:14, 2:7] = 0.6 * grams * GRAM
    rng = np.random.default_rng(1)
    adc = reading(force * (1.0 + 0.05 * rng.standard_normal(force.shape)))
    sound = scenes.read_out(CIRCUIT, adc, "scan", rng)
    assert compensate(sound, CIRCUIT, CURVE, method).status == "ok"
    # the amplifier's end: nothing, noise included, comes out higher
    samples = [np.minimum(np.rint(adc * 1023 + rng.normal(size=adc.shape)), 614) for _ in range(4)]
    for steps in (samples[0], np.mean(samples, 0)):
        found = compensate(steps / 1023, CIRCUIT, CURVE, method)
        assert found.status == "suspect" and found.message


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"naive", "newton", "fixed_point"}))
@pytest.mark.parametrize("cells", [(1, 1), (1, 2)])
@pytest.mark.parametrize("place", [(0, 0), (0, 7), (8, 8), (15, 14)])
def test_a_hard_edge_reaches_its_force_wherever_it_presses(method, cells, place):
    """10 kg on one cell or two: all that a stop knows of it is that a cell is at its end."""
    force = np.zeros((16, 16))
    force[place[0] : place[0] + cells[0], place[1] : place[1] + cells[1]] = 98.0 / np.prod(cells)
    adc = scenes.read_out(CIRCUIT, reading(force), "scan", np.random.default_rng(3))
    found = compensate(adc, CIRCUIT, CURVE, method).force
    assert found.max() > 9.0, "config/skin.yaml's peak"
    assert found[force == 0].sum() < 10.0


@pytest.mark.parametrize("bits", [10, 14])
def test_rounding_alone_makes_few_sound_frames_suspect(bits):
    """Readings that are alike are rounded alike, which looks like a fault's pattern."""
    board = Circuit(adc_bits=bits)
    rng = np.random.default_rng(21)
    force = np.concatenate([scenes.sample(f, 30, 16, 16, rng) for f in ("blobs", "rects")])
    adc = np.rint(forward(board, CURVE.resistance(force)) * board.full_scale) / board.full_scale
    suspect = [compensate(frame, board, CURVE, "map").status == "suspect" for frame in adc]
    assert np.mean(suspect) < 0.1


@pytest.mark.parametrize("method", ["fixed_point", "newton", "map"])
def test_a_frame_that_the_time_limit_cuts_off_has_failed(method):
    adc = reading(one_touch())
    late = compensate(adc, CIRCUIT, CURVE, method, time_limit=1e-9)
    assert late.status == "failed" and "time_limit" in late.message
    closed = Circuit(readout="grounded"), CURVE  # takes no iteration
    adc = forward(closed[0], CURVE.resistance(one_touch()))
    assert compensate(adc, *closed, "fixed_point", time_limit=1e-9).status == "ok"
