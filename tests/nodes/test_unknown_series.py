# SPDX-License-Identifier: Apache-2.0
"""Until touches have told r_par, the stop counts a hard touch with what it may have at most."""

from dataclasses import replace

import numpy as np
import pytest
from support.bench import Bench

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.calibration.identify import Solution
from tactile_skin.calibration.tracker import CircuitTracker
from tactile_skin.findings.finding import Finding, Kind, Severity
from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    KeyValue,
    PointCloud2,
    cloud,
    image,
)
from tactile_skin.nodes import diagnostics
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.nodes.stop_on_push import StopOnPush
from tactile_skin.physics.readouts import DRIVEN, PASSIVE

CELL_AREA = 1e-4  # m^2, only a scale: all cells are alike


def stop_under(force, peak, unknown=None, gain=1.0, picture=None, **circuit):
    """Return the stop [N] under one contact when compensation does not know so much of r_par.

    Args:
        unknown: of one, or of several nodes.
        picture: (rows, cols) [N]; None: none arrives.
        circuit: of its parameters.
    """
    bench = Bench()
    gain = np.atleast_1d(gain).tolist()
    given = {"curve.gain": gain, "peak": 9.0 * min(gain)}
    given |= {f"circuit.{name}": value for name, value in circuit.items()}
    stop, other = StopOnPush(bench.node("stop_on_push", given)), bench.node("other")
    contacts = other.create_publisher(PointCloud2, "skin/contacts", 10)
    pictures = other.create_publisher(Image, "skin/pressure", 10)
    reports = other.create_publisher(DiagnosticArray, diagnostics.TOPIC, 10)
    for _ in range(30):
        bench.clock.advance(0.01)
        header = bench.header()
        for k, ohm in enumerate(() if unknown is None else np.atleast_1d(unknown)):
            values = [KeyValue(diagnostics.UNKNOWN_SERIES, f"{ohm:.1f}")]
            status = DiagnosticStatus(DiagnosticStatus.OK, f"compensation_{k}", "ok", "", values)
            reports.publish(DiagnosticArray(header, [status]))
        columns = {"x": [0.0], "y": [0.0], "z": [0.0], "force": [force], "peak": [peak]}
        if picture is not None:
            pictures.publish(image(picture / CELL_AREA, "32FC1", header))
        contacts.publish(cloud(columns, header))
        bench.spin()
    return stop


def decided(*given, **more):
    """Return what the stop says."""
    stop = stop_under(*given, **more)
    return stop.policy.decide(stop.node.get_clock().now().nanoseconds / 1e9).reason


@pytest.mark.parametrize(("force", "peak"), [(25.0, 4.0), (12.0, 6.5)])
def test_a_hard_touch_counts_with_what_it_may_have(force, peak):
    assert decided(force, peak, 65.0) == "push"
    assert decided(force, peak, 5.0) == "", "r_par is known"
    assert decided(force, peak) == "", "no r_par is told: the forces are somebody else's"


@pytest.mark.parametrize(("force", "peak"), [(20.0, 0.5), (12.0, 3.0), (5.0, 5.0)])
def test_a_soft_or_light_one_does_not_stop(force, peak):
    assert decided(force, peak, 65.0) == ""


@pytest.mark.parametrize("readout", PASSIVE)
@pytest.mark.parametrize(("newtons", "side"), [(4.0, 3), (2.25, 4), (1.44, 5)])
def test_a_palm_counts_with_what_all_its_cells_hide(readout, newtons, side):
    """Touches of 36 N on a board whose r_par is a fifth above what is configured."""
    circuit, curve = Circuit(readout=readout), PressureCurve()
    board = replace(circuit, r_par=1.2 * circuit.r_par)
    truth = np.zeros(circuit.shape)
    truth[3 : 3 + side, 4 : 4 + side] = newtons
    found = compensate(forward(board, curve.resistance(truth)), circuit, curve, "newton", noise=0.5)
    touched = found.force * (truth > 0.0)
    unknown = board.r_par - circuit.r_par
    given = {"readout": readout, "picture": touched}
    assert decided(touched.sum(), touched.max(), unknown, **given) == "push"
    assert decided(touched.sum() / 3.0, touched.max() / 3.0, unknown, **given) == ""


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("driven", DRIVEN)
@pytest.mark.parametrize("readout", PASSIVE)
@pytest.mark.parametrize("touch", [np.s_[7, :], np.s_[:, 7], np.s_[6:8, 2:14], np.s_[2:7, 5:10]])
def test_a_touch_along_any_line_counts_with_what_it_may_have(touch, readout, driven, seen):
    """29 N that a missing 20 ohm hides a part of, with the picture of its lines and without."""
    circuit, curve = Circuit(readout=readout), PressureCurve()
    circuit = replace(circuit, driven=driven if readout != "floating" else circuit.driven)
    truth = np.zeros(circuit.shape)
    truth[touch] = 29.0 / truth[touch].size
    adc = forward(replace(circuit, r_par=circuit.r_par + 20.0), curve.resistance(truth))
    found = compensate(adc, circuit, curve, "newton", noise=0.5).force * (truth > 0.0)
    given = {"readout": readout, "driven": circuit.driven, "picture": found if seen else None}
    assert stop_under(found.sum(), found.max(), 20.0, **given)._most > 0.99 * 29.0


@pytest.mark.parametrize("readout", ["loaded", "grounded"])
def test_a_soft_palm_does_not_stop_where_its_picture_shows_how_it_lies(readout):
    """14 N on 6 x 6 cells, read aright, and 65 ohm that nobody has excluded."""
    palm = np.zeros(Circuit().shape)
    palm[3:9, 4:10] = 14.0 / 36.0
    assert decided(14.0, palm.max(), 65.0, readout=readout, picture=palm) == ""
    other = np.zeros(palm.shape)  # of no touch: it says nothing of the lines
    assert decided(14.0, palm.max(), 65.0, readout=readout, picture=other) == "push"


def test_of_several_compensations_the_one_that_knows_least_counts():
    assert decided(25.0, 4.0, (65.0, 5.0)) == decided(25.0, 4.0, (5.0, 65.0)) == "push"


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_cells_that_feel_more_or_less_hide_as_much_of_what_they_feel(gain):
    """Half the gain, half the force at the same resistance: as far off, in proportion."""
    assert decided(25.0, 4.0 * gain, 65.0, gain) == "push"
    assert decided(12.0 * gain, 0.5 * gain, 65.0, gain) == ""


def test_the_cell_that_hides_most_of_what_it_feels_counts():
    """On a cell of half the gain 2 N are 4 N of the curve; a contact does not say on which."""
    gain = np.ones(256)
    gain[100] = 0.5
    assert decided(20.0, 1.5, 65.0) == ""
    assert decided(20.0, 1.5, 65.0, gain) == decided(20.0, 1.5, 65.0, 0.5) == "push"


@pytest.mark.parametrize(("gain", "force"), [(1.0, 9.35), (0.5, 4.7)])
def test_a_cell_at_the_end_of_the_curve_may_feel_anything_and_stops(gain, force):
    assert decided(force, force, 65.0, gain) == decided(force, force, 0.0, gain) == "push"


@pytest.mark.parametrize(("force", "peak"), [(-2.0, 4.0), (5.0, -3.0)])
def test_a_negative_force_is_named_as_it_came(force, peak):
    found = f"fault: reading: invalid force: {force} N in all, {peak} N on one cell"
    assert found in decided(force, peak, 65.0)


def test_a_value_that_is_no_text_hides_no_error_behind_it():
    stop = StopOnPush(Bench().node("stop_on_push"))
    odd = DiagnosticStatus(
        DiagnosticStatus.OK, "one", "", "", [KeyValue(diagnostics.UNKNOWN_SERIES, None)]
    )
    error = DiagnosticStatus(DiagnosticStatus.ERROR, "other", "broken", "", [])
    stop.on_diagnostics(DiagnosticArray(Header(), [odd, error]))
    assert "fault: other: broken" in stop.policy.decide(10.0).reason


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), -1.0])
def test_a_value_that_is_none_changes_nothing(wrong):
    assert decided(25.0, 4.0, wrong) == ""


def test_compensation_says_how_much_of_r_par_may_be_missing():
    node = Compensation(Bench().node("compensation"))
    assert node.skin.unknown_series == pytest.approx(0.2 * node.skin.circuit.r_par)
    node.skin._tracker.std = np.array([7.0, 1.0])
    assert node.skin.unknown_series == 7.0
    node.skin._monitor.findings = lambda: [Finding(Kind.ALL_CELLS, numbers={"share": -0.006})]
    assert node.skin.unknown_series == pytest.approx(0.2 * node.skin.circuit.r_par)


def test_who_has_measured_r_par_says_how_well():
    node = Bench().node("compensation", {"circuit.r_par_std": 2.5})
    assert Compensation(node).skin.unknown_series == 2.5


@pytest.mark.parametrize(("guess", "used", "unknown"), [(30, 0, 37), (-30, 0, 7), (30, 30, 7)])
def test_what_touches_make_likely_and_is_not_used_yet_counts(guess, used, unknown):
    tracker = CircuitTracker(Circuit(8, 8))
    tracker.std = np.array([7.0, 1.0])
    tracker._off, tracker._adopted = np.array([guess, 0.0]), np.array([used, 0.0])
    assert tracker.unknown() == unknown
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
