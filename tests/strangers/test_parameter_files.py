# SPDX-License-Identifier: Apache-2.0
"""Parameter files that are absent, partial, misspelt or foreign, in each way of starting.

None ends in a free robot, nor in a skin with other numbers than the file's and the documented
defaults.
"""

import pytest
import yaml

from tactile_skin import ros
from tactile_skin.launch import Skin, find, read_plan, read_skin, share_dir
from tactile_skin.middleware.ros.arguments import split_arguments

DOCUMENTED = yaml.safe_load((share_dir() / "config" / "skin.yaml").read_text())
PORT = "loop://"  # opens without a board
GIVEN = ("port", "wait_for_port", "use_sim_time")  # by how it is started, not by the file


def nodes(**sections) -> str:
    """Return a parameter file: node -> parameters, a name of `all` for all nodes."""
    named = {"all": "/**"}
    return yaml.safe_dump(
        {named.get(k, f"/**/{k}"): {"ros__parameters": v} for k, v in sections.items()}
    )


REFUSED = {  # what the file holds, and what the error names
    "empty": ("", "is empty"),
    "a number": ("8\n", "must map node names"),
    "a list": ("- threshold: 30.0\n", "must map node names"),
    "no YAML": ("/**: {ros__parameters: [\n", "YAML"),
    "an INI file": ("[circuit]\nrows = 8\n", "not valid YAML"),
    "without node": ("circuit: {rows: 8, cols: 8}\n", "ros__parameters"),
    "without ros__parameters": ("/**/compensation: {method: naive}\n", "ros__parameters"),
    "ros_parameters": ("/**: {ros_parameters: {circuit: {rows: 8}}}\n", "ros__parameters"),
    "a key twice": ("/**: {ros__parameters: {circuit: {rows: 8, rows: 9}}}\n", "rows"),
    "of nav2": (nodes(controller_server={"controller_frequency": 20.0}), "controller_server"),
    "of all nodes of another": (nodes(all={"robot_radius": 0.3}), "robot_radius"),
    "of two packages": (nodes(compensation={"method": "map"}, amcl={"alpha1": 0.2}), "amcl"),
    "node misspelt": (nodes(stop_on_psh={"threshold": 20.0}), "stop_on_push"),
    "row for rows": (nodes(all={"circuit": {"row": 8, "cols": 8}}), "circuit.rows"),
    "rref": (nodes(all={"circuit": {"rref": 10e3}}), "circuit.r_ref"),
    "of another node": (nodes(serial_driver={"peak": 9.0}), "peak"),
    "circuit written flat": (nodes(all={"rows": 8}), "circuit.rows"),
    "a word for a number": (nodes(all={"circuit": {"rows": "eight"}}), "circuit.rows"),
    "out of range": (nodes(all={"circuit": {"rows": 0}}), "circuit.rows"),
    "a list for a number": (nodes(all={"circuit": {"rows": [8]}}), "circuit.rows"),
    "an unknown shape": (nodes(all={"geometry": {"shape": "cylindre"}}), "cylinder"),
    "a radius that is too small": (
        nodes(all={"geometry": {"shape": "cylinder", "radius": 0.01}}),
        "do not fit around",
    ),
    "an unknown method": (nodes(compensation={"method": "magic"}), "method"),
}
TAKEN = {
    "cells only": nodes(all={"circuit": {"rows": 8, "cols": 9}}),
    "one number": nodes(all={"circuit": {"r_ref": 10e3}}),
    "pitch without shape": nodes(all={"geometry": {"pitch": 0.01}}),
    "a shape": nodes(all={"geometry": {"shape": "plane"}}),
    "the stop only": nodes(stop_on_push={"threshold": 20.0, "release": 5.0, "peak": 4.0}),
    "the method only": nodes(compensation={"method": "map"}),
    "the link only": nodes(serial_driver={"protocol": "text", "baud": 115200}),
    "without stars": yaml.safe_dump({"stop_on_push": {"ros__parameters": {"threshold": 20.0}}}),
    "all of it": (share_dir() / "config" / "skin.yaml").read_text(),
}


def launched(path):
    """As `tactile-skin launch` and `launch()`: all nodes in this process."""
    given = {"config": str(path), "port": PORT, "monitor": "false"}
    return Skin(read_plan(find("skin.launch.yaml"), given))


def of_program(words):
    return Skin(ros.plan_of("skin", split_arguments(["--ros-args", *words])[1]))


def built(start, path):
    """What it starts, or reads, of a file."""
    return read_skin(path) if start is read_skin else start(path).build()


def by_ros2_launch(path):
    """As `ros2 launch`, which writes a file of what the launch file gives a program."""
    written = path.parent / "launch_params_x"
    given = {"config": str(path), "serial_driver": True, "port": PORT}
    written.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    return of_program(["--params-file", str(written)])


def by_ros2_run(path):
    return of_program(["--params-file", str(path), "-p", f"serial_driver:port:={PORT}"])


def by_parameter(path):
    return of_program(["-p", f"config:='{path}'", "-p", f"serial_driver:port:={PORT}"])


WAYS = (launched, by_ros2_launch, by_ros2_run, by_parameter)
OF_COMMANDS = (*WAYS, read_skin)  # doctor, calibrate and replay read circuit, curve and geometry
# What a file that also serves others may hold: ROS hands one to all nodes of a robot.
ROS_ALLOWS = ("of all nodes of another", "of two packages")
OF_NODES = ("circuit written flat", "an unknown method")
PASSED_OVER = {by_ros2_run: ROS_ALLOWS, read_skin: (*ROS_ALLOWS, *OF_NODES)}


def write(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("way", OF_COMMANDS)
def test_a_file_that_is_absent_is_an_error(way, tmp_path):
    for name in ("typo.yaml", "none/mine.yaml", ""):
        with pytest.raises((ValueError, OSError), match=r"typo|none|is a folder"):
            built(way, tmp_path / name)


@pytest.mark.parametrize("way", OF_COMMANDS)
@pytest.mark.parametrize("case", REFUSED)
def test_a_file_that_is_wrong_is_an_error(case, way, tmp_path):
    text, named = REFUSED[case]
    if case in PASSED_OVER.get(way, ()):
        pytest.skip("what is not for this one is not looked at")
    with pytest.raises((ValueError, OSError)) as error:
        built(way, write(tmp_path, text))
    assert named in str(error.value)


@pytest.mark.parametrize("way", WAYS)
def test_a_section_of_the_program_is_for_each_node_that_it_runs(way, tmp_path):
    shared = {"circuit": {"rows": 8, "cols": 8}}
    path = write(tmp_path, nodes(all=shared, skin={"monitor": True, "threshold": 25.0}))
    made = {handle.get_name(): handle for handle in built(way, path)}
    assert made["stop_on_push"].get_parameter("threshold").value == 25.0
    assert ("monitor" in made) is (way is not launched), "what is given wins over the file"
    misspelt = write(tmp_path, nodes(skin={"thresold": 25.0}))
    with pytest.raises(ValueError, match=r"there are: .*threshold"):
        built(way, misspelt)


def documented(node: str) -> dict:
    """Return name -> value of config/skin.yaml for a node, `a.b` for nested ones."""
    values: dict = {}

    def flatten(data: dict, before: str) -> None:
        for key, value in data.items():
            if isinstance(value, dict):
                flatten(value, f"{before}{key}.")
            else:
                values[before + key] = value

    for section in node_sections(DOCUMENTED, node):
        flatten(section, "")
    return values


def node_sections(data: dict, node: str):
    for name, section in data.items():
        if name.rsplit("/", 1)[-1] in ("**", node):
            yield section["ros__parameters"]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("case", TAKEN)
def test_what_a_file_leaves_out_is_as_documented(case, way, tmp_path):
    handles = built(way, write(tmp_path, TAKEN[case]))
    given = yaml.safe_load(TAKEN[case])
    assert {handle.get_name() for handle in handles} >= {"compensation", "stop_on_push"}
    for handle in handles:
        expected = documented(handle.get_name())
        for section in node_sections(given, handle.get_name()):
            for key, value in section.items():
                more = (
                    {f"{key}.{k}": v for k, v in value.items()} if isinstance(value, dict) else {}
                )
                expected |= more or {key: value}
        names = handle.parameter_names()
        assert set(names) - set(GIVEN) <= set(expected)
        for name in set(names) - set(GIVEN):
            assert handle.get_parameter(name).value == expected[name], name


def started(skin) -> dict:
    """Class -> node of a skin that is built, and closed again."""
    made = {type(node).__name__: node for node in skin._nodes} if skin.build() else {}
    for node in made.values():
        getattr(node, "close", lambda: None)()
    return made


@pytest.mark.parametrize("case", ["cells only", "pitch without shape"])
@pytest.mark.parametrize("way", WAYS)
def test_what_a_partial_file_leaves_out_is_what_is_safe(case, way, tmp_path):
    """The skin waits, stopped; and of a cover whose shape nobody stated no push has a direction."""
    made = started(way(write(tmp_path, TAKEN[case])))
    assert made["StopOnPush"].policy.decide(0.0).stop
    assert not made["GestureFeature"].geometry.normal.any()


def test_the_arm_of_the_examples_gives_the_gate_its_frame():
    """MoveIt Servo's section in the same file is for another program."""
    path = str(share_dir() / "examples" / "robot" / "arm.yaml")
    words = ["--params-file", path, "-p", f"port:={PORT}", "-p", "cmd_vel_gate:=true"]
    made = started(of_program(words))
    assert made["GestureFeature"].geometry.normal.any()
    assert next(node for name, node in made.items() if "Gate" in name)._cmd_vel.frame == "base_link"


@pytest.mark.parametrize("way", OF_COMMANDS)
def test_the_file_of_a_body_is_refused_for_one_skin(way, tmp_path):
    """It would run on defaults, and never mention the others."""
    skins = {"chest": {"geometry": {"shape": "plane"}}, "back": {"port": "/dev/ttyUSB9"}}
    path = write(tmp_path, yaml.safe_dump({"skins": skins}, sort_keys=False))
    with pytest.raises(ValueError, match=r"chest, back: is the file of a body"):
        built(way, path)
    assert read_skin(path, "chest/compensation").geometry.normal.any()
