# SPDX-License-Identifier: Apache-2.0
"""Who hears whom on ROS 2: quality of service, and the page in a browser."""

import importlib.util
import re
import time

import pytest
from support import chromium
from support.ros_graph import board, endless, program, skin

from tactile_skin.board.protocol import BinaryParser

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("rclpy")]


def picture(samples, header):
    from sensor_msgs.msg import Image

    made = Image(height=16, width=16, encoding="16UC1", step=32, header=header)
    made.data.frombytes(samples.astype("<u2").tobytes())
    return made


class Radio:
    """A driver on rclpy that publishes readings by best effort, as micro-ROS does."""

    def __init__(self, plain):
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import Image

        self._clock = plain.node.get_clock()
        self._adc = plain.node.create_publisher(Image, "skin/adc", qos_profile_sensor_data)
        self._frames = endless("idle", seed=8)
        plain.node.create_timer(0.01, self._publish)

    def _publish(self) -> None:
        from std_msgs.msg import Header

        ((frame),) = BinaryParser().feed(next(self._frames))
        header = Header(frame_id="base_link", stamp=self._clock.now().to_msg())
        self._adc.publish(picture(frame.samples, header))


def test_a_driver_that_publishes_by_best_effort_is_heard(graph, plain):
    from std_msgs.msg import Bool

    Radio(plain)
    plain.hear(Bool, "skin/stop")
    words = ["-p", "serial_driver:=false", "-p", "tare:=false", "-p", "stale_after:=0.5"]
    graph.start("skin", skin(*words))
    plain.until(
        lambda: plain.last("skin/stop") and not plain.last("skin/stop").data, "it is free", graph
    )


@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
def test_qos_of_a_subscription_is_overridden(graph, plain, reliability):
    from rclpy.qos import ReliabilityPolicy

    name = "qos_overrides./skin/adc.subscription.reliability"
    words = ["-p", "serial_driver:=false", "-p", f"{name}:={reliability}"]
    graph.start("skin", skin(*words))
    wanted = ReliabilityPolicy[reliability.upper()]

    def found():
        ends = plain.node.get_subscriptions_info_by_topic("/skin/adc")
        return [end.qos_profile.reliability for end in ends]

    plain.until(lambda: found() == [wanted], "as the parameter says", graph)


def test_old_commands_do_not_become_new(graph, plain):
    """Nor do those of another frame or clock; one that passes keeps its stamp."""
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import TwistStamped

    planner, clock = plain.node.create_publisher(TwistStamped, "cmd_vel_in", 1), plain.node
    plain.hear(TwistStamped, "cmd_vel")
    sent = []

    def moves_after(age: float, frame: str = "base_link", stamped: bool = True) -> bool:
        """Whether any of twenty commands passed."""
        before = len(plain.heard["cmd_vel"])
        for k in range(20):
            command = TwistStamped()
            command.header.frame_id, command.twist.linear.x = frame, 0.2
            if stamped:
                made = clock.get_clock().now().nanoseconds - round(age * 1e9) + k
                command.header.stamp = Time(sec=made // 10**9, nanosec=made % 10**9)
            sent.append(command)
            planner.publish(command)
            time.sleep(0.02)
        return any(m.twist.linear.x for m in plain.heard["cmd_vel"][before:])

    with board() as player:
        words = ["-p", f"port:={player.port}", "-p", "watchdog:=60.0", "-p", "tare:=false"]
        words += ["-p", "stamped:=true", "-p", "cmd_vel_gate:=true", "-p", "stale_after:=0.5"]
        graph.start("skin", skin(*words))
        with player.playing(endless("idle", seed=7)):
            plain.until(lambda: moves_after(0.0), "the robot moves", graph)
            for wrong in ((10.0,), (-10.0,), (0.0, "map")):
                time.sleep(0.3)  # for the last good one to end
                assert not moves_after(*wrong), wrong
            assert moves_after(0.0, frame="")
            assert moves_after(0.0, stamped=False)
    moved = [m.header for m in plain.heard["cmd_vel"] if m.twist.linear.x]
    assert {header.frame_id for header in moved} == {"base_link"}
    known = [command.header.stamp for command in sent]
    kept = [header.stamp in known for header in moved]
    assert sum(kept) > 20 and not all(kept)  # those without a stamp get one


@pytest.mark.skipif(not importlib.util.find_spec("websockets"), reason="no websockets here")
@pytest.mark.skipif(chromium.program() is None, reason="no Chromium here")
def test_the_page_draws_a_skin_in_a_namespace(graph, tmp_path):
    with board() as player, chromium.Chromium(tmp_path) as browser:
        place = "-r", "__ns:=/left"
        graph.start("skin", skin(*place, "-p", f"port:={player.port}", "-p", "watchdog:=60.0"))
        graph.start("view", program("view", *place, "-p", "port:=0"))
        with player.playing(endless("demo", seed=9)):
            graph.wait_for(lambda: "http://" in graph.said("view"), "the page is served")
            browser.open(re.search(r"http://[\d.]+:\d+", graph.said("view"))[0])
            browser.until("Number(document.body.dataset.draws) > 100")
    assert not browser.errors
