# SPDX-License-Identifier: Apache-2.0
"""A parameter file that is missing, misspelt, partial or foreign never ends in a free robot."""

import pytest
import yaml

from tactile_skin import launch, ros
from tactile_skin.launch import Skin, read_plan, read_skin

SECTION = "/**: {ros__parameters: {%s}}\n"
REFUSED = {  # name -> what the file holds, None: there is none; and words of the refusal
    "absent": (None, "No such file"),
    "empty": ("", "is empty"),
    "no YAML": ("/**: {ros__parameters: {", "mine.yaml"),
    "a list": ("- threshold: 30.0\n", "must map node names"),
    "no ros__parameters": ("/**: {parameters: {}}\n", "must hold ros__parameters"),
    "foreign": ("amcl: {ros__parameters: {alpha1: 0.2}}\n", "amcl: no such node"),
    "node misspelt": ("stop_on_psh: {ros__parameters: {}}\n", "did you mean 'stop_on_push'"),
    "parameter misspelt": (SECTION % "circuit: {rowz: 16}", "did you mean 'circuit.rows'"),
    "out of range": (SECTION % "circuit: {rows: 0}", "circuit.rows"),
    "of another type": (SECTION % "circuit: {rows: many}", "circuit.rows"),
}
PARTIAL = ("circuit: {rows: 8, cols: 8}", "curve: {creep: 0.0}", "geometry: {pitch: 0.01}", "")


def by_ros2_run(path, _):
    args = ros.split_arguments(["--ros-args", "-p", f"config:={path}", "-p", "port:=loop://"])[1]
    return Skin(ros.plan_of("skin", args))


def by_ros2_launch(path, folder):
    """launch_ros writes the launch file's parameters into a file of its own."""
    given = folder / "launch_params_x"
    section = {"ros__parameters": {"config": str(path), "port": "loop://"}}
    given.write_text(yaml.safe_dump({"/**": section}))
    args = ros.split_arguments(["--ros-args", "--params-file", str(given)])[1]
    return Skin(ros.plan_of("skin", args))


def by_tactile_skin_launch(path, _):
    words = {"port": "loop://", "config": str(path), "monitor": "false"}
    return Skin(read_plan(launch.find("skin.launch.yaml"), words))


WAYS = (by_ros2_run, by_ros2_launch, by_tactile_skin_launch)


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("way", [*WAYS, read_skin], ids=lambda w: w.__name__)
def test_it_is_refused_by_name(tmp_path, way, case):
    path, (text, said) = tmp_path / "mine.yaml", REFUSED[case]
    if text is not None:
        path.write_text(text)
    with pytest.raises((ValueError, OSError)) as raised:
        read_skin(path) if way is read_skin else way(path, tmp_path).build()
    assert said in str(raised.value)


@pytest.mark.parametrize("values", PARTIAL)
@pytest.mark.parametrize("way", WAYS, ids=lambda w: w.__name__)
def test_what_a_partial_file_leaves_out_is_what_is_safe(tmp_path, way, values):
    """The skin waits, stopped; and of a cover whose shape nobody stated no push has a direction."""
    path = tmp_path / "mine.yaml"
    path.write_text(SECTION % values)
    skin = way(path, tmp_path)
    made = {type(node).__name__: node for node in skin._nodes} if skin.build() else {}
    decision = made["StopOnPush"].policy.decide(0.0)
    assert decision.stop and not made["GestureFeature"].geometry.normal.any()
    for node in made.values():
        getattr(node, "close", lambda: None)()


def test_the_arm_of_the_examples_gives_the_gate_its_frame():
    """MoveIt Servo's section in the same file is for another program."""
    path = launch.share_dir() / "examples" / "robot" / "arm.yaml"
    words = ["--ros-args", "--params-file", str(path), "-p", "port:=loop://"]
    args = ros.split_arguments([*words, "-p", "cmd_vel_gate:=true"])[1]
    skin = Skin(ros.plan_of("skin", args))
    nodes = {type(node).__name__: node for node in skin._nodes} if skin.build() else {}
    assert nodes["GestureFeature"].geometry.normal.any()
    gate = next(node for name, node in nodes.items() if "Gate" in name)
    assert gate._cmd_vel.frame == "base_link"
    for node in nodes.values():
        getattr(node, "close", lambda: None)()


@pytest.mark.parametrize("way", [*WAYS, read_skin], ids=lambda w: w.__name__)
def test_the_file_of_a_body_is_refused_for_one_skin(tmp_path, way):
    """It would run on defaults, and never mention the others."""
    path = tmp_path / "body.yaml"
    path.write_text("skins:\n  chest: {geometry: {shape: plane}}\n  back: {port: /dev/ttyUSB9}\n")
    with pytest.raises(ValueError, match=r"chest, back: is the file of a body"):
        read_skin(path) if way is read_skin else way(path, tmp_path).build()
    assert read_skin(path, "chest/compensation").geometry.normal.any()
