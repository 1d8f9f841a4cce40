# SPDX-License-Identifier: Apache-2.0
"""Who hears whom on ROS 2: quality of service, and the page in a browser."""

import importlib.util
import re

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


def test_qos_of_a_subscription_is_overridden(graph, plain):
    from rclpy.qos import ReliabilityPolicy

    name = "qos_overrides./skin/adc.subscription.reliability"
    words = ["-p", "serial_driver:=false", "-p", f"{name}:=reliable"]
    graph.start("skin", skin(*words))

    def found():
        ends = plain.node.get_subscriptions_info_by_topic("/skin/adc")
        return [end.qos_profile.reliability for end in ends]

    plain.until(lambda: found() == [ReliabilityPolicy.RELIABLE], "as the parameter says", graph)


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
