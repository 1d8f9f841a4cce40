# SPDX-License-Identifier: Apache-2.0
"""A launch file starts nodes of other packages: classes of a module."""

import pytest
from support.patience import spin_until

from tactile_skin.errors import LaunchError
from tactile_skin.launch import launch
from tactile_skin.msg import Bool

pytestmark = pytest.mark.live

CODE = """
from tactile_skin.msg import Bool

class Lamp:
    def __init__(self, node):
        on = node.declare_parameter("lit", True).value
        publisher = node.create_publisher(Bool, "lamp", 10)
        node.create_timer(0.01, lambda: publisher.publish(Bool(on)))

def lamp(node):
    pass
"""
NODE = "launch:\n- node: {pkg: %s, exec: %s, namespace: left, param: [{name: lit, value: false}]}\n"


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Makes the modules skin_lamps and skin_broken; returns a writer of launch files."""
    (tmp_path / "skin_lamps.py").write_text(CODE)
    (tmp_path / "skin_broken.py").write_text("import no_such_module_at_all\n")
    monkeypatch.syspath_prepend(tmp_path)

    def write(package, executable):
        path = tmp_path / "mine.launch.yaml"
        path.write_text(NODE % (package, executable))
        return path

    return write


def test_a_class_of_a_module(write):
    seen = []
    with launch(write("skin_lamps", "Lamp")) as skin:
        skin.node.create_subscription(Bool, "left/lamp", seen.append, 10)
        spin_until(skin, lambda: seen)
    assert seen[0] == Bool(False)


@pytest.mark.parametrize(
    ("package", "executable", "named"),
    [
        ("no_such.module", "Lamp", "pkg: must be tactile_skin or a Python module: importing"),
        ("..", "Lamp", "importing .. failed"),
        ("skin_broken", "Lamp", "failed: No module named 'no_such_module_at_all'"),
        ("skin_lamps", "lamp", "exec: skin_lamps has no class 'lamp'; there are: Lamp"),
    ],
)
def test_what_is_no_node_is_refused_by_name(write, package, executable, named):
    path = write(package, executable)
    with pytest.raises(LaunchError) as error, launch(path):
        pass
    assert str(error.value).startswith(f"{path}: node {package}/{executable}: ")
    assert named in str(error.value)


def test_an_unknown_parameter_of_it_is_refused(write):
    path = write("skin_lamps", "Lamp")
    path.write_text(path.read_text().replace("name: lit", "name: unlit"))
    with (
        pytest.raises(LaunchError, match=r"parameter 'unlit' is unknown; did you mean 'lit'"),
        launch(path),
    ):
        pass
