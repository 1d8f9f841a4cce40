# SPDX-License-Identifier: Apache-2.0
"""The shipped launch files in ROS 2's YAML grammar, as its documentation and its parser have it.

launch, launch_yaml and launch_ros are in no package registry, so that `ros2 launch` itself cannot
run here; `launch_yaml/README.md` of ros2/launch, the Launch-file-different-formats and
Launch-files-migration-guide pages of the ROS 2 documentation (Humble) say what is allowed.
"""

import re

import pytest
import yaml

from tactile_skin.launch import share_dir

ACTION = {"if", "unless"}
PROCESS = {"output", "cwd", "launch-prefix", "respawn", "respawn_delay", "shell", "env"} | ACTION
KEYS = {  # entity -> (keys it must have, keys it may have)
    "arg": ({"name"}, {"default", "description", "choice"} | ACTION),
    "let": ({"name", "value"}, ACTION),
    "executable": ({"cmd"}, {"name"} | PROCESS),
    "node": (
        {"pkg", "exec"},
        {"name", "namespace", "args", "ros_args", "param", "remap"} | PROCESS - {"shell"},
    ),
    "include": ({"file"}, {"arg"} | ACTION),
}
TYPED = {"respawn_delay": float}  # as launch compares it: no text; `respawn` is one
NESTED = {  # (entity, key) -> keys of each map in its list
    ("node", "param"): [{"from"}, {"from", "allow_substs"}, {"name", "value"}],
    ("node", "remap"): [{"from", "to"}],
    ("include", "arg"): [{"name", "value"}],
}
SUBSTITUTIONS = {  # name -> how many words may follow
    "var": (1, 2),
    "env": (1, 2),
    "dirname": (0,),
    "anon": (1,),
    "find-pkg-share": (1,),
    "find-pkg-prefix": (1,),
    "exec-in-pkg": (2,),
    "find-exec": (1,),
}
FILES = sorted(p.name for p in (share_dir() / "launch").glob("*.yaml"))


def texts(value):
    """Every scalar in it."""
    if isinstance(value, dict):
        value = list(value.values())
    for item in value if isinstance(value, list) else []:
        yield from texts(item)
    if not isinstance(value, list):
        yield value


def check(name: str, text: str) -> None:
    data = yaml.safe_load(text)
    assert list(data) == ["launch"]
    for entity in data["launch"]:
        ((kind, body),) = entity.items()
        assert kind in KEYS, f"{name}: {kind}"
        must, may = KEYS[kind]
        assert must <= set(body), f"{name}: {kind} lacks {must - set(body)}"
        assert set(body) <= must | may, f"{name}: {kind} has {set(body) - must - may}"
        for key, value in body.items():
            if (kind, key) in NESTED:
                assert all(set(item) in NESTED[kind, key] for item in value), f"{name}: {key}"
            else:  # elsewhere launch_yaml takes text alone: a bare number or true is an error
                kept = isinstance(value, TYPED.get(key, str))
                assert kept, f"{name}: {kind}: {key} = {value!r}"
        for value in texts(body):
            if isinstance(value, str):
                check_substitutions(name, value)


def check_substitutions(name: str, text: str) -> None:
    for found in re.finditer(r"\$\(([^()]*)\)", text):
        kind, *words = found[1].split()
        assert kind in SUBSTITUTIONS, f"{name}: {found[0]}"
        assert len(words) in SUBSTITUTIONS[kind], f"{name}: {found[0]}"
    assert "$(" not in re.sub(r"\$\([^()]*\)", "", text), f"{name}: {text}"


@pytest.mark.parametrize("name", FILES)
def test_a_shipped_launch_file_is_in_ros_2s_grammar(name):
    check(name, (share_dir() / "launch" / name).read_text())


def test_a_node_has_an_executable_of_its_name():
    """`exec` is what setup.py installs to lib/tactile_skin."""
    from tactile_skin.middleware.package import COMPOSED, NODES

    for name in FILES:
        data = yaml.safe_load((share_dir() / "launch" / name).read_text())
        for entity in data["launch"]:
            node = entity.get("node", {})
            assert node.get("exec") in (*NODES, COMPOSED) or node.get("pkg") != "tactile_skin"


def test_ros_starts_each_process_of_a_skin_again():
    """But the monitor, which ends after its duration; our own launcher has none to start again."""
    path = share_dir() / "launch" / "nodes.launch.yaml"
    for node in (entity["node"] for entity in yaml.safe_load(path.read_text())["launch"]):
        assert node.get("respawn") == (None if node["exec"] == "monitor" else "true")
        assert node.get("respawn_delay", 1.0) > 0.0  # a wrong parameter ends it at once


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
