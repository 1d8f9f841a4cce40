# SPDX-License-Identifier: Apache-2.0
"""What ROS 2's users write on a command line, in a parameter file and in package.xml."""

import contextlib
import json
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest
import yaml

from tactile_skin import launch, ros
from tactile_skin.errors import ParameterError
from tactile_skin.launch import LaunchError, Skin
from tactile_skin.middleware.package import PARTS, SKIN_NODES
from tactile_skin.middleware.parameter_file import ParameterFile

# As far as this package needs them: rosdep/base.yaml, rosdep/python.yaml and the packages of the
# distributions in ros/rosdistro. python3-threadpoolctl and the like are no keys; torch has one that
# pip installs, which Debian and Ubuntu refuse (PEP 668).
ROSDISTRO = {
    *("rclpy", "rcl_interfaces", "builtin_interfaces", "std_msgs", "std_srvs", "geometry_msgs"),
    *("sensor_msgs", "diagnostic_msgs", "rosgraph_msgs", "ros2launch", "launch_yaml", "rviz2"),
    "tf2_msgs",
    *("python3-dev", "python3-numpy", "python3-scipy", "python3-serial", "python3-yaml"),
    "python3-ruamel.yaml",
    *("python3-pytest", "python3-hypothesis"),
}


def test_rosdep_knows_what_the_package_depends_on():
    root = ET.parse(launch.share_dir() / "package.xml").getroot()
    keys = {element.text for element in root if element.tag.endswith("depend")}
    assert len(keys) > 10
    assert keys <= ROSDISTRO
    assert "rviz2" not in keys  # a robot without a screen needs none
    assert "tf2_msgs" in keys


# --- parameter files ---

SECTIONS = """
stop_on_push: {ros__parameters: {bare: 1, order: 1}}
/left/stop_on_push: {ros__parameters: {full: 1, order: 2}}
/**/stop_on_push: {ros__parameters: {any_namespace: 1, order: 3, nested: {deep: 1.5}}}
right:
  arm:
    stop_on_push: {ros__parameters: {deep_nested: 1}}
/**: {ros__parameters: {all: 1, order: 8}}
right/stop_on_push: {ros__parameters: {no_slash: 1}}
"""
NODES = ("/stop_on_push", "/left/stop_on_push", "/right/arm/stop_on_push", "/a/left/stop_on_push")
ASK = """
import json, sys, rclpy
rclpy.init(args=["--ros-args", "--params-file", sys.argv[1]])
found = {}
for full in sys.argv[2:]:
    namespace, name = full.rsplit("/", 1)
    node = rclpy.create_node(name, namespace=namespace or "/",
        automatically_declare_parameters_from_overrides=True)
    found[full] = {k: p.value for k, p in node.get_parameters_by_prefix("").items()}
print(json.dumps(found))
"""


@pytest.fixture
def sections(tmp_path):
    path = tmp_path / "skin.yaml"
    path.write_text(SECTIONS)
    return path


def given(path, node: str) -> dict:
    return {p.name: p.value for p in ParameterFile(path).overrides(node)}


def test_sections_hold_in_namespaces(sections):
    left = given(sections, "/left/stop_on_push")
    assert {"full", "any_namespace", "all"} <= set(left)
    assert left["nested.deep"] == 1.5
    assert not {"bare", "no_slash"} & set(left)
    assert left["order"] == 8  # what comes later in the file
    assert "deep_nested" in given(sections, "/right/arm/stop_on_push")


@pytest.mark.parametrize("name", ["/*", "/left/**", "/*/stop_on_push", "/**/left/**/stop_on_push"])
def test_another_wildcard_is_refused_with_those_there_are(tmp_path, name):
    path = tmp_path / "skin.yaml"
    path.write_text(f"{name}: {{ros__parameters: {{}}}}\n")
    with pytest.raises(
        ValueError,
        match=r"must be /\*\*, /\*\*/NODE or a node's full name; what is of .* stands under skins",
    ):
        ParameterFile(path)


@pytest.mark.ros
def test_sections_mean_what_they_mean_to_rclpy(sections, rclpy):
    words = [sys.executable, "-c", ASK, str(sections), *NODES]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    theirs = json.loads(done.stdout)
    for node in NODES:
        mine, own = given(sections, node), {"use_sim_time", "start_type_description_service"}
        assert mine == {k: v for k, v in theirs[node].items() if k not in own}


def test_a_file_for_another_namespace_is_refused(tmp_path):
    """ROS would run the node on its defaults."""
    path = tmp_path / "skin.yaml"
    path.write_text("stop_on_push: {ros__parameters: {threshold: 20.0}}\n")
    plan = ros.plan_of("stop_on_push", arguments("-r", "__ns:=/left", "--params-file", str(path)))
    with pytest.raises(ParameterError, match="must be /\\*\\*/stop_on_push") as error:
        Skin(plan).build()
    assert "is not for the node /left/stop_on_push" in str(error.value)


# --- arguments ---


def arguments(*words):
    return ros.split_arguments(["--ros-args", *words])[1]


def test_words_for_ros_itself_are_handed_on():
    words = ["--log-level", "debug", "--disable-rosout-logs", "--log-config-file", "a"]
    assert arguments(*words).others == words


def test_arguments_for_one_node_of_several():
    args = arguments(
        *("-r", "stop_on_push:skin/stop:=/halt", "-r", "skin/stop:=/other"),
        *("-p", "stop_on_push:threshold:=20.0", "-p", "monitor:duration:=3.0"),
        *("-r", "stop_on_push:__node:=guard", "-r", "__ns:=/left", "-r", "__node:=whole"),
    )
    nodes = {node.executable: node for node in ros.plan_of("skin", args).nodes}
    assert set(nodes) == {"serial_driver", "compensation", "gesture_feature", "stop_on_push"}
    assert nodes["stop_on_push"].name == "guard"
    assert nodes["compensation"].name == "compensation"  # not all of them "whole"
    assert nodes["stop_on_push"].values() == {"threshold": 20.0}
    assert nodes["compensation"].parameters == []
    assert nodes["stop_on_push"].namespace == "left"
    (made,) = Skin(ros.Plan([nodes["stop_on_push"]])).build()
    assert made.resolve_topic_name("skin/stop") == "/halt"
    other = nodes["compensation"].remappings
    assert other == [("skin/stop", "/other")]


def test_the_parts_of_a_skin_are_chosen_by_parameters(tmp_path):
    path = tmp_path / "launch_params_x"
    path.write_text("/**: {ros__parameters: {monitor: true, serial_driver: false}}\n")
    plan = ros.plan_of("skin", arguments("--params-file", str(path)))
    kinds = [node.executable for node in plan.nodes]
    assert kinds == ["compensation", "gesture_feature", "stop_on_push", "monitor"]
    with pytest.raises(ParameterError, match="monitor of skin = 'yes': must be true or false"):
        ros.plan_of("skin", arguments("-p", "monitor:='yes'"))


@pytest.mark.parametrize("name", ["launch_params_abc", "robot.yaml"])
def test_an_argument_that_was_not_given_leaves_the_parameter_file(tmp_path, name):
    """`ros2 launch` hands an empty one over as an empty text; elsewhere that is a value."""
    config, written = tmp_path / "mine.yaml", tmp_path / name
    config.write_text("/**/stop_on_push: {ros__parameters: {threshold: 12.0}}\n")
    written.write_text("/**: {ros__parameters: {threshold: '', release: 3.0}}\n")
    words = ["--params-file", str(config), "--params-file", str(written)]
    program = Skin(ros.plan_of("stop_on_push", arguments(*words)))
    if name == "robot.yaml":
        with pytest.raises(LaunchError, match="threshold of node stop_on_push = ''"):
            program.build()
        return
    program.build()
    config = program._nodes[0].policy.config
    assert (config.threshold, config.release) == (12.0, 3.0)


def test_what_the_shipped_launch_file_gives_the_program_is_taken():
    """Also for parts that do not run: `stamped`, and the duration of a monitor."""
    shipped = yaml.safe_load(launch.find("skin.launch.yaml").read_text())["launch"]
    (skin,) = [e["node"] for e in shipped if e.get("node", {}).get("exec") == "skin"]
    names = [p["name"] for p in skin["param"] if p["name"] not in ("config", *PARTS)]
    plan = ros.plan_of("skin", arguments(*(w for name in names for w in ("-p", f"{name}:=1"))))
    assert {node.executable for node in plan.nodes} == {*SKIN_NODES}


BY_HAND = "skin: {ros__parameters: {threshold: 25.0, circuit: {rows: 8}}}"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--params-file", "FILE"], BY_HAND),
        (["-p", "config:=FILE"], BY_HAND),
        (["-r", "__node:=torso", "--params-file", "FILE"], BY_HAND.replace("skin", "torso")),
        (["-r", "__node:=torso", "--params-file", "FILE"], BY_HAND),
        (["-r", "__ns:=/left", "--params-file", "FILE"], f"left: {{{BY_HAND}}}"),
        (["-r", "skin:__ns:=/left", "--params-file", "FILE"], f"left: {{{BY_HAND}}}"),
        (["-p", "skin:threshold:=25.0", "-p", "skin:circuit.rows:=8"], ""),
        (["-r", "__node:=torso", "-p", "torso:threshold:=25.0", "-p", "torso:circuit.rows:=8"], ""),
    ],
)
@pytest.mark.parametrize("name", ["robot.yaml", "launch_params_x"])
def test_what_is_for_the_program_is_for_each_of_its_nodes(tmp_path, words, text, name):
    path = tmp_path / name
    path.write_text(text)
    plan = ros.plan_of("skin", arguments(*(w.replace("FILE", str(path)) for w in words)))
    values = {node.executable: node.values() for node in plan.nodes}
    assert values["stop_on_push"]["threshold"] == 25.0
    assert values["compensation"]["circuit.rows"] == 8


def test_what_a_launch_file_gives_a_program_of_another_name(tmp_path):
    """launch_ros writes the node's full name for the section where the launch file names it."""
    path = tmp_path / "launch_params_x"
    path.write_text("/left/torso: {ros__parameters: {threshold: 25.0, method: '', monitor: true}}")
    words = ["-r", "__ns:=/left", "-r", "__node:=torso", "--params-file", str(path)]
    nodes = {node.executable: node for node in ros.plan_of("skin", arguments(*words)).nodes}
    assert nodes["stop_on_push"].values()["threshold"] == 25.0
    assert "monitor" in nodes and "method" not in nodes["compensation"].values()


@pytest.mark.parametrize("name", ["serial_driver", "stop_on_push", "cmd_vel_gate", "skin"])
@pytest.mark.parametrize("by_launch", [False, True])
def test_a_config_that_is_named_and_absent_is_an_error(tmp_path, name, by_launch, capsys):
    path = tmp_path / "launch_params_x"
    path.write_text("/**: {ros__parameters: {config: typo.yaml}}\n")
    words = ["--params-file", str(path)] if by_launch else ["-p", "config:=typo.yaml"]
    assert ros.run(name, ["--ros-args", *words]) == 2
    assert "parameter file typo.yaml: No such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-p", "stop_on_psh:threshold:=20.0"], "stop_on_psh: no such node; did you mean"),
        (["-r", "gate:cmd_vel:=wheels"], "gate: no such node"),
        (["-r", "gate:__ns:=/left"], "gate: no such node"),
        (["-p", "skin:treshold:=20.0"], "parameter 'treshold' is unknown; there are"),
        (["-r", "__ns:=/left", "--params-file", "FILE"], "is not for the node /left/skin"),
    ],
)
def test_what_is_for_no_node_of_the_program_is_refused(tmp_path, words, said):
    path = tmp_path / "skin.yaml"
    path.write_text(BY_HAND)
    with pytest.raises(ValueError, match=said):
        Skin(ros.plan_of("skin", arguments(*(w.replace("FILE", str(path)) for w in words)))).build()


# --- misspelt names ---


@pytest.mark.parametrize("name", ["launch_params_abc", "robot.yaml"])
def test_a_misspelt_name_in_a_launch_file_is_refused(tmp_path, name):
    """launch_ros writes what a launch file says into a file with one section, /**; in a user's own
    file that section may be meant for others."""
    path = tmp_path / name
    path.write_text("/**: {ros__parameters: {tresh_hold: 20.0}}\n")
    ours = name != "robot.yaml"
    refused = pytest.raises(LaunchError, match="parameter 'tresh_hold' is unknown")
    for program in ("skin", "stop_on_push"):
        with refused if ours else contextlib.nullcontext():
            plan = ros.plan_of(program, arguments("--params-file", str(path)))
            plan.nodes = [node for node in plan.nodes if node.executable == "stop_on_push"]
            Skin(plan).build()


@pytest.mark.parametrize("whole", [False, True])
def test_names_are_checked_before_values(tmp_path, whole):
    """A threshold that is misspelt leaves one that is below `release`."""
    path = tmp_path / "skin.yaml"
    section = "/**/stop_on_push: {ros__parameters: {treshold: 60.0, release: 50.0}}\n"
    path.write_text(section)
    words = ["--params-file", str(path)]
    if whole:
        words = ["-p", "treshold:=60.0", "-p", "release:=50.0"]
    plan = ros.plan_of("stop_on_push", arguments(*words))
    with pytest.raises(ValueError, match=r"'treshold' is unknown; there are: .*threshold"):
        Skin(plan).build()
