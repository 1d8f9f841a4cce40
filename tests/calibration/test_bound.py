# SPDX-License-Identifier: Apache-2.0
"""What a touch may be at most, by what is not known of its skin: the truth is not above it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_skin import Circuit, PressureCurve, compensate, forward, measure_rest
from tactile_skin.calibration.bound import ONE_IN_TWENTY, PARTS, Unknown, scale_at_rest, upper_bound
from tactile_skin.calibration.identify import Solution
from tactile_skin.calibration.tracker import CircuitTracker
from tactile_skin.findings.finding import Severity
from tactile_skin.physics.proof import UNPROVED
from tactile_skin.physics.readouts import DRIVEN, PASSIVE

CURVE = PressureCurve()
LIMIT = 30.0  # N
READOUTS = {"floating": 1780.0, "loaded": 1000.0, "grounded": 300.0, "virtual_ground": 300.0}


def palm(shape, newtons, seed=0):
    """A palm whose pressure is uneven by 15 %, somewhere about the middle."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape)
    row, col = rng.uniform(0.3, 0.7, 2) * (np.array(shape) - 1)
    width = min(shape) / 4
    felt = np.exp(-((y - row) ** 2 + (x - col) ** 2) / (2 * width**2))
    felt *= np.exp(0.15 * rng.standard_normal(shape))
    return newtons * felt / felt.sum()


def felt(board, circuit, truth, curve=CURVE, fabric=CURVE, scale=1.0, method="map"):
    """What a skin of this circuit feels of it: force, and the curve with its rest."""
    rng = np.random.default_rng(5)
    fabric = fabric.resting_at(
        fabric.rest_resistance * np.exp(0.05 * rng.standard_normal(truth.shape))
    )

    def read(force):
        steps = forward(board, fabric.resistance(force)) * scale * circuit.full_scale
        steps = np.rint(steps + 0.5 * rng.standard_normal(steps.shape))
        return np.clip(steps, 0, circuit.full_scale) / circuit.full_scale

    rest = measure_rest(np.array([read(0.0 * truth) for _ in range(40)]), circuit)
    tared = curve.resting_at(1.0 / rest.conductance)
    return compensate(read(truth), circuit, tared, method, noise=0.6).force, tared


def most(force, circuit, curve, **unknown):
    """The sums of what the cells may feel, by the circuit and in all [N]."""
    return upper_bound(force, None, circuit, curve, Unknown(**unknown)).sum((0, 1))


@pytest.mark.parametrize("readout", PASSIVE)
@pytest.mark.parametrize(("newtons", "side"), [(4.0, 3), (2.25, 4), (1.44, 5)])
def test_a_palm_counts_with_what_all_its_cells_hide(readout, newtons, side):
    """Touches of 36 N on a board whose r_par is a fifth above what is configured."""
    circuit = Circuit(readout=readout)
    board = replace(circuit, r_par=1.2 * circuit.r_par)
    truth = np.zeros(circuit.shape)
    truth[3 : 3 + side, 4 : 4 + side] = newtons
    found = compensate(forward(board, CURVE.resistance(truth)), circuit, CURVE, "newton", noise=0.5)
    touched, unknown = found.force * (truth > 0.0), board.r_par - circuit.r_par
    assert most(touched, circuit, CURVE, series=unknown)[1] >= LIMIT
    assert most(touched / 3.0, circuit, CURVE, series=unknown)[1] < LIMIT


@pytest.mark.parametrize("driven", DRIVEN)
@pytest.mark.parametrize("readout", PASSIVE)
@pytest.mark.parametrize("touch", [np.s_[7, :], np.s_[:, 7], np.s_[6:8, 2:14], np.s_[2:7, 5:10]])
def test_a_touch_along_any_line_counts_with_what_it_may_have(touch, readout, driven):
    """29 N that a missing 20 ohm hides a part of."""
    circuit = Circuit(readout=readout)
    circuit = replace(circuit, driven=driven if readout != "floating" else circuit.driven)
    truth = np.zeros(circuit.shape)
    truth[touch] = 29.0 / truth[touch].size
    adc = forward(replace(circuit, r_par=circuit.r_par + 20.0), CURVE.resistance(truth))
    found = compensate(adc, circuit, CURVE, "newton", noise=0.5).force * (truth > 0.0)
    assert most(found, circuit, CURVE, series=20.0)[1] > 0.99 * 29.0


@pytest.mark.parametrize("shape", [(8, 8), (16, 16)])
@pytest.mark.parametrize("entered", [0.0, 163.0, 220.0])
@pytest.mark.parametrize("readout", PASSIVE)
def test_parts_that_nobody_entered_hide_no_push(shape, entered, readout):
    """45 N behind the paper's multiplexers, of which too little or nothing was entered."""
    board = Circuit(*shape, r_ref=READOUTS[readout], r_par=326.0, readout=readout)
    circuit = replace(board, r_par=entered)
    force, curve = felt(board, circuit, palm(shape, 45.0, seed=3))
    unknown = {"series": PARTS - entered, "factor": UNPROVED, "proved": False}
    assert force.sum() < 0.8 * 45.0
    assert most(force, circuit, curve, **unknown)[1] >= LIMIT


# a fabric that conducts a quarter more, on a supply that is low, rests as the usual one does: only
# a weight shows it
@pytest.mark.parametrize("shape", [(8, 8), (16, 16)])
@pytest.mark.parametrize(
    ("wrong", "share"),
    [("supply", 1.0), ("supply", 1.2)]
    + [(w, s) for w in ("full scale", "r_ref", "r_ref by 10") for s in (0.8, 1.0, 1.2)],
)
@pytest.mark.parametrize("readout", READOUTS)
def test_a_scale_that_is_off_shows_in_the_rest(shape, share, wrong, readout):
    """45 N on boards of which a scale is entered wrong, with fabrics of +-20 %."""
    r_par = 0.0 if readout == "virtual_ground" else 326.0
    board = Circuit(*shape, r_ref=READOUTS[readout], r_par=r_par, readout=readout)
    times = {"r_ref": 2.0, "r_ref by 10": 10.0}.get(wrong, 1.0)
    scale = {"supply": 0.6, "full scale": 1023 / 2000}.get(wrong, 1.0)
    loads, ohms = np.array(CURVE.points).T
    fabric = PressureCurve(loads, ohms * share)
    circuit = replace(board, r_ref=times * board.r_ref)
    force, curve = felt(board, circuit, palm(shape, 45.0, seed=4), fabric=fabric, scale=scale)
    s = scale_at_rest(circuit, curve)
    series = max(PARTS - r_par, 0.0)
    unknown = {"series": series, "factor": UNPROVED, "proved": False, "scale": s}
    assert s < 0.75
    assert most(force, circuit, curve, **unknown)[1] >= LIMIT


@pytest.mark.parametrize("share", [0.75, 1.0, 1.35])
@pytest.mark.parametrize("readout", READOUTS)
def test_a_right_skin_that_is_not_proved_is_free_under_8_newtons(share, readout):
    loads, ohms = np.array(CURVE.points).T
    board = Circuit(16, 16, r_ref=READOUTS[readout], readout=readout)
    fabric = PressureCurve(loads, ohms * share)
    force, curve = felt(board, board, palm(board.shape, 8.0, seed=2), fabric=fabric)
    s = scale_at_rest(board, curve)
    unknown = {"series": PARTS, "factor": UNPROVED, "proved": False, "scale": s}
    total = force.sum()
    assert s == 1.0 and most(force, board, curve, **unknown)[1] < LIMIT * max(total / 8.0, 1.0)


@given(
    st.floats(0.0, 9.0),
    st.floats(0.0, 400.0),
    st.floats(0.1, 1.0),
    st.floats(1.0, 2.5),
    st.booleans(),
)
def test_a_bound_is_no_less_than_what_is_felt_and_grows_with_what_is_unknown(
    newtons, series, scale, factor, proved
):
    circuit, force = Circuit(4, 4), np.zeros((4, 4))
    force[1, 2] = newtons
    bound = upper_bound(force, None, circuit, CURVE, Unknown(series, scale, factor, proved))
    assert (bound >= force[..., None]).all() and (bound[force == 0.0] == 0.0).all()
    more = upper_bound(force, None, circuit, CURVE, Unknown(series + 9, scale, factor, proved))
    assert (more >= bound - 1e-9).all()


def test_a_skin_of_which_all_is_known_counts_with_what_it_feels():
    force = palm((8, 8), 20.0)
    assert most(force, Circuit(8, 8), CURVE).tolist() == pytest.approx([20.0, 20.0])


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_cells_that_feel_more_or_less_hide_as_much_of_what_they_feel(gain):
    """Half the gain, half the force at the same resistance: as far off, in proportion."""
    circuit, force = Circuit(8, 8), palm((8, 8), 20.0)
    scaled = CURVE.with_gain(np.full((8, 8), gain))
    one = most(force, circuit, CURVE, series=65.0)
    assert most(gain * force, circuit, scaled, series=65.0) == pytest.approx(gain * one)


def test_a_cell_that_was_not_read_counts_with_its_error_where_something_touches():
    circuit, force, std = Circuit(4, 4), np.zeros((4, 4)), np.zeros((4, 4))
    force[1, 1:3], std[1, 2], std[3, 3] = 2.0, 1.5, 3.0
    bound = upper_bound(force, std, circuit, CURVE, Unknown())
    assert bound[1, 2, 1] == pytest.approx(2.0 + ONE_IN_TWENTY * 1.5)
    assert bound[3, 3, 1] == 0.0, "nothing touches there"


@pytest.mark.parametrize(("guess", "used", "unknown"), [(30, 0, 37), (-30, 0, 7), (30, 30, 7)])
def test_what_touches_make_likely_and_is_not_used_yet_counts(guess, used, unknown):
    tracker = CircuitTracker(Circuit(8, 8))
    tracker.std = np.array([7.0, 1.0])
    tracker._off, tracker._adopted = np.array([guess, 0.0]), np.array([used, 0.0])
    assert tracker.unknown() == tracker.unknown(parts=PARTS) == unknown
    assert tracker.unknown(changed=True) == pytest.approx(unknown - 7.0 + 0.2 * 326.0)


@pytest.mark.parametrize(("std", "doubted"), [(8.0, True), (19.0, True), (25.0, False)])
def test_a_few_touches_warn_of_r_par_if_they_tell_it(monkeypatch, std, doubted):
    """A guess, surer of nothing than a data sheet is, warns of no sound board."""
    tracker = CircuitTracker(Circuit(8, 8))
    found = Solution(np.array([90.0, 0.0]), np.eye(2), np.array([std, 1.0]), 1)
    monkeypatch.setattr(tracker, "_solve", lambda asked: found)
    tracker._asked.append(None)
    said = tracker._suggested()
    assert [(f.form, f.severity) for f in said] == [("likely", Severity.WARN)] * doubted
