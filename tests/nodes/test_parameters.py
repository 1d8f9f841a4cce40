# SPDX-License-Identifier: Apache-2.0
"""Parameters that change while a node runs, and a clock that stands still."""

import pytest
from support.bench import Bench

from tactile_skin.middleware.bus import ManualClock, Parameter, Time
from tactile_skin.msg import (
    Bool,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    KeyValue,
    PointCloud2,
    Twist,
    TwistStamped,
    Vector3,
    cloud,
)
from tactile_skin.nodes.cmd_vel_gate import CmdVelGate
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.nodes.gesture_feature import GestureFeature
from tactile_skin.nodes.stop_on_push import STATUS_TOPIC, StopOnPush


class Changing(Bench):
    """One node, and what asks it to change."""

    def __init__(self, kind, **values):
        super().__init__()
        self.handle, self.other = self.node("n", values), self.node("other")
        self.changed = kind(self.handle)

    def set(self, **values) -> str:
        """Why not, or nothing."""
        wanted = [Parameter(*item) for item in values.items()]
        answer = self.handle.set_parameters_atomically(wanted)
        assert answer.successful is not bool(answer.reason)
        return answer.reason

    def heard(self, kind, topic) -> list:
        found = []
        self.other.create_subscription(kind, topic, found.append, 100)
        return found


def test_a_stop_that_the_weakest_cell_cannot_reach_is_refused():
    cells = {"circuit.rows": 2, "circuit.cols": 2, "curve.gain": [1.0, 1.0, 0.5, 1.0]}
    with pytest.raises(ValueError, match="the curve ends at 4"):
        Changing(StopOnPush, **cells)
    Changing(StopOnPush, **cells, peak=4.0)


def test_limits_of_the_stop_change():
    bench = Changing(StopOnPush)
    assert bench.set(threshold=40.0, release=35.0, stale_after=0.3) == ""
    config = bench.changed.policy.config
    assert (config.threshold, config.release, config.hold) == (40.0, 35.0, 0.3)
    assert bench.changed.policy.stale_after == 0.3
    assert bench.handle.get_parameter("threshold").value == 40.0


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"threshold": 10.0}, "release = 20.0 N: must be at most threshold = 10.0 N"),
        ({"threshold": 1e4}, "must be from 0.1 to 500.0"),
        ({"threshold": "high"}, "must be of type float"),
        ({"hold": 0.5, "peak": 100.0}, "no cell would ever reach it"),
        ({"curve.resistance": [1.0]}, "curve.resistance of node n is read at the start only"),
        ({"treshold": 20.0}, "treshold of node n is not declared"),
    ],
)
def test_a_wrong_limit_is_refused_and_nothing_changes(values, reason):
    bench = Changing(StopOnPush)
    before = bench.changed.policy.config
    assert reason in bench.set(**values)
    assert bench.changed.policy.config == before
    assert bench.handle.get_parameter("hold").value == before.hold


def test_a_push_that_is_on_outlives_a_change():
    bench = Changing(StopOnPush)
    t = bench.clock.now().nanoseconds / 1e9
    for k in range(5):
        bench.changed.policy.reading(t + 0.01 * k, 100.0, 1.0)
    assert bench.changed.policy.pushed
    assert bench.set(threshold=400.0, release=300.0) == ""
    assert bench.changed.policy.pushed


def test_a_slow_board_is_no_news_when_its_limit_is_to_be_measured():
    bench = Changing(StopOnPush, stale_after=1.0)
    t, policy = bench.clock.now().nanoseconds / 1e9, bench.changed.policy
    said = []
    for k in range(20):
        if k == 10:
            assert bench.set(stale_after=0.0) == ""
        said.append(policy.reading(t + 0.15 * k, 0.0).stop)
    assert said == [True] * 3 + [False] * 17
    assert policy.stale_after == pytest.approx(0.375)


def test_the_method_changes():
    bench = Changing(Compensation, method="map")
    assert bench.set(method="auto") == ""
    assert bench.changed._method == "auto" and bench.changed.skin._method == "auto"
    assert "must be one of" in bench.set(method="magic")
    assert bench.changed._method == "auto" and bench.changed.skin._method == "auto"


def test_the_threshold_of_a_contact_changes():
    bench = Changing(GestureFeature)
    assert bench.set(cell_threshold=0.5) == ""
    assert bench.changed.cell_threshold == 0.5
    assert "cell_threshold" in bench.set(cell_threshold=5.0)  # it would hide pushes from the stop
    assert bench.changed.cell_threshold == 0.5


def test_a_clock_that_stands_still_stops():
    """A free robot's readings would never become old."""
    bench = Changing(StopOnPush)
    said = bench.heard(DiagnosticArray, "skin/stop_status")
    bench.clock.stands_still = True
    bench.spin(0.02)
    assert "fault: clock: stands still" in said[-1].status[0].message
    bench.clock.stands_still = False
    bench.spin(0.02)
    assert "clock" not in said[-1].status[0].message


def test_it_stops_though_readings_come():
    """As often as a board sends them; their stamps stand still, and so a push would be none."""
    bench = Changing(StopOnPush)
    clock = ManualClock(500.0)  # of ROS; timers run on the bus's own
    bench.handle.get_clock = lambda: clock
    stop = bench.heard(Bool, "skin/stop")
    contacts = bench.other.create_publisher(PointCloud2, "skin/contacts", 10)

    def read(force: float, count: int = 30) -> bool:
        for _ in range(count):
            bench.clock.advance(0.01)
            clock.advance(0.0 if clock.stands_still else 0.01)
            header = Header(clock.now().to_msg())
            contacts.publish(cloud({"force": [force], "peak": [1.0]}, header))
            bench.executor.spin_some()
        return stop[-1].data

    assert not read(0.0)
    clock.stands_still = True
    assert read(0.0, 1) and read(200.0)
    clock.stands_still = False
    assert not read(0.0)


@pytest.mark.parametrize("stamped", [False, True])
def test_the_gate_closes_when_the_clock_stands_still(stamped):
    """It does not rely on the stop for that; and its velocities have the type that is asked for."""
    kind = TwistStamped if stamped else Twist
    bench = Changing(CmdVelGate, stamped=stamped, frame_id="base")
    heard = bench.heard(kind, "cmd_vel")
    commands = bench.other.create_publisher(kind, "cmd_vel_in", 1)
    twist = Twist(Vector3(x=0.2))
    bench.clock.stands_still = True
    commands.publish(TwistStamped(Header(), twist) if stamped else twist)
    bench.executor.spin_some()
    last = heard[-1]
    assert (last.twist if stamped else last) == Twist()
    if stamped:
        assert last.header.frame_id == "base"
        assert last.header.stamp == bench.clock.now().to_msg()
    assert bench.handle.callback_errors == 0


def test_old_commands_do_not_become_new():
    """Nor do those of another frame or clock; one that passes keeps its stamp."""
    bench = Changing(CmdVelGate, stamped=True)
    heard = bench.heard(TwistStamped, "cmd_vel")
    commands = bench.other.create_publisher(TwistStamped, "cmd_vel_in", 1)
    stop = bench.other.create_publisher(DiagnosticArray, STATUS_TOPIC, 10)

    def passes(age: float, frame: str = "base_link") -> bool:
        bench.clock.advance(1.0)
        free = [DiagnosticStatus(values=[KeyValue("good_for", "0.1")])]
        stop.publish(DiagnosticArray(bench.header(), free))
        stamp = bench.clock.now().nanoseconds - round(age * 1e9)
        header = Header(Time(stamp if age < 1e3 else 0).to_msg(), frame)
        commands.publish(TwistStamped(header, Twist(Vector3(x=0.2))))
        bench.executor.spin_some()
        moved = [m for m in heard if m.twist.linear.x]
        if moved and age < 1e3:
            assert moved[-1].header == Header(header.stamp, "base_link")
        heard.clear()
        return bool(moved)

    assert passes(0.0) and passes(0.1, frame="")
    assert not passes(10.0) and not passes(-10.0) and not passes(0.0, "map")
    assert passes(1e9)  # a stamp of 0 is none
