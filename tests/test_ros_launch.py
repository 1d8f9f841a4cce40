# SPDX-License-Identifier: Apache-2.0
"""Each launch file by `ros2 launch`: it starts, stops on a push, and ends at Ctrl-C.

body.launch.yaml is in test_ros_body.py, examples/robot in test_ros_robot.py.
"""

import os
import re
import signal

import pytest
import yaml
from support.ros_graph import Status, board, endless, stand_in

from tactile_skin.launch import share_dir


def config(folder):
    """A skin's parameter file without a tare: what plays may press from the start."""
    path = folder / "skin.yaml"
    own = {"compensation": {"tare": False}, "stop_on_push": {"stale_after": 0.5}}
    path.write_text(yaml.safe_dump({f"/**/{n}": {"ros__parameters": v} for n, v in own.items()}))
    return path


@pytest.mark.ros
def test_the_demo_starts_its_board_and_ends_with_it(graph, plain, ros2):
    """After its duration, which ends the program, and the board by --once."""
    status = Status(plain)
    graph.launch("demo", "tactile_skin", "demo.launch.yaml", "scene:=push_left", "duration:=5")
    plain.until(status.pushed, "a push", graph)
    graph.processes["demo"].wait(60.0)
    graph.end_launch("demo")


@pytest.mark.ros
def test_each_node_of_a_skin_as_a_process(graph, plain, ros2, tmp_path):
    """And what docs/robot.md does with them: `ros2 topic`, `node`, `param`, `run`."""
    status = Status(plain)
    asked = [f"{name}:=true" for name in ("separate", "gestures", "cmd_vel_gate", "view")]
    with board() as player:
        asked += [f"port:={player.port}", f"config:={config(tmp_path)}", "view_port:=0"]
        graph.launch("skin", "tactile_skin", "skin.launch.yaml", *asked)
        with player.playing(endless("idle", 41)):
            plain.until(status.free, "free", graph)
        (stop,) = plain.node.get_publishers_info_by_topic("skin/stop")
        limits = stop.qos_profile.deadline, stop.qos_profile.lifespan
        assert [limit.nanoseconds for limit in limits] == [1e8, 1e9]
        with player.playing(endless("push_left", 42)):
            plain.until(status.pushed, "a push", graph)
            limit = "/stop_on_push threshold"
            for words, said in (
                ("topic echo --once --no-daemon /skin/stop std_msgs/msg/Bool", "data: true"),
                ("node list --no-daemon --spin-time 5", "/gesture_feature\n"),
                (f"param describe --no-daemon --timeout 20 {limit}", "500.0"),
                (f"param set --no-daemon --timeout 20 {limit} 1.0", "at most threshold = 1.0 N"),
                (f"param set --no-daemon --timeout 20 {limit} 25.0", "successful"),
                ("param set --no-daemon --timeout 20 /stop_on_push latch true", "read-only"),
                ("run tactile_skin tactile-skin --help", "usage: tactile-skin"),
            ):
                assert said in ros2(*words.split())
        with player.playing(endless("idle", 43)):
            plain.until(status.free, "free again", graph)
            os.kill(graph.processes_of("skin")["compensation"], signal.SIGKILL)
            plain.until(lambda: "no longer arrive" in status.message, "it is missed", graph)
            plain.until(status.free, "it is back", graph)
        graph.end_launch("skin", killed=1)


@pytest.mark.ros
def test_rviz_is_started_next_to_a_skin(graph, plain, ros2, tmp_path):
    said = stand_in(graph, tmp_path, "rviz2")
    graph.launch("rviz", "tactile_skin", "rviz.launch.yaml", "namespace:=left")
    plain.until(lambda: plain.node.count_publishers("/left/skin/push_arrow"), "the arrow", graph)
    assert "/skin/pressure:=skin/pressure" in said.read_text()
    graph.end_launch("rviz")


def test_the_pages_yaml_fits_the_skin():
    """Topics and types that the nodes publish, and a lock that outlives a few lost heartbeats."""
    from tactile_skin.nodes.cmd_vel import PERIOD
    from tactile_skin.nodes.stop_on_push import HEARTBEAT

    page = (share_dir() / "docs" / "robot.md").read_text()
    blocks = [yaml.safe_load(b) for b in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)]
    found = {name: block["ros__parameters"] for b in blocks for name, block in b.items()}
    lock = found["twist_mux"]["locks"]["skin"]
    assert lock["topic"] == "skin/stop"
    assert 3 * HEARTBEAT < lock["timeout"] <= 0.2  # 0 would switch the fail-safe off
    assert all(t["priority"] < lock["priority"] for t in found["twist_mux"]["topics"].values())
    (base,) = re.findall(r"cmd_vel_timeout: ([\d.]+)", page)
    assert 5 * PERIOD < float(base) < lock["timeout"]  # a killed gate is noticed within it
    monitor = found["collision_monitor"]
    source = monitor[monitor["observation_sources"][0]]
    assert (source["type"], source["topic"]) == ("pointcloud", "skin/contacts")
    assert 0.0 < monitor["source_timeout"] <= 0.5
    (zone,) = monitor["polygons"]
    config = yaml.safe_load((share_dir() / "config" / "skin.yaml").read_text())["/**"]
    geometry = config["ros__parameters"]["geometry"]
    assert monitor[zone]["radius"] > geometry["radius"] and monitor[zone]["min_points"] == 1


def test_rviz_shows_topics_that_the_nodes_publish():
    """Each with a display for its type; the frame is the skin's."""
    from tactile_skin.middleware.bus import Context, Node
    from tactile_skin.middleware.package import node_class

    shown = yaml.safe_load((share_dir() / "config" / "skin.rviz").read_text())
    manager = shown["Visualization Manager"]
    config = yaml.safe_load((share_dir() / "config" / "skin.yaml").read_text())
    frame = config["/**"]["ros__parameters"]["frame_id"]
    assert manager["Global Options"]["Fixed Frame"] == frame
    context = Context()
    for name in ("compensation", "gesture_feature", "push_arrow"):
        node_class(name)(Node(name, context=context))
    kinds = {"Image": "Image", "PointCloud2": "PointCloud2", "Wrench": "WrenchStamped"}
    kinds["Polygon"] = "PolygonStamped"
    drawn = {}
    for display in manager["Displays"]:
        plugin = display["Class"].removeprefix("rviz_default_plugins/")
        if plugin in kinds:
            topic = display["Topic"]["Value"]
            drawn[topic] = context._topic_type[topic].__name__
            assert drawn[topic] == kinds[plugin]
    assert set(drawn) == {"/skin/pressure", "/skin/contacts", "/skin/wrench", "/skin/push_arrow"}
    (contacts,) = [d for d in manager["Displays"] if d["Name"] == "Contacts"]
    assert contacts["Channel Name"] == "force"
