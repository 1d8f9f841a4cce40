# SPDX-License-Identifier: Apache-2.0
"""The upper bound of a force on its way: compensation, skin/contacts, the stop."""

import datetime

import numpy as np
import pytest
from support.bench import Bench

from tactile_skin.findings.finding import Finding, Kind
from tactile_skin.msg import (
    PAIR,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    KeyValue,
    PointCloud2,
    cloud,
    cloud_columns,
    image,
)
from tactile_skin.nodes import diagnostics
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.nodes.gesture_feature import GestureFeature
from tactile_skin.nodes.stop_on_push import StopOnPush
from tactile_skin.physics.proof import UNPROVED, Proof

TODAY = datetime.date(2026, 11, 28)


def stop_under(force, peak, unknown="", **bounds):
    """Return the stop under one contact [N]."""
    bench = Bench()
    stop, other = StopOnPush(bench.node("stop_on_push")), bench.node("other")
    contacts = other.create_publisher(PointCloud2, "skin/contacts", 10)
    reports = other.create_publisher(DiagnosticArray, diagnostics.TOPIC, 10)
    for _ in range(30):
        bench.clock.advance(0.01)
        header = bench.header()
        values = [KeyValue(diagnostics.PROOF, "none"), KeyValue(diagnostics.UNKNOWN, unknown)]
        status = DiagnosticStatus(DiagnosticStatus.OK, "compensation", "ok", "", values)
        reports.publish(DiagnosticArray(header, [status]))
        columns = {"x": [0.0], "y": [0.0], "z": [0.0], "force": [force], "peak": [peak]}
        contacts.publish(cloud(columns | {name: [value] for name, value in bounds.items()}, header))
        bench.spin()
    return stop


def decided(*given, **more):
    stop = stop_under(*given, **more)
    return stop.policy.decide(stop.node.get_clock().now().nanoseconds / 1e9).reason


def test_the_stop_compares_the_bound_and_says_both():
    said = decided(14.0, 2.0, "scale series", bound=41.0, peak_bound=3.0)
    why = "newtons are not proved; r_par is not known yet"
    assert said == f"push: 14 N (may be 41 N: {why}), limit 30 N"
    assert decided(14.0, 2.0, bound=29.0, peak_bound=3.0) == ""
    said = decided(14.0, 2.0, "scale", bound=20.0, peak_bound=12.0)
    assert said == "push: 2 N on one cell (may be 12 N: newtons are not proved), limit 9 N"


def test_forces_of_somebody_else_count_as_they_are():
    assert decided(29.0, 4.0) == "" and "push" in decided(31.0, 4.0)


@pytest.mark.parametrize(("force", "peak"), [(-2.0, 4.0), (5.0, -3.0)])
def test_a_negative_force_is_named_as_it_came(force, peak):
    found = f"fault: reading: invalid force: {force} N in all, {peak} N on one cell"
    assert found in decided(force, peak, bound=9.0, peak_bound=9.0)


def test_a_value_that_is_no_text_hides_no_error_behind_it():
    stop = StopOnPush(Bench().node("stop_on_push"))
    values = [KeyValue(diagnostics.PROOF, None), KeyValue(diagnostics.UNKNOWN, "odd")]
    odd = DiagnosticStatus(DiagnosticStatus.OK, "one", "", "", values)
    error = DiagnosticStatus(DiagnosticStatus.ERROR, "other", "broken", "", [])
    stop.on_diagnostics(DiagnosticArray(Header(), [odd, error]))
    assert "fault: other: broken" in stop.policy.decide(10.0).reason


@pytest.mark.parametrize("order", ["bound first", "pressure first"])
def test_contacts_carry_the_bound_of_their_own_reading(order):
    bench = Bench()
    GestureFeature(bench.node("gesture_feature"))
    other, found = bench.node("other"), []
    pictures = {
        topic: other.create_publisher(Image, topic, 10)
        for topic in ("skin/pressure_bound", "skin/pressure")
    }
    other.create_subscription(PointCloud2, "skin/contacts", found.append, 10)
    for k in (1, 2):
        bench.clock.advance(0.01)
        pressure = np.zeros((16, 16))
        pressure[3, 4:6] = 1e4 * k
        bound = np.stack([1.2 * pressure, 3.0 * pressure], -1)
        sent = {"skin/pressure_bound": image(bound, PAIR, bench.header())}
        sent["skin/pressure"] = image(pressure, "32FC1", bench.header())
        for topic in sorted(sent, reverse=order == "bound first"):
            pictures[topic].publish(sent[topic])
        bench.spin()
    assert len(found) == 2
    for k, message in list(enumerate(found, 1))[order == "pressure first" :]:
        columns = cloud_columns(message)
        assert columns["bound"] == pytest.approx(3.0 * columns["force"])
        assert columns["peak_bound"] == pytest.approx(1.2 * columns["peak"])
        assert columns["force"] == pytest.approx(k * found_force(found))


def found_force(found):
    return cloud_columns(found[0])["force"][0]


def test_a_soft_touch_that_may_be_a_push_is_a_contact():
    """No cell feels 20 g, but a scale that is not known makes a body of it."""
    bench = Bench()
    GestureFeature(bench.node("gesture_feature"))
    other, found = bench.node("other"), []
    bounds = other.create_publisher(Image, "skin/pressure_bound", 10)
    pressures = other.create_publisher(Image, "skin/pressure", 10)
    other.create_subscription(PointCloud2, "skin/contacts", found.append, 10)
    pressure = np.full((16, 16), 0.05 / 1.44e-4)
    bounds.publish(image(np.stack([pressure, 9.0 * pressure], -1), PAIR, bench.header()))
    pressures.publish(image(pressure, "32FC1", bench.header()))
    bench.spin()
    assert found[0].width == 1 and cloud_columns(found[0])["bound"][0] > 100.0


def test_compensation_says_how_much_of_r_par_may_be_missing():
    node = Compensation(Bench().node("compensation", {"curve.proof": "weight"}))
    assert node.skin.unknown_series == pytest.approx(0.2 * node.skin.circuit.r_par)
    node.skin._tracker.std = np.array([7.0, 1.0])
    assert node.skin.unknown_series == 7.0
    node.skin._monitor.findings = lambda: [Finding(Kind.ALL_CELLS, numbers={"share": -0.006})]
    assert node.skin.unknown_series == pytest.approx(0.2 * node.skin.circuit.r_par)


def test_parts_that_nobody_has_measured_count_whatever_is_entered():
    for r_par in (0.0, 163.0, 326.0):
        node = Compensation(Bench().node("compensation", {"circuit.r_par": r_par}))
        assert r_par + node.skin.unknown_series == pytest.approx(400.0)


def test_who_has_measured_r_par_says_how_well():
    node = Bench().node("compensation", {"circuit.r_par_std": 2.5})
    assert Compensation(node).skin.unknown_series == 2.5


def test_a_simulated_board_is_proved():
    node = Compensation(Bench().node("compensation"))
    assert (node.skin.unknown.factor, node.skin.unknown.proved) == (UNPROVED, False)
    said = DiagnosticStatus(values=[KeyValue(diagnostics.SIMULATED, "true")])
    node.on_diagnostics(DiagnosticArray(Header(), [said]))
    assert (node.skin.unknown.factor, node.skin.unknown.proved) == (1.0, True)
    said.values[0].value = "false"  # the next port is a real board's
    node.on_diagnostics(DiagnosticArray(Header(), [said]))
    assert node.skin.unknown.factor == UNPROVED


@pytest.mark.parametrize(
    ("days", "least", "most"), [(0, 1.04, 1.06), (3, 1.09, 1.12), (99, 1.15, 1.17)]
)
def test_a_proof_ages(days, least, most):
    proof = Proof("weight", 0.05, TODAY - datetime.timedelta(days))
    assert least <= proof.factor(TODAY) <= most


def test_a_proof_without_a_day_is_old():
    assert Proof("weight", 0.05).factor(TODAY) == Proof("weight", 0.05, datetime.date.min).factor(
        TODAY
    )


def test_a_day_that_is_none_is_refused():
    with pytest.raises(
        ValueError, match=r"curve\.proof_date = 'today': must be a day, as 2026-11-28"
    ):
        Compensation(Bench().node("compensation", {"curve.proof_date": "today"}))


@pytest.mark.parametrize(("kind", "marked"), [(Kind.LOADED, False), (Kind.STUCK, True)])
def test_a_touch_that_stands_marks_no_line_as_bad(kind, marked):
    """The page draws a ring where a line or cell is at fault."""
    bench = Bench()
    node, found = Compensation(bench.node("compensation")), []
    other = bench.node("other")
    other.create_subscription(DiagnosticArray, diagnostics.TOPIC, found.append, 10)
    form = "stands" if kind is Kind.LOADED else "constant"
    node._finding = Finding(kind, form, rows=(1,), cols=(2,))
    node.report()
    bench.spin()
    said = {pair.key: pair.value for pair in found[-1].status[0].values}
    assert (diagnostics.ROWS in said) is marked
