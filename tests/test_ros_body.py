# SPDX-License-Identifier: Apache-2.0
"""body.launch.yaml by `ros2 launch`: one stop for several skins, whose reason names the skin."""

import contextlib
import os
import signal
from pathlib import Path

import pytest
import yaml
from support.ros_graph import Status, board, endless

NAMES = "chest", "back"


def write(folder, boards, elsewhere=()) -> Path:
    """The body's file, of boards by the names of their skins; some on another computer."""
    skins = {
        name: {
            "port": player.port,
            "geometry": {"shape": "plane", "translation": [0.5 * k, 0.0, 0.0]},
            "stop_on_push": {"stale_after": 0.5},
            "elsewhere": name in elsewhere,
        }
        for k, (name, player) in enumerate(boards.items())
    }
    config = folder / "robot.yaml"
    config.write_text(yaml.safe_dump({"skins": skins}))
    return config


@pytest.mark.ros
def test_a_process_that_is_killed_stops_with_its_skins_name_and_comes_back(
    graph, plain, ros2, tmp_path
):
    """Launch starts it again, the body's own as well; the other skins go on meanwhile."""
    from sensor_msgs.msg import Image

    status = Status(plain)
    for name in NAMES:
        plain.hear(Image, f"{name}/skin/pressure")
    with contextlib.ExitStack() as stack:
        boards = {name: stack.enter_context(board()) for name in NAMES}
        for k, player in enumerate(boards.values()):
            stack.enter_context(player.playing(endless("idle", k)))
        words = f"config:={write(tmp_path, boards)}", "separate:=true", "cmd_vel_gate:=true"
        graph.launch(
            "body", "tactile_skin", "body.launch.yaml", *words, "view:=true", "view_port:=0"
        )
        plain.until(status.free, "free", graph)
        chest, back = (f"{name}/skin" for name in NAMES)
        for killed in (back, "body"):
            numbers = graph.processes_of("body")
            assert numbers.keys() == {chest, back, "body", "cmd_vel_gate", "monitor", "view"}
            os.kill(numbers[killed], signal.SIGKILL)
            if killed == back:
                silent = lambda: "back: stale: no message from its stop" in status.message  # noqa: E731
                plain.until(silent, "a stop", graph)
                plain.until(lambda: status.skins == ["back"], "its name", graph)
                del plain.heard["chest/skin/pressure"][:]
                plain.until(
                    lambda: plain.last("chest/skin/pressure"), "the other's pictures", graph
                )
            left = numbers[killed]
            again = lambda: graph.processes_of("body").get(killed, left) != left  # noqa: B023, E731
            plain.until(again, f"{killed} starts again", graph)
            status.forget()
            plain.until(status.free, "free again", graph)
        graph.end_launch("body", killed=2)


@pytest.mark.ros
def test_all_skins_of_a_body_in_one_process(graph, plain, ros2, tmp_path):
    status = Status(plain)
    with board() as chest, board() as back:
        boards = dict(zip(NAMES, (chest, back), strict=True))
        config = write(tmp_path, boards)
        graph.launch(
            "body", "tactile_skin", "body.launch.yaml", f"config:={config}", "separate:=false"
        )
        with chest.playing(endless("idle", 4)):
            with back.playing(endless("idle", 5)):
                plain.until(status.free, "free", graph)
            with back.playing(endless("push_left", 6)):
                plain.until(status.pushed, "a push", graph)
                assert status.skins == ["back"]
        graph.end_launch("body")
