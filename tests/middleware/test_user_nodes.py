# SPDX-License-Identifier: Apache-2.0
"""Nodes of a user's in the process of a skin: classes, by a program or by a parameter file."""

import pytest
import yaml
from support.patience import spin_until

from tactile_skin import ros
from tactile_skin.errors import FileError, LaunchError
from tactile_skin.launch import launch
from tactile_skin.middleware.ros.arguments import split_arguments
from tactile_skin.msg import Bool

pytestmark = pytest.mark.live

CODE = """
from tactile_skin.middleware.ros.arguments import split_arguments
from tactile_skin.msg import Bool

class Lamp:
    def __init__(self, node):
        on = node.declare_parameter("lit", True).value
        publisher = node.create_publisher(Bool, "lamp", 10)
        node.create_timer(0.01, lambda: publisher.publish(Bool(on)))

def lamp(node):
    pass
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Makes the modules skin_lamps and skin_broken; returns a writer of parameter files."""
    (tmp_path / "skin_lamps.py").write_text(CODE)
    (tmp_path / "skin_broken.py").write_text("import no_such_module_at_all\n")
    monkeypatch.syspath_prepend(tmp_path)

    def write(**node):
        path = tmp_path / "mine.yaml"
        text = yaml.safe_dump({"nodes": [node]})
        path.write_text(text + "/**: {ros__parameters: {}}\n")
        return path

    return write


def started(config):
    return launch("skin.launch.yaml", port="loop://", monitor=False, config=config)


def test_a_class_that_a_parameter_file_names(write):
    """With its parameters there, a namespace and a remapping."""
    seen = []
    more = {"namespace": "left", "parameters": {"lit": False}, "remap": {"lamp": "light"}}
    with started(write(**{"class": "skin_lamps.Lamp"} | more)) as skin:
        skin.node.create_subscription(Bool, "left/light", seen.append, 10)
        spin_until(skin, lambda: seen)
    assert seen[0] == Bool(False)


def test_a_section_of_its_name_is_for_it(write):
    path = write(**{"class": "skin_lamps.Lamp"})
    path.write_text(path.read_text().replace("/**:", "Lamp: {ros__parameters: {lit: false}}\n/**:"))
    skin = started(path)
    skin.build()
    assert skin._handles[-1].get_parameter("lit").value is False


class Bell:
    """Rings once for each contact; in no module of its own."""

    def __init__(self, node):
        self.loud = node.declare_parameter("loud", 1.0).value


def test_a_class_that_a_program_adds():
    skin = launch("skin.launch.yaml", port="loop://", monitor=False)
    skin.add(Bell, {"loud": 3.0}, name="bell")
    with skin:
        assert skin._nodes[-1].loud == 3.0
        with pytest.raises(LaunchError, match="the nodes run already: add it before `with`"):
            skin.add(Bell)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ("no_such.module.Lamp", r"importing 'no_such.module' failed"),
        ("...Lamp", "importing '..' failed"),
        ("skin_broken.Lamp", "failed: No module named 'no_such_module_at_all'"),
        ("skin_lamps.lamp", "skin_lamps has no class 'lamp'; there are: Lamp"),
        ("Lamp", "node Lamp: must be module.Class or one of serial_driver"),
    ],
)
def test_what_is_no_node_is_refused_by_name(write, named, message):
    path = write(**{"class": named})
    with pytest.raises(LaunchError) as error:
        started(path).build()
    assert str(error.value).startswith(f"{path}: node {named}: ")
    assert message in str(error.value)


@pytest.mark.parametrize("wrong", ["[{}]", "[{class: 5}]", "[{class: a.B, pkg: a}]", "5"])
def test_a_list_of_nodes_that_is_none_is_refused(tmp_path, wrong):
    (tmp_path / "mine.yaml").write_text(f"nodes: {wrong}\n")
    with pytest.raises(FileError, match=r"mine.yaml: nodes.*must be .*(class|list of maps)"):
        started(tmp_path / "mine.yaml")


def test_an_unknown_parameter_of_it_is_refused(write):
    with pytest.raises(LaunchError, match=r"parameter 'unlit' is unknown; there are: lit"):
        started(write(**{"class": "skin_lamps.Lamp", "parameters": {"unlit": False}})).build()


def test_on_ros_a_file_with_such_nodes_is_refused(write):
    path = write(**{"class": "skin_lamps.Lamp"})
    words = split_arguments(["--ros-args", "-p", f"config:={path}"])[1]
    with pytest.raises(LaunchError, match=r"skin_lamps.Lamp: is for tactile-skin launch; on ROS"):
        ros.plan_of("skin", words)
