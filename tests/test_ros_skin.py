# SPDX-License-Identifier: Apache-2.0
"""A skin on ROS 2 as its users have it: `skin` in namespaces, on a simulated clock, stamped."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.plain import Plain
from support.ros_graph import board, endless, skin

ROOT = Path(__file__).parents[1]
pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("rclpy")]


@pytest.mark.parametrize("stamped", [False, True])
def test_velocities_are_stamped_if_asked_for(graph, plain, stamped):
    """And who speaks the other type is told."""
    from geometry_msgs.msg import Twist, TwistStamped

    ours, other = (TwistStamped, Twist) if stamped else (Twist, TwistStamped)
    command = ours()
    velocity = command.twist if stamped else command
    velocity.linear.x = 0.2
    planner = plain.node.create_publisher(ours, "cmd_vel_in", 1)
    plain.node.create_timer(0.05, lambda: planner.publish(command))
    plain.hear(ours, "cmd_vel")

    def moves() -> bool:
        m = plain.last("cmd_vel")
        return m is not None and (m.twist if stamped else m).linear.x == 0.2

    with board() as player, Plain(graph.env, "stranger") as stranger:
        stranger.node.create_publisher(other, "cmd_vel_in", 1)
        words = ["-p", f"port:={player.port}", "-p", "cmd_vel_gate:=true", "-p", "tare:=false"]
        words += ["-p", f"stamped:={str(stamped).lower()}", "-p", "watchdog:=60.0"]
        graph.start("skin", skin(*words))
        with player.playing(endless("idle", seed=1)):
            plain.until(moves, "the robot moves", graph)
            if stamped:
                header = plain.last("cmd_vel").header
                assert header.frame_id == "base_link"
                now = plain.node.get_clock().now().nanoseconds * 1e-9
                assert abs(header.stamp.sec + header.stamp.nanosec * 1e-9 - now) < 30.0
            remedy = f"they do not hear each other: set stamped to {str(not stamped).lower()}"
            plain.until(lambda: remedy in graph.said("skin"), "the planner is told of", graph)


class Simulation:
    """/clock, and readings with its stamps, as `ros2 bag play --clock` sends them."""

    def __init__(self, plain):
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import Image

        self._clock = plain.node.create_publisher(Clock, "/clock", 10)
        self._adc = plain.node.create_publisher(Image, "skin/adc", 40)
        self.t = 100.0
        self._frames = endless("idle", seed=4)

    def tick(self, seconds: float = 0.01) -> None:
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import Image

        from tactile_skin.board.protocol import BinaryParser

        self.t += seconds
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(round(self.t * 1e9), 10**9)
        self._clock.publish(clock)
        ((frame),) = BinaryParser().feed(next(self._frames))
        picture = Image(height=16, width=16, encoding="16UC1", step=32)
        picture.header.frame_id, picture.header.stamp = "base_link", clock.clock
        picture.data.frombytes(frame.samples.astype("<u2").tobytes())
        self._adc.publish(picture)
        time.sleep(0.01)


def test_a_simulated_clock(graph, plain, tmp_path):
    """Readings that are old by the time of day count by /clock; while it stands still, and when it
    jumps, the robot stops."""
    from std_msgs.msg import Bool

    plain.hear(Bool, "skin/stop")
    from diagnostic_msgs.msg import DiagnosticArray

    plain.hear(DiagnosticArray, "skin/stop_status")
    path = tmp_path / "launch_params_x"  # as launch_ros makes them
    path.write_text("/**: {ros__parameters: {use_sim_time: true}}\n")
    words = ["-p", "serial_driver:=false", "-p", "tare:=false", "-p", "time_limit:=10.0"]
    words += ["--params-file", str(path), "-p", "stop_on_push:stale_after:=0.5"]
    graph.start("skin", skin(*words))
    simulation = Simulation(plain)

    def runs_until(stop: bool, what: str) -> None:
        def happened() -> bool:
            simulation.tick()
            m = plain.last("skin/stop")
            return m is not None and m.data is stop

        plain.until(happened, what, graph)

    runs_until(False, "free")
    last = len(plain.heard["skin/stop_status"])
    plain.until(lambda: plain.last("skin/stop").data, "the clock stands still: stop", graph)
    plain.until(
        lambda: any(
            "clock: stands still" in m.status[0].message
            for m in plain.heard["skin/stop_status"][last:]
        ),
        "it says why",
        graph,
    )
    runs_until(False, "free again")
    simulation.t += 50.0
    runs_until(True, "it jumps ahead: stop")
    runs_until(False, "free again")
    simulation.t -= 50.0
    runs_until(True, "it jumps back: stop")
    runs_until(False, "free again")


def test_words_for_ros_reach_it(graph, plain):
    with board() as player:
        port = ["-p", f"port:={player.port}"]
        graph.start("loud", skin("-r", "__ns:=/loud", *port, "--log-level", "debug"))
        with player.playing(endless("idle", seed=5)):
            plain.until(lambda: "frames arrive" in graph.said("loud"), "it says so", graph)
        graph.stop("loud")
        words = ["--log-level", "fatal", "--disable-rosout-logs", "-p", "monitor:=true"]
        graph.start("quiet", skin("-r", "__ns:=/quiet", *port, *words))
        with player.playing(endless("idle", seed=7)):
            plain.until(lambda: "/s  drops" in graph.said("quiet"), "frames arrive", graph)
            names = {info.node_name for info in plain.node.get_publishers_info_by_topic("/rosout")}
        assert "frames arrive" not in graph.said("quiet")
        assert names == {"plain"}
    done = subprocess.run(
        skin("--log-level", "shout"), env=graph.env, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "skin: error: --ros-args --log-level shout: " in done.stderr.splitlines()[-1]


def test_qos_of_a_publisher_is_overridden(graph, plain):
    from rclpy.qos import ReliabilityPolicy

    with board() as player:
        words = ["-p", f"port:={player.port}"]
        words += ["-p", "qos_overrides./skin/pressure.publisher.reliability:=best_effort"]
        graph.start("skin", skin(*words))

        def reliability(topic):
            return [
                i.qos_profile.reliability for i in plain.node.get_publishers_info_by_topic(topic)
            ]

        plain.until(
            lambda: reliability("/skin/pressure") == [ReliabilityPolicy.BEST_EFFORT], "it is", graph
        )
        plain.until(lambda: reliability("/skin/stop") == [ReliabilityPolicy.RELIABLE], "not", graph)


def test_ctrl_c_on_a_busy_computer():
    """Twice; fifty times: the benchmark."""
    script = ["-m", "benchmarks.ros.interrupt", "--times", "2", "--seed", "3"]
    words, env = [sys.executable, *script], os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(words, env=env, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
