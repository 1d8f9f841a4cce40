# SPDX-License-Identifier: Apache-2.0
"""Several skins as one body on rclpy: one program, one stop whose reason names the skin."""

import contextlib
import os
import signal
from pathlib import Path

import pytest
import yaml
from support.ros_graph import board, endless, program

NAMES = "chest", "back"
FOUR = *NAMES, "left_arm", "right_arm"


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


def processes_of(parent: int) -> dict[str, int]:
    """The processes that a body has started: name of the skin -> its number."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (folder / "cmdline").read_text().split("\0")
            status = (folder / "stat").read_text().rpartition(")")[2].split()
            spaces = [word.partition(":=/")[2] for word in words if word.startswith("__ns:=/")]
            if int(status[1]) == parent and spaces:
                found[spaces[0]] = int(folder.name)
    return found


@pytest.mark.ros
def test_a_process_that_is_killed_stops_with_its_skins_name_and_the_others_go_on(
    graph, plain, tmp_path
):
    """As `ros2 launch` writes what body.launch.yaml separate:=true gives."""
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import Image

    plain.hear(DiagnosticArray, "skin/stop_status")
    for name in FOUR:
        plain.hear(Image, f"{name}/skin/pressure")
    with contextlib.ExitStack() as stack:
        boards = {name: stack.enter_context(board()) for name in FOUR}
        for k, player in enumerate(boards.values()):
            stack.enter_context(player.playing(endless("idle", k)))
        given = {"config": str(write(tmp_path, boards)), "separate": True, "method": ""}
        path = tmp_path / "launch_params_x"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
        graph.start("body", program("body", "--params-file", str(path)))

        def status():
            return plain.heard["skin/stop_status"][-1].status[0]

        def free() -> bool:
            return bool(plain.heard["skin/stop_status"]) and not status().message

        plain.until(free, "free", graph)
        numbers = processes_of(graph.processes["body"].pid)
        assert numbers.keys() == set(FOUR)
        left = list(FOUR)
        for killed in FOUR[:3]:
            left.remove(killed)
            os.kill(numbers[killed], signal.SIGKILL)
            words = f"{killed}: stale: no message from its stop"
            plain.until(lambda words=words: words in status().message, words, graph)
            values = {pair.key: pair.value for pair in status().values}
            assert "stale" in values["causes"].split() and killed in values["skins"].split()
            for name in left:
                before = len(plain.heard[f"{name}/skin/pressure"])
                more = lambda: len(plain.heard[f"{name}/skin/pressure"]) > before  # noqa: B023,E731
                plain.until(more, f"pictures of {name}", graph)
        os.kill(graph.processes.pop("body").pid, signal.SIGKILL)

        def ended() -> bool:
            return not Path(f"/proc/{numbers[FOUR[3]]}").exists()

        plain.until(ended, "the skin of a body that is killed ends", graph)
