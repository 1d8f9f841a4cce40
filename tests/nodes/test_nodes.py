# SPDX-License-Identifier: Apache-2.0
"""The chain from a frame to the stop, on a driven clock and in one thread; and the driver."""

import queue
from collections import defaultdict

import numpy as np
import pytest
from support.bench import Bench
from support.chain import PROVED
from support.patience import PATIENCE
from support.simulated import CIRCUIT, remembering, serving

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.errors import ParameterError
from tactile_skin.middleware.bus import (
    Context,
    MultiThreadedExecutor,
    Node,
    Parameter,
    Time,
)
from tactile_skin.msg import (
    Bool,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    KeyValue,
    PointCloud2,
    PointStamped,
    PolygonStamped,
    Trigger,
    Vector3Stamped,
    WrenchStamped,
    cloud_columns,
    cloud_of,
    image,
    image_array,
)
from tactile_skin.nodes import diagnostics
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.nodes.gesture_feature import GestureFeature
from tactile_skin.nodes.observers.monitor import Monitor
from tactile_skin.nodes.push_arrow import PushArrow
from tactile_skin.nodes.serial_driver import SerialDriver
from tactile_skin.nodes.stop_on_push import HEARTBEAT, LATCHED, STATUS_TOPIC, StopOnPush
from tactile_skin.simulation import scenes, simulator
from tactile_skin.simulation.matrix import resting_curve
from tactile_skin.solvers import Estimate

CELL_AREA = 1.44e-4  # m^2
GEOMETRY = {"geometry.shape": "cylinder", "geometry.cell_area": CELL_AREA}
STOP = {"threshold": 30.0, "release": 20.0, "hold": 0.3, "stale_after": 0.1}
STOP |= {"debounce": 0.05, "lead": 0.0}
FRAME = 1.0 / simulator.FRAMES_PER_SECOND  # s


class Chain(Bench):
    """compensation -> gesture_feature -> stop_on_push, and a simulated board that feeds them.

    Attributes:
        scene: name of what the board feels; may be changed at any time.
        seen: topic -> messages, oldest first.
    """

    def __init__(self, method="cnn", **stop):
        super().__init__()
        self.seen = defaultdict(list)
        self.observer = self.node("observer", {})
        for kind, topic, qos in (
            (Image, "skin/adc", 100),
            (Image, "skin/pressure", 100),
            (WrenchStamped, "skin/wrench", 100),
            (Vector3Stamped, "skin/push_direction", 100),
            (PointCloud2, "skin/contacts", 100),
            (Bool, "skin/stop", 100),
            (DiagnosticArray, STATUS_TOPIC, 100),
            (DiagnosticArray, "skin/diagnostics", 100),
        ):
            self.observer.create_subscription(kind, topic, self.seen[topic].append, qos)
        given = GEOMETRY | PROVED | {"method": method}
        self.compensation = Compensation(self.node("compensation", given))
        self.compensation.skin._time_limit = 60.0  # s of the real clock, on a busy machine
        self.features = GestureFeature(self.node("gesture_feature", GEOMETRY))
        self.stop = StopOnPush(self.node("stop_on_push", STOP | stop))
        self._adc = self.observer.create_publisher(Image, "skin/adc", 10)
        self.diagnostics = self.observer.create_publisher(DiagnosticArray, "skin/diagnostics", 10)
        self.scene, self._scripts = "idle", {n: scenes.script(n, 16, 16) for n in scenes.SCRIPTS}
        felt = lambda t: self._scripts[self.scene](t)  # noqa: E731
        self._board = remembering(simulator.Board(Circuit(), PressureCurve(), felt))
        self._parser = BinaryParser()

    def publish(self, samples) -> None:
        self._adc.publish(image(samples, "16UC1", self.header()))
        self.executor.spin_some()

    def publish_alike(self, frames: int) -> None:
        for _ in range(frames):
            self.clock.advance(FRAME)
            self.publish(np.full((16, 16), 16_000, np.uint16))

    def play(self, frames: int) -> None:
        """The board sends so many frames, 10 ms apart."""
        while frames:
            for frame in self._parser.feed(self._board.scan()):
                self.clock.advance(FRAME)
                self.publish(frame.samples)
                frames -= 1

    def settle(self) -> None:
        """The readings of another scene have reached the low-pass's end."""
        self.play(8)

    @property
    def stopped(self) -> bool:
        return self.seen["skin/stop"][-1].data

    @property
    def reason(self) -> str:
        status = self.seen[STATUS_TOPIC][-1].status[0]
        assert (status.level == DiagnosticStatus.ERROR) is self.stopped
        return status.message

    def frames_until(self, wanted: bool, at_most: int = 200) -> int:
        """Frames played until the stop is as wanted."""
        for n in range(at_most):
            if self.stopped is wanted:
                return n
            self.play(1)
        raise AssertionError(f"stopped is {self.stopped} after {at_most} frames: {self.reason}")

    def errors(self) -> int:
        return sum(n.callback_errors for n, _ in self.executor._nodes)

    def report(self, level, message="", name="elsewhere") -> None:
        status = DiagnosticStatus(level, name, message, "tactile_skin")
        self.diagnostics.publish(DiagnosticArray(self.header(), [status]))
        self.executor.spin_some()


@pytest.fixture
def chain():
    chain = Chain()
    yield chain
    assert chain.errors() == 0


@pytest.fixture
def moving(chain):
    """The robot may move: idle frames arrive."""
    chain.play(120)  # its rest is measured
    assert not chain.stopped
    return chain


# --- the stop ---


def test_a_stream_that_ends_stops_as_stale(moving):
    """Within stale_after and one heartbeat, with no reading to bring it about."""
    silent = 0.0
    while not moving.stopped:
        assert silent < STOP["stale_after"] + HEARTBEAT
        moving.spin(0.001)
        silent += 0.001
    assert silent > STOP["stale_after"] - HEARTBEAT
    assert moving.reason == "stale: readings no longer arrive"
    moving.play(4)
    assert not moving.stopped


def test_the_stop_is_a_heartbeat_with_readings_and_without(moving):
    """Said again and again, so that a lock that expires also stops: once for each reading; the
    timer speaks only where they leave a gap."""
    before = len(moving.seen["skin/stop"])
    moving.play(50)
    assert len(moving.seen["skin/stop"]) - before == 50
    for _ in range(50):
        moving.spin(HEARTBEAT)
    assert len(moving.seen["skin/stop"]) - before == 100


def test_the_stop_is_latched(moving):
    """Whoever subscribes late knows at once."""
    moving.spin(1.0)
    seen = []
    late = moving.node("late", {})
    late.create_subscription(Bool, "skin/stop", seen.append, LATCHED)
    moving.executor.spin_some()
    assert [m.data for m in seen] == [True]


def test_a_fault_stops_and_its_end_frees(moving):
    moving.report(DiagnosticStatus.ERROR, "on fire")
    moving.play(1)
    assert moving.stopped
    assert moving.reason == "fault: elsewhere: on fire"
    moving.report(DiagnosticStatus.OK, "put out")
    moving.play(1)
    assert not moving.stopped


def test_a_warning_does_not_stop(moving):
    moving.report(DiagnosticStatus.WARN, "warm")
    moving.play(1)
    assert not moving.stopped


def test_the_diagnostics_of_other_parts_of_the_robot_do_not_stop(moving):
    """Not even those of another skin: it is told apart by its topic, not by what it says."""
    everybody = moving.observer.create_publisher(DiagnosticArray, "/diagnostics", 10)
    status = DiagnosticStatus(DiagnosticStatus.ERROR, "elsewhere", "arm is off", "tactile_skin")
    everybody.publish(DiagnosticArray(Header(), [status]))
    moving.play(1)
    assert not moving.stopped


def test_shutting_down_stops(moving):
    moving.stop.close()
    moving.executor.spin_some()
    assert moving.stopped
    assert "the skin shuts down" in moving.reason


def test_every_message_has_the_stamp_and_frame_of_the_reading_it_rests_on(moving):
    """Without a touch there is no direction."""
    moving.play(1)
    header = moving.seen["skin/pressure"][-1].header
    assert header.frame_id == "base_link"
    for topic in ("skin/wrench", "skin/push_direction", "skin/contacts", STATUS_TOPIC):
        assert moving.seen[topic][-1].header == header
    direction = moving.seen["skin/push_direction"][-1].vector
    assert (direction.x, direction.y, direction.z) == (0.0, 0.0, 0.0)


def test_contacts_that_cannot_be_read_make_no_free_last_longer(moving):
    """Of another program, say: by the stamp that a "free" carries it is known when it expires."""
    before = moving.seen[STATUS_TOPIC][-1].header
    moving.spin(0.05)
    with pytest.raises(KeyError, match="peak"):
        moving.stop.on_contacts(cloud_of(("x", "force"), [(0.0, 0.0)], moving.header()))
    moving.spin(0.02)
    assert moving.seen[STATUS_TOPIC][-1].header == before


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"release": 31.0}, "release"),
        ({"hold": "long"}, "hold"),
        ({"peak": 9.5}, "peak = 9.5 N: the curve ends at 9.80665 N"),
        ({"curve.force": [0.0, 5.0], "curve.resistance": [40000.0, 85.0]}, "at most 4.75 N"),
    ],
)
def test_bad_stop_parameters_are_refused_by_name(bad, named):
    with pytest.raises((ValueError, ParameterError), match=named):
        Chain(**bad)


# --- directions ---


def test_a_push_from_the_left_points_to_the_right(moving):
    """REP 103: y is left. The skin is a cylinder, its high columns on the robot's left."""
    moving.scene = "push_left"
    moving.settle()
    wrench = moving.seen["skin/wrench"][-1].wrench
    assert wrench.force.y < -10.0
    assert abs(wrench.force.z) < 0.05 * abs(wrench.force.y)
    direction = moving.seen["skin/push_direction"][-1].vector
    v = np.array([direction.x, direction.y, direction.z])
    assert np.linalg.norm(v) == pytest.approx(1.0)
    force = np.array([wrench.force.x, wrench.force.y, wrench.force.z])
    np.testing.assert_allclose(v, force / np.linalg.norm(force), atol=1e-6)
    points = cloud_columns(moving.seen["skin/contacts"][-1])
    assert points["y"][0] > 0.05


def test_the_arrow_shows_the_push_and_is_gone_without_one(moving):
    """It ends at the centre of force, points where the push goes, and has its length."""
    seen = moving.seen["skin/push_arrow"]
    PushArrow(moving.node("push_arrow", {"length": 0.2}))
    moving.observer.create_subscription(PolygonStamped, "skin/push_arrow", seen.append, 100)
    centres = []
    moving.observer.create_subscription(PointStamped, "skin/centre", centres.append, 100)
    moving.play(1)
    assert seen[-1].polygon.points == []
    moving.scene = "push_left"
    moving.settle()
    tail, *_, tip, _, _ = ((p.x, p.y, p.z) for p in seen[-1].polygon.points)
    direction = moving.seen["skin/push_direction"][-1].vector
    centre = centres[-1].point
    np.testing.assert_allclose(tip, (centre.x, centre.y, centre.z))
    shaft = np.subtract(tip, tail)
    np.testing.assert_allclose(shaft, 0.2 * np.array([direction.x, direction.y, direction.z]))
    assert seen[-1].header == moving.seen["skin/push_direction"][-1].header


# --- bad frames ---


def last_report(chain, name="compensation"):
    reports = [m.status[0] for m in chain.seen["skin/diagnostics"] if m.status[0].name == name]
    return reports[-1]


@pytest.mark.parametrize("shape", [(8, 16), (16, 15)])
def test_a_frame_of_another_shape_stops_and_gives_no_pressure(moving, shape):
    before = len(moving.seen["skin/pressure"])
    moving.publish(np.zeros(shape, np.uint16))
    assert len(moving.seen["skin/pressure"]) == before
    report = last_report(moving)
    assert report.level == DiagnosticStatus.ERROR
    assert str(shape) in report.message
    moving.spin(HEARTBEAT)
    assert moving.stopped
    assert moving.reason.startswith("fault: compensation: ")
    moving.play(2)
    assert last_report(moving).level == DiagnosticStatus.OK
    assert not moving.stopped


def test_an_image_of_another_encoding_is_refused(moving):
    before = len(moving.seen["skin/pressure"])
    wrong = image(np.zeros((16, 16)), "32FC1", moving.header())
    wrong.encoding = "mono16"
    moving._adc.publish(wrong)
    moving.executor.spin_some()
    assert len(moving.seen["skin/pressure"]) == before
    assert "mono16" in last_report(moving).message


def test_the_largest_sample_is_a_reading(moving):
    """A short between two lines reads the full scale; that is a pressed cell, no error."""
    before = len(moving.seen["skin/pressure"])
    moving.publish(np.full((16, 16), 65_534, np.uint16))
    assert len(moving.seen["skin/pressure"]) == before + 1


@pytest.mark.parametrize("method", ["cnn", "auto"])
def test_a_frame_in_which_nothing_was_read_is_no_idle_skin(method):
    chain = Chain(method)
    chain.play(150)  # its rest is measured
    before = len(chain.seen["skin/pressure"])
    chain.publish(np.full((16, 16), 65_535, np.uint16))
    assert len(chain.seen["skin/pressure"]) == before
    assert "no crossing of the frame was read" in chain.reason


def feels(monkeypatch, force, status) -> None:
    """From here on each frame is found so."""
    found = Estimate(force, 0.1 + 0.0 * force, 0.0, status, status.strip("ok"), "naive", 0)
    monkeypatch.setattr("tactile_skin.health.skin.compensate", lambda *a, **k: found)


def test_a_fault_seen_at_rest_is_not_healed_by_a_touch_that_hides_it(monkeypatch):
    """Two shorted lines read off at rest, and alike under a touch that lies on both."""
    chain = Chain("naive")
    skin = chain.compensation.skin
    skin._follows = skin.waits = False  # the frames are all alike
    touch = np.zeros((16, 16))
    touch[5, 5] = 1.0  # N

    def feel(frames, force, status):
        feels(monkeypatch, force, status)
        chain.publish_alike(frames)
        chain.spin(1.0)  # for a report
        return last_report(chain).level

    rest, bad = np.zeros((16, 16)), DiagnosticStatus.ERROR
    assert feel(5, rest, "ok") == DiagnosticStatus.OK
    assert feel(30, touch, "suspect") == bad
    assert feel(60, touch, "ok") == DiagnosticStatus.OK, "the touch is believed again"
    assert feel(15, rest, "suspect") == bad
    assert feel(100, touch, "ok") == bad
    assert feel(30, rest, "ok") == DiagnosticStatus.OK


def test_a_reset_forgets_what_was_under_a_touch_and_says_so_at_once(monkeypatch):
    """On diagnostics, before it answers: who then resets the stop finds the fault gone."""
    chain, rest, touch = Chain("naive"), np.zeros((16, 16)), np.zeros((16, 16))
    skin = chain.compensation.skin
    skin._follows = skin.waits = False  # the frames are all alike
    touch[5, 5] = 1.0  # N
    client = chain.observer.create_client(Trigger, "compensation/reset")

    for _ in range(2):
        feels(monkeypatch, touch, "suspect")
        chain.publish_alike(30)
        feels(monkeypatch, rest, "ok")
        chain.publish_alike(150)
    assert chain.reason.startswith("fault: compensation: ")
    assert "under each touch" in chain.reason
    answer = client.call_async(Trigger.Request())
    chain.executor.spin_some()  # the clock stands
    assert answer.result(0).success
    assert last_report(chain).level == DiagnosticStatus.OK
    assert not chain.stopped
    chain.publish_alike(100)
    assert not chain.stopped


def test_a_doubt_before_the_rest_was_measured_is_no_fault(monkeypatch):
    chain = Chain("naive")
    feels(monkeypatch, np.zeros((16, 16)), "suspect")
    chain.publish_alike(30)
    assert chain.reason == "waiting: compensation: measuring rest: hands off"
    assert chain.stopped


@pytest.mark.parametrize("status", ["suspect", "failed"])
def test_a_reset_is_no_cure_for_what_is_still_wrong(monkeypatch, status):
    chain = Chain("naive")
    chain.compensation.skin.waits = False  # rest was measured
    client = chain.observer.create_client(Trigger, "compensation/reset")
    feels(monkeypatch, np.zeros((16, 16)), status)
    chain.publish_alike(30)
    client.call_async(Trigger.Request())
    chain.executor.spin_some()
    assert last_report(chain).level == DiagnosticStatus.ERROR
    assert "fault: compensation: " in chain.reason


# --- the pressure picture ---


def test_pressure_is_in_pascal(moving):
    """The force that `compensate` finds on a cell, over the area of that cell that senses."""
    moving.scene = "two_fingers"
    moving.settle()
    (frame,) = moving.seen["skin/adc"][-1:]
    adc = image_array(frame) / 64 / 1023
    force = compensate(adc, Circuit(), PressureCurve(), "cnn").force
    assert force.max() > 1.0
    pressure = image_array(moving.seen["skin/pressure"][-1])
    assert pressure.dtype == np.float32
    np.testing.assert_allclose(pressure, force / CELL_AREA, rtol=1e-5)


# --- the monitor ---


def test_the_summary_counts_frames_stops_and_drops(chain, capsys):
    """And what the driver says it lost; a frame without a decision is a drop."""
    monitor = Monitor(chain.node("monitor", {"duration": 3.0}))
    chain.play(120)  # its rest is measured
    chain.scene = "push_left"
    chain.frames_until(True)
    chain.scene = "idle"
    chain.frames_until(False)
    frames = len(chain.seen["skin/pressure"])
    chain.clock.advance(FRAME)
    chain.publish(np.zeros((8, 8), np.uint16))  # refused by compensation
    chain.play(2)
    monitor.close()
    summary = capsys.readouterr().out
    assert f"frames      {frames + 3} in" in summary
    assert "drops       1 (0 lost on the wire, 1 on the way)" in summary
    assert '"push: ' in summary
    assert "p50 0.00 ms, p99 0.00 ms" in summary  # the clock stands while callbacks run


def test_a_decision_that_comes_before_its_reading_is_no_drop(chain):
    """The driver tells one subscriber after the other, and may be held up in between."""
    monitor = Monitor(chain.node("monitor", {}))
    for stamp in (1, 2, 3):
        header = Header(Time(nanoseconds=stamp * 10**7).to_msg(), "base_link")
        reading = Image(header=header)
        decision = DiagnosticArray(header, [DiagnosticStatus(name="stop_on_push")])
        first, second = (monitor.on_adc, reading), (monitor.on_decision, decision)
        for callback, message in (second, first) if stamp == 2 else (first, second, second):
            callback(*monitor.skins, message)  # the third is a heartbeat
    (skin,) = monitor.skins
    assert skin.count == len(skin.latencies) == 3
    assert skin.dropped == 0


def test_the_monitor_ends_the_run_after_its_duration(chain):
    monitor = Monitor(chain.node("monitor", {"duration": 0.5}))
    chain.play(49)
    assert chain.context.ok()
    chain.play(4)
    assert not chain.context.ok()
    assert not monitor.failed


def test_a_run_without_a_frame_has_failed(chain, capsys):
    monitor = Monitor(chain.node("monitor", {"duration": 0.5}))
    chain.spin(20.0)
    assert chain.context.ok()
    chain.spin(1.0)
    assert not chain.context.ok()
    assert monitor.failed
    monitor.close()
    assert "no frame arrived" in capsys.readouterr().out


# --- the driver: it has a thread of its own, and a real port ---


@pytest.mark.live
def test_the_driver_publishes_what_the_board_sends(tmp_path):
    """In ADC steps * 64, stamped, in the configured frame; diagnostics say where it comes from."""
    context, executor = Context(), MultiThreadedExecutor()
    given = {"circuit.rows": 4, "circuit.cols": 5, "port": str(tmp_path / "skin")}
    overrides = [Parameter(k, v) for k, v in (given | {"frame_id": "arm"}).items()]
    nodes = [Node("serial_driver", context=context, parameter_overrides=overrides)]
    nodes.append(Node("observer", context=context))
    readings, reports = queue.Queue(), queue.Queue()
    nodes[1].create_subscription(Image, "skin/adc", readings.put, 100)
    nodes[1].create_subscription(DiagnosticArray, "skin/diagnostics", reports.put, 100)
    with serving(tmp_path / "skin"):
        driver = SerialDriver(nodes[0])
        for node in nodes:
            executor.add_node(node)
        message = readings.get(timeout=PATIENCE)
        while "frames from" not in (report := reports.get(timeout=PATIENCE).status[0]).message:
            pass
        driver.close()
        assert executor.shutdown(PATIENCE)
    idle = forward(CIRCUIT, np.full((4, 5), PressureCurve().rest_resistance)) * 1023 * 64
    np.testing.assert_allclose(image_array(message), idle, atol=6 * 64)  # 1 step RMS of noise
    assert message.header.frame_id == "arm"
    assert message.header.stamp.sec > 0
    assert (report.level, report.name) == (DiagnosticStatus.OK, "serial_driver")
    values = {pair.key: pair.value for pair in report.values}
    assert (values["crc_errors"], values["lost"], values["reconnects"]) == ("0", "0", "0")


def test_a_skin_that_is_loaded_from_the_start_stops_until_it_is_let_go():
    """A palm on it, or an ADC that reads too high from the start; a finger leaves cells at rest."""

    def feel(force, frames=30):
        adc = forward(Circuit(), fabric.resistance(force * texture))
        rng = np.random.default_rng(1)
        for _ in range(frames):
            chain.clock.advance(FRAME)
            steps = np.rint(adc * 1023 * 64 + 32 * rng.standard_normal(adc.shape))
            chain.publish(steps.astype(np.uint16))

    fabric = resting_curve(PressureCurve(), (16, 16), seed=1)
    texture = np.random.default_rng(2).uniform(0.7, 1.3, (16, 16))
    chain = Chain("auto")
    feel(0.2)
    assert chain.stopped
    feel(0.2, 170)
    assert "Is it loaded" in chain.reason
    feel(0.0, 260)  # its rest is measured, at the second go
    assert not chain.stopped, chain.reason
    feel(0.1)
    assert not chain.stopped, chain.reason
    chain = Chain("auto")
    chain.scene = "one_finger"
    chain.play(100)  # which may wait for its rest, but not for a palm to go
    assert "loaded" not in chain.reason


@pytest.mark.parametrize(("rows", "warns"), [(2, True), (3, False)])
def test_a_skin_too_small_to_tell_all_faults_warns(caplog, rows, warns):
    overrides = [Parameter("circuit.rows", rows), Parameter("circuit.cols", 8)]
    Compensation(Node("compensation", context=Context(), parameter_overrides=overrides))
    assert ("Smallest skin" in caplog.text) is warns


@pytest.mark.parametrize(("proof", "warns"), [("none", True), ("weight", False)])
def test_newtons_that_nothing_proved_are_said_to_be_so(caplog, proof, warns):
    """Once, with what to do."""
    stop = StopOnPush(Node("stop_on_push", context=Context()))
    for _ in range(2):
        values = [KeyValue(diagnostics.PROOF, proof)]
        status = DiagnosticStatus(0, "compensation", "ok", "", values)
        stop.on_diagnostics(DiagnosticArray(Header(), [status]))
    assert caplog.text.count("tactile-skin calibrate --gain 1.0") == warns
