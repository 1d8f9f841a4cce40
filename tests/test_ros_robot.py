# SPDX-License-Identifier: Apache-2.0
"""examples/robot on rclpy: a push on each skin stops the base, motion away from it passes."""

import os
import shutil
import signal
import sys
import time
import xml.etree.ElementTree as ET
from contextlib import contextmanager

import pytest
import yaml
from support.ros_graph import board, endless, stand_in

from tactile_skin.launch import share_dir
from tactile_skin.middleware.parameter_file import ParameterFile

FOLDER = share_dir() / "examples" / "robot"
SIDES = {"front": 1.0, "rear": -1.0}  # skin -> x of the direction in which it looks


@pytest.mark.parametrize("side", SIDES)
def test_the_skins_are_where_the_urdf_mounts_them(side):
    file = ParameterFile(FOLDER / "skins.yaml")
    given = {p.name: p.value for p in file.overrides(f"/{side}/gesture_feature")}
    joints = ET.parse(FOLDER / "robot.urdf").getroot().iter("joint")
    (origin,) = [j.find("origin") for j in joints if j.get("name") == f"{side}_skin_mount"]
    places = (
        ("xyz", given["geometry.translation"]),
        ("rpy", given.get("geometry.rpy", [0.0, 0.0, 0.0])),
    )
    for key, here in places:
        assert [float(word) for word in origin.get(key).split()] == here


@contextmanager
def feeling(players, pushed: str | None):
    """Both skins feel nothing, or one of them a push."""
    scenes = [("push_left" if side == pushed else "idle") for side in SIDES]
    front, rear = (endless(scene, seed=k) for k, scene in enumerate(scenes, 30))
    with players["front"].playing(front), players["rear"].playing(rear):
        yield


@pytest.mark.ros
def test_a_push_on_each_skin_stops_the_base_and_motion_away_passes(graph, plain, ros2, tmp_path):
    """By `ros2 launch`; a skin that is killed stops the base, and comes back."""
    from geometry_msgs.msg import Twist

    asked = Twist()
    mux = plain.node.create_publisher(Twist, "front/cmd_vel_in", 1)
    plain.node.create_timer(0.05, lambda: mux.publish(asked))
    plain.hear(Twist, "velocity")

    def drives(speed: float, what: str) -> None:
        """Wait until it drives so, and see that it goes on."""

        def steady() -> bool:
            return [m.linear.x for m in plain.heard["velocity"][-10:]] == [speed] * 10

        plain.until(steady, what, graph)

    with board() as front, board() as rear:
        players = {"front": front, "rear": rear}
        folder = tmp_path / "robot"
        shutil.copytree(FOLDER, folder)
        with (folder / "skins.yaml").open("a") as skins:  # what plays may press from the start
            for node, own in (
                ("compensation", {"tare": False}),
                ("serial_driver", {"watchdog": 60.0}),
                ("stop_on_push", {"stale_after": 0.5}),
            ):
                skins.write(yaml.safe_dump({f"/**/{node}": {"ros__parameters": own}}))
        stand_in(graph, tmp_path, "twist_mux")
        ports = [f"{side}_port:={player.port}" for side, player in players.items()]
        graph.launch("robot", folder / "robot.launch.yaml", "boards:=false", *ports)
        for pushed, outwards in SIDES.items():
            with feeling(players, None):
                asked.linear.x = 0.2 * outwards
                drives(0.2 * outwards, f"free, towards the {pushed}")
            with feeling(players, pushed):
                drives(0.0, f"pushed at the {pushed}: no motion into the hand")
                asked.linear.x = -0.2 * outwards
                drives(-0.2 * outwards, f"pushed at the {pushed}: away from the hand")
        with feeling(players, None):
            drives(0.2, "free again")
            os.kill(graph.processes_of("robot")["front/skin"], signal.SIGKILL)
            killed = time.monotonic()
            drives(0.0, "a skin is gone")
            assert time.monotonic() - killed < 5.0
            drives(0.2, "it is back")
        graph.end_launch("robot", killed=1)


@pytest.mark.ros
def test_a_skin_runs_in_the_process_of_a_users_own_node(graph, plain):
    """Its node, executor and context are rclpy's own; Ctrl-C ends both, with a final stop."""
    from std_msgs.msg import Bool

    assert len((FOLDER / "listen.py").read_text().splitlines()) < 40
    plain.hear(Bool, "left/skin/stop")
    with board() as player, player.playing(endless("push_left", seed=33)):
        words = ["-p", f"port:={player.port}", "-p", "tare:=false", "-r", "__ns:=/left"]
        graph.start("own", [sys.executable, str(FOLDER / "listen.py"), "--ros-args", *words])
        graph.wait_for(lambda: graph.hears("own", "kPa", "contact 1: "), "it hears the skin")
        plain.until(lambda: plain.heard["left/skin/stop"], "its stop is heard", graph)
        graph.stop("own", signal.SIGINT)
    plain.until(lambda: plain.last("left/skin/stop").data, "a final stop", graph)
    said = graph.said("own")
    # pybind11, in rclpy, makes an error of its own of an interrupt while it converts an argument
    assert "Traceback" not in said or "Unable to convert call argument" in said
