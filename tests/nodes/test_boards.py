# SPDX-License-Identifier: Apache-2.0
"""compensation of boards as people have them: offset, full scale, polarity, absent crossings."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from support.bench import Bench
from support.marks import ci

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.calibration.tracker import CircuitTracker
from tactile_skin.findings.finding import Kind
from tactile_skin.middleware.bus import Node
from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    KeyValue,
    PointCloud2,
    String,
    cloud,
    cloud_of,
    image,
    image_array,
)
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.nodes.observers.monitor import Monitor
from tactile_skin.nodes.stop_on_push import STATUS, STATUS_TOPIC, StopOnPush, stop_message_of
from tactile_skin.physics.adc import NOT_READ, Adc
from tactile_skin.simulation.matrix import resting_curve

CELL_AREA = 1.44e-4
CIRCUIT = Circuit(8, 12, r_ref=4700.0, r_par=70.0, adc_bits=12)
GIVEN = {"rows": 8, "cols": 12, "r_ref": 4700.0, "r_par": 70.0, "adc_bits": 12}


class Fed(Bench):
    """A compensation node, and the board that feeds it 50 frames a second.

    Attributes:
        force: (rows, cols) of the last frame's picture [N].
    """

    def __init__(self, adc: Adc, **parameters):
        super().__init__()
        self.adc, self.rng = adc, np.random.default_rng(3)
        self.curve = resting_curve(PressureCurve(), CIRCUIT.shape, seed=3)
        given = {f"circuit.{k}": v for k, v in GIVEN.items()} | {"geometry.cell_area": CELL_AREA}
        given |= {"noise": 1.0, "time_limit": 5.0} | parameters
        self.compensation = Compensation(self.node("compensation", given))
        observer = self.node("observer")
        self.force, self.reports = None, []
        observer.create_subscription(Image, "skin/pressure", self._on_pressure, 10)
        observer.create_subscription(
            DiagnosticArray, "skin/diagnostics", lambda m: self.reports.append(m.status[0]), 100
        )
        self._publisher = observer.create_publisher(Image, "skin/adc", 10)
        self.absent = np.zeros(CIRCUIT.shape, bool)  # crossings that are not read
        self.printed = NOT_READ  # there

    def _on_pressure(self, message) -> None:
        self.force = image_array(message) * CELL_AREA

    def feel(self, force: np.ndarray, frames: int = 1) -> None:
        """The board reads these forces, with a step of noise."""
        ratio = forward(self.adc.circuit, self.curve.resistance(force))
        for _ in range(frames):
            steps = self.adc.count(ratio) + self.rng.standard_normal(ratio.shape)
            samples = np.rint(np.clip(np.rint(steps), 0, 4095) * 16).astype(np.uint16)
            samples[self.absent] = self.printed
            self.clock.advance(0.02)
            self._publisher.publish(image(samples, "16UC1", self.header()))
            self.executor.spin_some()


def touch() -> np.ndarray:
    force = np.zeros(CIRCUIT.shape)
    force[2:5, 3:6] = [[0.5, 1.0, 0.5], [1.0, 3.0, 1.0], [0.5, 1.0, 0.5]]
    force[6, 9:11] = 2.0
    return force


BOARDS = {
    "plain": {},
    "offset": {"adc_offset": 37.0},
    "offset below": {"adc_offset": -25.0},
    "3.3 V divider at a 5 V reference": {"adc_full_scale": 2703.0},
    "reference below the supply": {"adc_full_scale": 4200.0},
    "inverted": {"inverted": True},
    "diode": {"diode": 0.58, "supply": 3.3},
    "all": {"adc_offset": 37.0, "adc_full_scale": 3900.0, "inverted": True},
}


@pytest.mark.parametrize("kind", ["inverted", "diode", "all", *map(ci, list(BOARDS)[:5])])
def test_the_picture_is_right_on_every_kind_of_board(kind):
    given = BOARDS[kind]
    keys = {"adc_offset": "offset", "adc_full_scale": "full_scale"}
    adc = Adc(CIRCUIT, **{keys.get(k, k): v for k, v in given.items()})
    fed = Fed(adc, **{f"circuit.{k}": v for k, v in given.items()})
    fed.feel(np.zeros(CIRCUIT.shape), 60)
    fed.feel(touch(), 5)
    assert fed.compensation._level == DiagnosticStatus.OK, fed.compensation._message
    assert fed.force.sum() == pytest.approx(touch().sum(), rel=0.1)
    assert np.abs(fed.force - touch()).max() < 0.5


@pytest.mark.parametrize("how", ["marked", ci("scanned"), "mask"])
def test_a_crossing_that_is_not_read_adds_no_force(how):
    """Some boards print 0 there: taken for a reading it added 9 to 14 % of the force."""
    absent = np.zeros(CIRCUIT.shape, bool)
    absent[3, 8] = absent[6, 2] = True
    words = " ".join("".join("10"[int(a)] for a in row) for row in absent)
    given = {} if how == "marked" else {f"circuit.{how}": words}
    fed = Fed(Adc(replace(CIRCUIT, mask=~absent) if how == "mask" else CIRCUIT), **given)
    fed.absent, fed.printed = absent, NOT_READ if how == "marked" else 0
    fed.feel(np.zeros(CIRCUIT.shape), 60)
    assert fed.compensation.skin._tare.found is None
    fed.feel(touch(), 5)
    assert fed.compensation._level == DiagnosticStatus.OK, fed.compensation._message
    assert fed.force.sum() == pytest.approx(touch().sum(), rel=0.05)


@pytest.mark.parametrize("bad", [ci((0, 0)), (5, 11)])
def test_a_bad_contact_is_named_and_does_not_stop_the_robot(bad):
    """Its reading is what is left of it after a bad contact, in one of three frames."""
    fed = Fed(Adc(CIRCUIT))
    fed.feel(np.zeros(CIRCUIT.shape), 80)
    fed.reports.clear()  # of the first frames, in which nothing was known
    fed.absent[bad], said = True, ""
    for k in range(150):
        fed.absent[bad], fed.printed = k % 3 == 0, 12_000  # of 65535; at rest 24,000
        fed.feel(touch() if k % 50 < 25 else np.zeros(CIRCUIT.shape))
        said += fed.compensation._message
    assert f"row {bad[0]}, column {bad[1]}: reads less than" in said
    assert all(r.level != DiagnosticStatus.ERROR for r in fed.reports)
    named = [f for f in fed.compensation.skin.findings() if f.kind is Kind.CONTACT]
    assert all((f.rows, f.cols) == ((bad[0],), (bad[1],)) for f in named)


def test_a_circuit_that_no_skin_rests_with_is_not_taken_over(monkeypatch, caplog):
    """Neither by the frames that follow, whose pictures and level are told as before."""
    asked = []

    def fail(self, curve, noise):
        asked.append(noise)
        raise ValueError("no skin rests so")

    monkeypatch.setattr(CircuitTracker, "ask", fail)
    fed = Fed(Adc(CIRCUIT))
    fed.feel(np.zeros(CIRCUIT.shape), 80)
    fed.feel(touch(), 10)
    fed.feel(np.zeros(CIRCUIT.shape), 10)
    assert asked
    assert "what lies in series was not found: no skin rests so" in caplog.text
    assert fed.compensation.skin.circuit == CIRCUIT
    assert fed.compensation._level == DiagnosticStatus.OK, fed.compensation._message
    fed.feel(touch(), 5)
    assert fed.force.sum() == pytest.approx(touch().sum(), rel=0.1)


def watching() -> tuple[Bench, Monitor, Node]:
    """A monitor, and a node that it hears."""
    bench = Bench()
    return bench, Monitor(bench.node("monitor")), bench.node("observer")


class Terminal(io.StringIO):
    """80 columns."""

    def isatty(self):
        return True


def test_a_reason_longer_than_the_terminal_is_printed_whole_once(monkeypatch):
    """Its end says which setting to change."""
    for name, value in {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "xterm"}.items():
        monkeypatch.setenv(name, value)
    bench, monitor, observer = watching()
    monitor.out = Terminal()
    publisher = observer.create_publisher(DiagnosticArray, STATUS_TOPIC, STATUS)
    monitor._simulated = True
    reason = "stale: readings come every 0.12 s, but stale_after = 0.1 s: " + "set it. " * 4
    status = DiagnosticStatus(DiagnosticStatus.ERROR, "stop_on_push", reason, "tactile_skin", [])
    for _ in range(5):
        publisher.publish(DiagnosticArray(bench.header(), [status]))
        bench.spin(0.2)
        monitor.live_line()
    lines = monitor.out.getvalue().split("\n")
    assert lines[0] == f"\r\x1b[2K{reason}"
    assert monitor.out.getvalue().count(reason) == 1
    assert len(lines) == 2
    live = lines[1].split("\r\x1b[2K")[-1]
    assert len(live) < 80 and re.match(r"SIMULATED +0\.0/s  STOP stale: readings come", live)
    monkeypatch.delenv("NO_COLOR")
    monitor.live_line()
    assert re.search("\x1b\\[1;31m STOP stale: .*\x1b\\[0m$", monitor.out.getvalue()), "it is red"
    monitor.out = io.StringIO()
    monitor.live_line()
    assert "\x1b" not in monitor.out.getvalue(), "no terminal"


def test_the_live_line_of_a_body_names_the_skins_that_are_touched():
    bench = Bench()
    monitor = Monitor(bench.node("monitor", {"skins": ["chest", "back", "legs"]}))
    monitor.out = io.StringIO()
    for skins, said in (([2, 0, 2], "contacts 3    6.0 N on chest, legs  "), ([], "0    0.0 N  ")):
        monitor.on_contacts(cloud_of(("force", "skin"), [(2.0, k) for k in skins], bench.header()))
        monitor.live_line()
        assert said in monitor.out.getvalue().splitlines()[-1]


def test_the_live_line_names_a_gesture_for_a_while_and_the_most_that_a_touch_may_be():
    bench, monitor, observer = watching()
    status = DiagnosticStatus(values=[KeyValue("counts_as", "37.0")])
    decisions = observer.create_publisher(DiagnosticArray, STATUS_TOPIC, STATUS)
    decisions.publish(DiagnosticArray(bench.header(), [status]))
    observer.create_publisher(String, "skin/gesture", 10).publish(String("stroke"))
    bench.spin()
    lines = []
    for _ in range(2):
        monitor.out = io.StringIO()
        monitor.live_line()
        lines.append(monitor.out.getvalue())
        bench.clock.advance(2.5)
    assert lines[0].endswith("  stroke\n") and "stroke" not in lines[1]
    assert " 0.0 N (may be 37 N)  no push" in lines[0]


def test_a_warning_is_printed_whole_once():
    """And again when it says something else; the live line names who warns."""
    bench, monitor, observer = watching()
    monitor.out = io.StringIO()
    publisher = observer.create_publisher(DiagnosticArray, "skin/diagnostics", 10)

    def say(level, text, kind="lead", rows="", form=""):
        given = {"kind": kind, "form": form, "rows": rows}
        values = [KeyValue(key, value) for key, value in given.items()]
        status = DiagnosticStatus(level, "compensation", text, "tactile_skin", values)
        publisher.publish(DiagnosticArray(bench.header(), [status]))
        bench.spin()
        begun = len(monitor.out.getvalue())
        monitor.live_line()
        return monitor.out.getvalue()[begun:].splitlines()

    warning = DiagnosticStatus.WARN
    first, line = say(warning, "row 4 conducts 111 times as much", rows="4")
    assert first == "compensation warns: row 4 conducts 111 times as much"
    assert line.endswith("  warned: compensation")
    assert len(say(warning, "row 4 conducts 112 times as much", rows="4")) == 1
    assert len(say(warning, "row 5 conducts 112 times as much", rows="5")) == 2
    assert len(say(warning, "row 5 is open", "open", "5")) == 2
    assert len(say(warning, "row 5 is open, too", "open", "5", "frame")) == 2
    assert len(say(warning, "a node of somebody else warns", "")) == 2
    assert len(say(warning, "it warns of something else", "")) == 2
    (line,) = say(DiagnosticStatus.OK, "ok")
    assert "warned" not in line


@pytest.mark.parametrize(("rate", "at_most"), [(8.0, 0.35), (3.0, 0.53), (100.0, 0.13)])
def test_free_is_valid_for_the_time_in_force_and_no_longer(rate, at_most):
    """What hooks, gate and push_to_move make of the status, at any time between two readings."""
    bench, words = Bench(), []
    StopOnPush(bench.node("stop_on_push"))
    observer, clock = bench.node("observer"), bench.clock
    observer.create_subscription(
        DiagnosticArray,
        STATUS_TOPIC,
        lambda m: words.append(stop_message_of(m, clock.now().nanoseconds / 1e9)),
        STATUS,
    )
    contacts = observer.create_publisher(PointCloud2, "skin/contacts", 10)
    t, due, newest, free = 0.0, 0.0, 0.0, []
    while t < 6.0:
        clock.advance(0.005)
        t += 0.005
        if due <= t < 5.0:
            columns = {key: [0.0] for key in ("x", "y", "z", "force", "peak")}
            contacts.publish(cloud(columns, bench.header()))
            due, newest = due + 1.0 / rate, t
        bench.spin()
        stops = words[-1].at(clock.now().nanoseconds / 1e9).stop
        free += [] if stops else [t]
        assert stops or t - newest <= at_most
        assert not stops or not 3.0 < t < 5.0
    assert free


@pytest.mark.parametrize(
    ("causes", "alone"),
    [("push", True), ("push fault", False), ("", False), (None, False), ("shove", False)],
)
def test_only_a_stop_that_names_a_push_alone_is_one_for_it(causes, alone):
    """Whatever its words are: a robot may move away from what pushes it."""
    values = [] if causes is None else [KeyValue("causes", causes)]
    status = DiagnosticStatus(DiagnosticStatus.ERROR, "stop_on_push", "push", "", values)
    message = stop_message_of(DiagnosticArray(Header(), [status]), 0.0)
    assert message.stop and message.at(0.0).for_push_alone == alone
