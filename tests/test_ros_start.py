# SPDX-License-Identifier: Apache-2.0
"""How a skin starts on ROS 2, and with whom: clocks, boards that come later, a second skin."""

import signal
import subprocess
import sys
import time

import pytest
import yaml
from support.ros_graph import board, endless, program, skin

from tactile_skin import launch

LOADS = "import sys; print('go', flush=True); from tactile_skin.__main__ import skin; "
LOADS += "sys.exit(skin(['--ros-args', '-p', 'port:=/dev/none']))"


@pytest.mark.ros
def test_each_node_says_that_its_clock_is_simulated(graph, plain):
    """One of them hears /clock, for all of the process."""
    from rclpy.parameter_client import AsyncParameterClient

    graph.start("skin", skin("-p", "serial_driver:=false", "-p", "use_sim_time:=true"))
    for name in ("compensation", "gesture_feature", "stop_on_push"):
        client = AsyncParameterClient(plain.node, name)
        plain.until(client.services_are_ready, f"{name} runs", graph)
        future = client.get_parameters(["use_sim_time"])
        plain.until(future.done, "parameters are there", graph)
        assert future.result().values[0].bool_value, name
    assert len(plain.node.get_subscriptions_info_by_topic("/clock")) == 1


@pytest.mark.ros
def test_a_skin_waits_for_a_board_that_is_absent_at_its_start(graph, plain, tmp_path):
    """Stopped, with the reason; and is free once the board is there."""
    from diagnostic_msgs.msg import DiagnosticArray

    link, topic = tmp_path / "board", "skin/stop_status"
    plain.hear(DiagnosticArray, topic)
    graph.start("skin", skin("-p", f"port:={link}", "-p", "tare:=false", "-p", "stale_after:=0.5"))

    def says(text: str) -> bool:
        return bool(plain.heard[topic]) and text in plain.last(topic).status[0].message

    plain.until(lambda: says(f"{link} does not exist"), "it says why it is stopped", graph)
    with board() as player:
        link.symlink_to(player.port)
        with player.playing(endless("idle", seed=11)):
            plain.until(lambda: plain.last(topic).status[0].message == "", "it is free", graph)
    assert graph.processes["skin"].poll() is None


@pytest.mark.ros
@pytest.mark.parametrize("wrong", ["{}", "carrier-pigeon://home"])
def test_a_port_that_cannot_become_a_board_ends_the_skin(graph, tmp_path, wrong):
    words = skin("-p", f"port:={wrong.format(tmp_path)}")
    done = subprocess.run(words, env=graph.env, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "error: " in done.stderr.splitlines()[-1]


@pytest.mark.ros
def test_two_skins_of_one_name_say_so(graph):
    with board() as player:
        for name in ("one", "other"):
            graph.start(name, skin("-p", "serial_driver:=false"))
        said = "/skin/stop: another process publishes it as well"
        with player.playing(endless("idle", seed=12)):
            graph.wait_for(lambda: all(said in graph.said(n) for n in ("one", "other")), "they do")
        assert "/diagnostics: another" not in graph.said("one")


@pytest.mark.ros
def test_a_process_from_which_ros_keeps_a_publisher_ends_for_another_start(graph, plain, tmp_path):
    """As after a kill -9, in some of a hundred starts: it heard nothing for ever. One whose driver
    is not there waits for it, and so does one whose driver is of another skin. So does a body."""
    import rclpy

    context, far = plain.node.context, {"elsewhere": True, "port": "/dev/ttyUSB0"}
    driver = rclpy.create_node("serial_driver", namespace="left", context=context)
    stop = rclpy.create_node("stop_on_push", namespace="back", context=context)
    skins = {"back": far | {"geometry": {"shape": "plane"}}}
    config = tmp_path / "robot.yaml"
    config.write_text(yaml.safe_dump({"skins": skins}))
    graph.start("body", program("body", "-p", f"config:={config}", "-p", "separate:=true"))
    for side in ("left", "right"):
        graph.start(side, program("compensation", "-r", f"__ns:=/{side}"))
    plain.until(lambda: graph.processes["left"].poll() is not None, "it ends", graph)
    assert graph.processes["left"].returncode == 1
    assert "does not show that it publishes /left/skin/adc" in graph.said("left")
    assert graph.processes["right"].poll() is None
    plain.until(lambda: graph.processes["body"].poll() is not None, "it ends", graph)
    assert "does not show that it publishes /back/skin/stop_status" in graph.said("body")
    driver.destroy_node()
    stop.destroy_node()


def test_a_namespace_is_an_argument():
    given = {"port": "loop://", "namespace": "left", "view": "true", "monitor": "false"}
    plan = launch.read_plan(launch.find("skin.launch.yaml"), given)
    assert {node.namespace for node in plan.nodes} == {"left"}


@pytest.mark.ros
@pytest.mark.parametrize("delay", [0.05, 0.15, 0.3, 0.5])
def test_ctrl_c_while_the_program_loads_prints_no_traceback(rclpy, delay):
    words = [sys.executable, "-c", LOADS]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as made:
        assert made.stdout.readline() == "go\n"
        time.sleep(delay)
        made.send_signal(signal.SIGINT)
        _, said = made.communicate(timeout=30)
    assert "Traceback" not in said
