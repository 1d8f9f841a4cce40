# SPDX-License-Identifier: Apache-2.0
"""Newtons by known weights, on a board whose fabric, stripes and noise no solver knows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.lab.unknown import Unknown
from support.marks import ci
from support.weights import known, objects, presses, stream, totals

from tactile_skin import Circuit, PressureCurve, fit_curve, fit_reference, forward, measure_rest
from tactile_skin.calibration import curve_fit
from tactile_skin.calibration.totals import Totals
from tactile_skin.simulation.scenes import read_out

SHAPE = 12, 12


class Bench:
    """A board, twelve weighed objects on it, twelve new ones."""

    def __init__(self):
        board, rng = Unknown(SHAPE, seed=4), np.random.default_rng(4)
        self.circuit, self.board = known(board), board
        self.rest = measure_rest(board.at_rest(), self.circuit)
        self.laid, self.weights = objects(12, SHAPE, rng)
        self.frames = board.frames(self.laid)
        laid, self.new_weights = objects(12, SHAPE, rng)
        self.new_frames = board.frames(laid)

    def fit(self, weights, chosen=slice(None)):
        return fit_curve(self.frames[chosen], weights, self.circuit, self.rest)

    def off(self, fitted):
        found = totals(self.new_frames, self.circuit, fitted.curve, self.rest)
        return found / self.new_weights - 1.0


@pytest.fixture(scope="module")
def bench():
    return Bench()


@pytest.fixture(scope="module")
def fitted(bench):
    return bench.fit(bench.weights)


def test_new_objects_weigh_what_they_weigh(bench, fitted):
    """Within 3 % in the median, where the shipped curve is far off."""
    off = np.abs(bench.off(fitted))
    assert np.median(off) < 0.03
    assert off.max() < 0.12
    shipped = totals(bench.new_frames, bench.circuit, PressureCurve(), bench.rest)
    assert np.median(np.abs(shipped / bench.new_weights - 1.0)) > 0.1
    assert fitted.odd == ()


def test_the_error_is_honest(bench, fitted):
    """It is about that of new objects, but of lighter ones than all others: that is said."""
    true = np.square(bench.off(fitted)).mean() ** 0.5
    assert true / 2.0 < fitted.error < true * 2.0
    light = bench.laid * (0.1 * bench.weights.min() / bench.weights)[:, None, None]
    felt = totals(bench.board.frames(light), bench.circuit, fitted.curve, bench.rest)
    assert np.square(felt / light.sum((1, 2)) - 1.0).mean() ** 0.5 > 3.0 * fitted.error
    half, most = np.quantile(np.abs(bench.off(fitted)), (0.5, 0.9))
    assert half / 2.0 < fitted.holds.median < half * 2.0
    assert most / 2.0 < fitted.holds.p90 < most * 2.0
    assert f"stand {fitted.holds}, of lighter ones by several times that" in fitted.message
    assert fitted.first is None and "in the first 0.3 s a touch may read 25% low" in fitted.message


@pytest.mark.parametrize("scatter", [0.02, ci(0.25)])
def test_the_error_is_that_of_a_better_or_worse_fabric(scatter):
    """Four boards in the geometric mean: the usual error pulls little where the weights deny it."""
    ratio = []
    for seed in range(60, 64):
        board, rng = Unknown((8, 8), seed, scatter=scatter), np.random.default_rng(seed)
        rest, circuit = measure_rest(board.at_rest(), known(board)), known(board)
        (laid, weights), (new, truth) = (objects(n, (8, 8), rng) for n in (10, 30))
        found = fit_curve(board.frames(laid), weights, circuit, rest)
        off = totals(board.frames(new), circuit, found.curve, rest) / truth - 1.0
        ratio.append(found.error / np.square(off).mean() ** 0.5)
    assert 0.67 < np.exp(np.log(ratio).mean()) < 1.5


@pytest.mark.parametrize("times", [1e-3, ci(0.2), ci(20.0), ci(56.0), 1e3])
def test_the_same_readings_of_other_ohms_give_the_same_forces(bench, fitted, times):
    """r_ref, r_par and all cells' resistances times a number: six decades of it read alike."""
    parts = {name: times * getattr(bench.circuit, name) for name in ("r_ref", "r_par", "r_line")}
    circuit = replace(bench.circuit, **parts)
    rest = replace(bench.rest, conductance=bench.rest.conductance / times)
    found = fit_curve(bench.frames, bench.weights, circuit, rest)
    force, resistance = np.array(fitted.curve.points).T
    np.testing.assert_allclose(found.curve.points, np.stack([force, times * resistance], 1), 1e-6)
    assert found.error == pytest.approx(fitted.error, rel=1e-6)
    felt = totals(bench.new_frames, circuit, found.curve, rest)
    np.testing.assert_allclose(felt, bench.new_weights * (1.0 + bench.off(fitted)), rtol=1e-6)


def test_it_is_a_curve_of_the_usual_cell(bench, fitted):
    """It rests where the usual cell does, reaches the hardest that is read, and can be kept."""
    assert fitted.curve.rest_resistance == pytest.approx(1.0 / np.median(bench.rest.conductance))
    assert fitted.curve.least_resistance < PressureCurve().least_resistance * 1.01
    assert PressureCurve(**fitted.curve.describe()) == fitted.curve.usual


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("heaviest", [False, True])
def test_a_wrong_label_is_named(bench, fitted, factor, heaviest):
    """With its weight and what the others say, and does no harm."""
    bad = int(bench.weights.argmax() if heaviest else bench.weights.argsort()[6])
    weights = bench.weights.copy()
    weights[bad] *= factor
    found = bench.fit(weights)
    assert found.odd == (bad,)
    assert (
        f"object {bad + 1} is left out: its weight is given as {weights[bad]:.3g} N"
        in found.message
    )
    assert np.median(np.abs(bench.off(found))) < 0.03
    assert found.off[bad] == pytest.approx(1.0 / factor - 1.0, abs=0.15)


@pytest.mark.parametrize("seed", [7, 18, 26])
def test_the_only_one_of_its_weight_is_not_odd(seed):
    """Six objects hardly show how far the curve bends: one beyond the others bends it rightly."""
    rng, circuit = np.random.default_rng(seed), Circuit(12, 12)
    fabric = PressureCurve((0.0, 0.3, 1.0, 4.0, 9.8), (60e3, 9e3, 3e3, 500.0, 110.0))
    fabric = fabric.with_gain(np.exp(0.06 * rng.standard_normal(circuit.shape)))
    laid, weights = presses(6, circuit.shape, rng)
    weights = np.array([1.2, 2.6, 3.1, 5.1, 22.0, 27.0]) / weights
    laid = np.concatenate([np.zeros((20, *circuit.shape)), laid * weights[:, None, None]])
    frames = read_out(circuit, forward(circuit, fabric.resistance(laid)), "scan", rng)
    rest = measure_rest(frames[:20], circuit)
    weights = np.minimum(laid[20:], fabric.max_force).sum((1, 2))
    assert fit_curve(frames[20:], weights, circuit, rest).odd == ()


def test_frames_of_one_object_are_left_out_together(bench):
    """What they say of it is of no use to check it; frames that repeat make no error smaller."""
    chosen = np.repeat(np.arange(6), 3)
    many, few = bench.fit(bench.weights[chosen], chosen), bench.fit(bench.weights[:6], slice(6))
    assert "6 weights" in many.message
    np.testing.assert_allclose(many.off[::3], few.off, atol=0.05)
    assert many.error > 0.7 * few.error


def test_equal_weights_tell_the_level_only(bench):
    """One object laid four times: said, and its own total is right."""
    force = np.array([np.roll(bench.laid[0], k, (0, 1)) for k in range(4)])
    frames = bench.board.frames(force)
    found = fit_curve(frames, np.full(4, bench.weights[0]), bench.circuit, bench.rest)
    assert "all weights are equal" in found.message
    np.testing.assert_allclose(
        totals(frames, bench.circuit, found.curve, bench.rest), bench.weights[0], rtol=0.1
    )


def test_three_weights_are_enough_for_a_level(bench):
    assert np.median(np.abs(bench.off(bench.fit(bench.weights[:3], slice(3))))) < 0.1


@pytest.mark.parametrize(
    ("weights", "named"),
    [
        ([5.0, 9.0], "weights have shape"),
        ([5.0, -9.0, 12.0], "weight 1 = -9 N"),
        ([5.0, 9.0, np.nan], "weight 2 = nan N"),
        ([np.inf, 9.0, 8.0], "weight 0 = inf N"),
        ([0.0, 9.0, 8.0], "weight 0 = 0 N"),
    ],
)
def test_what_is_no_weight_is_refused(bench, weights, named):
    with pytest.raises(ValueError, match=named):
        bench.fit(weights, slice(3))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda frames, rest: frames[:2], "2 weights: 3 or more"),
        (lambda frames, rest: frames[:, :4], "shape"),
        (lambda frames, rest: np.insert(frames[:3], 2, rest, 0), "frame 2 shows no touch"),
    ],
)
def test_frames_that_tell_no_curve_are_refused(bench, change, named):
    frames = change(bench.frames, bench.rest.adc)
    with pytest.raises(ValueError, match=named):
        fit_curve(frames, bench.weights[: len(frames)], bench.circuit, bench.rest)


def test_the_order_does_not_matter(bench, fitted):
    order = np.random.default_rng(0).permutation(len(bench.weights))
    again = bench.fit(bench.weights[order], order)
    np.testing.assert_allclose(again.curve.points, fitted.curve.points, rtol=1e-6)
    np.testing.assert_allclose(again.off, fitted.off[order], atol=1e-6)


def test_the_shipped_fabric_gives_the_shipped_curve():
    """Ideal cells on the shipped curve: its points come back."""
    circuit, shipped = Unknown(SHAPE, seed=0).supposed, PressureCurve()
    laid, weights = objects(8, SHAPE, np.random.default_rng(1))
    idle = np.repeat(forward(circuit, shipped.resistance(np.zeros((1, *SHAPE)))), 2, 0)
    frames = forward(circuit, shipped.resistance(laid))
    found = fit_curve(frames, weights, circuit, measure_rest(idle, circuit)).curve
    np.testing.assert_allclose(found.resistance(0.5), shipped.resistance(0.5), rtol=0.01)
    np.testing.assert_allclose(found.resistance(4.0), shipped.resistance(4.0), rtol=0.01)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.01, 100.0))
def test_heavier_labels_give_a_heavier_curve(factor):
    """All weights times a number: so is each force of the curve."""
    rng = np.random.default_rng(0)
    ramps, weights = rng.uniform(0.1, 1.0, (6, 3, 3, 8)), rng.uniform(30.0, 50.0, 6)
    one, other = (Totals.of(ramps, f * weights).explained() for f in (1.0, factor))
    np.testing.assert_allclose(other.slope, factor * one.slope, rtol=1e-6)
    np.testing.assert_allclose(other.gain, one.gain, rtol=1e-6)


def test_a_wrong_circuit_is_told(bench):
    """By frames that it does not explain; cells may make up for an r_par that is less far off."""
    wrong = replace(bench.circuit, r_par=2.0 * bench.circuit.r_par)
    found = fit_curve(bench.frames, bench.weights, wrong, bench.rest)
    assert "find what lies in series by touches" in found.message
    less = replace(bench.circuit, r_par=1.3 * bench.circuit.r_par)
    found = fit_curve(bench.frames, bench.weights, less, bench.rest)
    assert found.error > 0.1  # it is said


def test_crossings_that_are_not_read_are_done_without(bench):
    frames = bench.frames.copy()
    frames[np.random.default_rng(0).random(frames.shape) < 0.03] = np.nan
    found = fit_curve(frames, bench.weights, bench.circuit, bench.rest)
    assert np.median(np.abs(bench.off(found))) < 0.04


totals_of_ramps = st.lists(
    st.lists(st.floats(0.01, 30.0), min_size=8, max_size=8), min_size=3, max_size=12
)


@settings(max_examples=60, deadline=None)
@given(totals_of_ramps, st.lists(st.floats(0.5, 100.0), min_size=12, max_size=12))
def test_whatever_the_totals_the_curve_rises(ramps, weights):
    """Contradictory ones too: the solver's bound keeps each slope above 0."""
    ramps, weights = np.array(ramps), np.array(weights)[: len(ramps)]
    knots = curve_fit.Knots(np.append(0.0, 1e-4 * 2.0 ** np.arange(8)))
    fit = Totals.of(ramps[:, None, None], weights).explained()
    assert (fit.gain > 0.0).all()
    force, resistance = np.array(knots.curve(fit.slope, 1.0 / 40000.0).points).T
    assert (np.diff(force) > 0.0).all()
    assert (np.diff(resistance) < 0.0).all()


def test_slopes_and_gains_that_made_the_totals_come_back():
    """Where there are more totals than cells, and none of them errs."""
    rng = np.random.default_rng(3)
    force = rng.uniform(0.0, 4.0, (60, 4, 4)) * (rng.random((60, 4, 4)) < 0.4)
    ramps = np.stack([np.minimum(force, 2.0), np.maximum(force - 2.0, 0.0)], 3)
    gain = rng.uniform(0.7, 1.3, (4, 4))
    gain /= gain.mean()
    slope = np.array([1.2, 1.1])
    fit = Totals.of(ramps, ((ramps @ slope) * gain).sum((1, 2)), slope).explained()
    np.testing.assert_allclose(fit.gain, gain.ravel(), atol=0.02)
    np.testing.assert_allclose(fit.slope, slope, rtol=0.03)
    assert fit.scatter == 0.16


def test_a_cell_of_which_no_total_tells_has_a_gain_of_1():
    """Beside one on which five of twelve objects lay, and which feels a third more."""
    rng, force = np.random.default_rng(0), np.zeros((12, 3, 3))
    force[:5, 1, 1] = np.linspace(2.0, 6.0, 5)
    force[5:, 0, :] = rng.uniform(2.0, 6.0, (7, 3))
    weights = (force * np.where(np.arange(9).reshape(3, 3) == 4, 1.3, 1.0)).sum((1, 2))
    fit = Totals.of(force[..., None], weights).explained()
    gain = fit.gain.reshape(3, 3)
    assert gain[1, 1] > 1.1
    np.testing.assert_array_equal(gain[[1, 1, 2, 2, 2], [0, 2, 0, 1, 2]], 1.0)


@pytest.fixture(scope="module")
def streamed():
    """A minute of presses, and a scale that is 0.3 s late."""
    board, rng = Unknown((8, 8), seed=6), np.random.default_rng(6)
    circuit = known(board)
    return board, stream(board, 25, 0.3, rng), circuit, measure_rest(board.at_rest(), circuit)


@pytest.mark.ci
def test_a_scale_in_place_of_weights(streamed):
    """Its zero and its lag are found; new objects weigh what they weigh."""
    board, given, circuit, rest = streamed
    fitted, late = fit_reference(*given, circuit, rest)
    assert late == pytest.approx(0.3, abs=0.01)
    assert len(fitted.off) >= 20 and fitted.odd == ()
    laid, truth = objects(20, (8, 8), np.random.default_rng(7))
    off = totals(board.frames(laid), circuit, fitted.curve, rest) / truth - 1.0
    assert np.median(np.abs(off)) < 0.03


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda f, t, r, at: (f, t, np.roll(r, 400), at), "does not follow"),
        (lambda f, t, r, at: (f, t, r, at + 100.0), "does not follow"),
        (lambda f, t, r, at: (f, t, np.full(r.size, 3.0), at), "does not follow"),
        (lambda f, t, r, at: (f, t[::-1], r, at), "times have shape"),
        (lambda f, t, r, at: (f, t, r[:-1], at), "reference_times have shape"),
        (lambda f, t, r, at: (f[:60], t[:60], r, at), "less than 3 s"),
        (lambda f, t, r, at: (f[:140], t[:140], r, at), "presses: 3"),
    ],
)
def test_a_reference_that_is_none_is_told(streamed, change, why):
    _, given, circuit, rest = streamed
    with pytest.raises(ValueError, match=why):
        fit_reference(*change(*given), circuit, rest)
