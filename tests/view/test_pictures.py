# SPDX-License-Identifier: Apache-2.0
"""What is drawn of a snapshot, and that it comes through the wire as it is."""

from dataclasses import replace

import numpy as np
import pytest
from support.page import unpack

from tactile_skin import forward
from tactile_skin.middleware.config import skin_of
from tactile_skin.msg import DiagnosticArray, DiagnosticStatus, Header, KeyValue, Time, cloud, image
from tactile_skin.nodes.gesture_feature import contact_cloud
from tactile_skin.touch import features
from tactile_skin.touch.tracking import Tracker
from tactile_skin.view.pictures import PUBLISHED, Pictures, findings, packed_with, parts_of
from tactile_skin.view.snapshot import CONTACT, STOP, Collector, NodeStatus, Snapshot

SKIN = skin_of({"geometry.shape": "cylinder"}, "")
RNG = np.random.default_rng(5)


def header(seconds: float) -> Header:
    return Header(Time(int(seconds), round(seconds % 1 * 1e9)))


def touched(row=5, col=9, newtons=2.0) -> np.ndarray:
    force = np.zeros((16, 16))
    force[row : row + 2, col : col + 3] = newtons
    return force


def samples(force, r_par=None) -> np.ndarray:
    """skin/adc of a noiseless board."""
    circuit = SKIN.circuit
    ratio = forward(circuit, SKIN.curve.resistance(force))
    return np.rint(ratio * circuit.full_scale * 64).astype(np.uint16)


def snapshot_of(force, **more) -> Snapshot:
    pressure = np.float32(force / SKIN.geometry.cell_area)
    return Snapshot(stamp=1.0, adc=samples(force), pressure=pressure, **more)


def drawn(snapshot, a=PUBLISHED, b="naive"):
    return unpack(Pictures(SKIN).message(snapshot, a, b, {}))


def test_numbers_and_arrays_come_back_as_they_were_packed():
    arrays = {
        "a": np.float32([[1.5, np.nan]]),
        "odd": np.uint8([1, 2, 3]),
        "b": np.uint16([[1], [65535], [3]]),
        "none": np.zeros((0, 8), np.float32),
    }
    head, found = unpack(packed_with({"more": 2}, *parts_of({"text": "µ"}, arrays)))
    assert head == {"more": 2, "text": "µ"} and found.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)


def test_a_picture_belongs_to_its_reading():
    """A pressure picture comes when the next reading may be there already."""
    collector, one, two = Collector(), samples(touched()), samples(touched(2, 2))
    assert collector.snapshot().adc is None
    collector.take("skin/adc", image(one, "16UC1", header(1.0)))
    assert collector.snapshot().pressure is None
    collector.take("skin/adc", image(two, "16UC1", header(1.01)))
    collector.take("skin/pressure", image(touched(), "32FC1", header(1.0)))
    snapshot = collector.snapshot()
    assert snapshot.stamp == 1.0 and snapshot.pressure is not None
    np.testing.assert_array_equal(snapshot.adc, one)
    for k in range(1, 31):  # from here on every frame fails: the readings are shown all the same
        collector.take("skin/adc", image(two, "16UC1", header(1.0 + 0.01 * k)))
    snapshot = collector.snapshot()
    assert snapshot.stamp == 1.3 and snapshot.pressure is None


def test_contacts_are_those_of_the_picture_that_is_shown():
    """The next picture is there before its contacts: until they come the last one is shown."""
    force, collector = touched(), Collector()
    tracker = Tracker(SKIN.geometry.pitch)

    def see(k, parts):
        at = header(1.0 + 0.01 * k)
        if "adc" in parts:
            collector.take("skin/adc", image(samples(force), "16UC1", at))
            pressure = image(k * force / SKIN.geometry.cell_area, "32FC1", at)
            collector.take("skin/pressure", pressure)
        if "contacts" in parts:
            frame = features.analyse_frame(k * force, SKIN.geometry, 0.2)
            touches = tracker.update(0.01 * k, frame)
            collector.take("skin/contacts", contact_cloud(touches, at))
        return collector.snapshot()

    def together(snapshot):
        newtons = (snapshot.pressure * SKIN.geometry.cell_area).sum()
        return snapshot.contacts[:, 3].sum() == pytest.approx(newtons, rel=1e-3)

    assert together(see(1, "adc contacts"))
    late = see(2, "adc")
    assert late.stamp == 1.01 and together(late)
    assert together(see(2, "contacts")) and collector.snapshot().stamp == 1.02
    for k in range(3, 30):
        snapshot = see(k, "adc")
    assert snapshot.stamp == 1.29 and len(snapshot.contacts) == 1, "not taken for released"
    for k in range(30, 90):
        snapshot = see(k, "adc")
    assert snapshot.stamp == 1.89 and len(snapshot.contacts) == 0


def test_the_spread_that_the_skin_published_is_drawn_as_it_is():
    """Solved once: the page's process does not do the skin's work again."""
    force, area = touched(), SKIN.geometry.cell_area
    collector, spread = Collector(), np.full(force.shape, 3.0)
    collector.take("skin/adc", image(samples(force), "16UC1", header(1.0)))
    collector.take("skin/pressure", image(force / area, "32FC1", header(1.0)))
    collector.take("skin/pressure_std", image(spread / area, "32FC1", header(0.99)))
    assert collector.snapshot().std is None, "of another reading"
    assert drawn(collector.snapshot())[1]["std"].max() < 0.5
    collector.take("skin/pressure_std", image(spread / area, "32FC1", header(1.0)))
    snapshot = collector.snapshot()
    np.testing.assert_allclose(drawn(snapshot)[1]["std"], spread, rtol=1e-6)
    assert drawn(snapshot, a="map")[1]["std"].max() < 0.5


def test_a_stop_and_its_reason_and_what_nodes_say_are_collected():
    collector = Collector()
    status = DiagnosticStatus(2, "stop_on_push", "push")
    collector.take(STOP, DiagnosticArray(Header(), [status]))
    pairs = [KeyValue("residual", "0.4")]
    said = DiagnosticStatus(1, "left/compensation", "a message", "tactile_skin", pairs)
    collector.take("skin/diagnostics", DiagnosticArray(Header(), [said]))
    snapshot = collector.snapshot()
    assert snapshot.stop and snapshot.reason == "push"
    assert snapshot.nodes["left/compensation"].values == {"residual": "0.4"}


@pytest.mark.parametrize("method", [PUBLISHED, "newton", "map"])
def test_the_pictures_are_of_the_force_that_presses(method):
    force = touched()
    head, pictures = drawn(snapshot_of(force), a=method)
    assert not head["errors"]
    np.testing.assert_allclose(pictures["a"], force, atol=0.1)
    assert np.abs(pictures["misfit"]).max() < 2.0 and pictures["std"].max() < 0.5
    assert pictures["b"].sum() > 1.3 * force.sum()  # naive sees ghosts
    reading = pictures["reading"]
    np.testing.assert_allclose(reading, samples(force) / 64.0, atol=0.01)


def test_the_misfit_is_the_readings_minus_the_models():
    force = touched()
    adc = samples(force)
    adc[3, 4] += 64 * 20
    snapshot = Snapshot(adc=adc, pressure=np.float32(force / SKIN.geometry.cell_area))
    misfit = drawn(snapshot)[1]["misfit"]
    assert misfit[3, 4] == pytest.approx(20.0, abs=0.5)
    assert np.abs(np.delete(misfit.ravel(), 3 * 16 + 4)).max() < 0.5


def test_the_skins_own_rest_and_circuit_count():
    """What it published is explained by what it knows of its board, not by the configuration."""
    rest = 40000.0 * np.exp(0.1 * RNG.standard_normal((16, 16)))
    circuit = replace(SKIN.circuit, r_par=360.0)
    force, curve = touched(), SKIN.curve.resting_at(rest)
    adc = forward(circuit, curve.resistance(force)) * circuit.full_scale * 64
    said = {"compensation": NodeStatus(0, "ok", {"r_par": "360.0"})}
    pressure = np.float32(force / SKIN.geometry.cell_area)
    snapshot = Snapshot(adc=np.rint(adc).astype(np.uint16), pressure=pressure)
    assert np.abs(drawn(snapshot)[1]["misfit"]).max() > 3.0
    known = Snapshot(adc=snapshot.adc, pressure=pressure, rest=np.float32(rest), nodes=said)
    _, pictures = drawn(known, b="newton")
    assert np.abs(pictures["misfit"]).max() < 0.1
    np.testing.assert_allclose(pictures["b"], force, atol=0.1)


def test_a_method_that_cannot_is_said_and_the_others_are_drawn():
    snapshot = snapshot_of(touched())
    adc = snapshot.adc.copy()
    adc[0, 0] = 65535  # not read
    head, pictures = drawn(Snapshot(adc=adc, pressure=snapshot.pressure), a="map", b="naive")
    assert "b" in head["errors"] and "b" not in pictures
    assert np.isnan(pictures["reading"][0, 0]) and np.isfinite(pictures["a"]).all()
    head, pictures = drawn(Snapshot(adc=snapshot.adc))
    assert "a" in head["errors"] and "reading" in pictures and "b" in pictures
    for bad in (np.full((16, 16), 65535, np.uint16), np.zeros((8, 8), np.uint16)):
        head, pictures = drawn(Snapshot(adc=bad))
        assert head["errors"].keys() == {"a", "b"} and pictures == {}
    head, pictures = drawn(Snapshot())
    assert pictures == {} and head["stop"] is None


def test_contacts_and_push_are_where_they_press():
    """A cylinder's contact, in metres, comes back to its row and column."""
    force = touched(5, 12)
    frame = features.analyse_frame(force, SKIN.geometry, 0.2)
    tracker = Tracker(SKIN.geometry.pitch)
    touches = tracker.update(0.0, frame)
    collector = Collector()
    collector.take("skin/adc", image(samples(force), "16UC1", header(1.0)))
    collector.take("skin/pressure", image(force / SKIN.geometry.cell_area, "32FC1", header(1.0)))
    collector.take("skin/contacts", contact_cloud(touches, header(1.0)))
    head, _ = drawn(collector.snapshot())
    (contact,) = head["contacts"]
    assert contact["row"] == pytest.approx(5.5, abs=0.1)
    assert contact["col"] == pytest.approx(13.0, abs=0.1)
    assert contact["force"] == pytest.approx(12.0, rel=0.01)
    assert head["push"]["row"] == pytest.approx(5.5, abs=0.1)
    assert np.hypot(*head["push"]["way"]) < 0.05  # a push along the normal
    assert head["push"]["direction"][0] < 0.0


def test_a_contact_has_the_name_of_its_gesture():
    """By its id; a gesture without a touch, or without a name yet, is nobody's."""
    collector = Collector()
    collector.take("skin/adc", image(samples(touched(5, 12)), "16UC1", header(1.0)))
    where = {name: np.zeros(2) for name in CONTACT} | {"id": np.array([3.0, 4.0])}
    collector.take("skin/contacts", cloud(where, header(1.0)))
    classes = {"p_pat": [0.1, 0.9, 0.2], "p_stroke": [0.9, 0.1, 0.3]}
    named = {"touch": [4.0, 0.0, 3.0], "label": [1.0, 0.0, -1.0]} | classes
    collector.take("skin/gesture_classes", cloud(named, header(1.0)))
    head, _ = drawn(collector.snapshot())
    assert [(c["id"], c["gesture"]) for c in head["contacts"]] == [(3, ""), (4, "stroke")]


@pytest.mark.parametrize(
    ("rows", "cols", "marked"),
    [
        ("", "5", [([], [5])]),
        ("2 15", "", [([2, 15], [])]),
        ("2 5", "7 3", [([2], [7]), ([5], [3])]),  # cells, one by one
        ("", "", []),
        ("two", "5", [([], [5])]),  # another node's own value
    ],
)
def test_lines_that_a_node_found_are_marked(rows, cols, marked):
    values = {"rows": rows, "cols": cols}
    found = findings(Snapshot(nodes={"compensation": NodeStatus(1, "why", values)}))
    assert [(f["rows"], f["cols"]) for f in found] == marked
    assert all(f["text"] == "why" for f in found)
    assert findings(Snapshot(nodes={"compensation": NodeStatus(0, "why", values)})) == []
