"""A launch file starts nodes of other packages: entry points, or classes of a module."""

import pytest

from tactile_skin import ros
from tactile_skin.errors import LaunchError, RosError
from tactile_skin.launch import launch, read_plan
from tactile_skin.msg import Bool

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

    yield write


@pytest.fixture
def installed(tmp_path, write):
    """The distribution Robot-Lamps, whose node `lamp` is skin_lamps.Lamp."""
    info = tmp_path / "robot_lamps-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: Robot-Lamps\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[tactile_skin.nodes]\nlamp = skin_lamps:Lamp\n")


def runs(path) -> None:
    seen = []
    with launch(path) as skin:
        skin.node.create_subscription(Bool, "left/lamp", seen.append, 10)
        for _ in range(200):
            if seen:
                break
            skin.spin(0.05)
    assert seen[0] == Bool(False)


def test_a_class_of_a_module(write):
    runs(write("skin_lamps", "Lamp"))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("package", ["robot_lamps", "Robot-Lamps", "skin_lamps"])
def test_an_entry_point_of_an_installed_package(write, package):
    """Its package is named as it is installed, or as it is imported."""
    runs(write(package, "lamp"))


def refused(path) -> str:
    with pytest.raises(LaunchError) as error, launch(path):
        pass
    assert str(error.value).startswith(f"{path}: node ")
    return str(error.value)


@pytest.mark.usefixtures("installed")
def test_a_package_that_is_not_there(write):
    message = refused(write("no_such_package", "lamp"))
    assert "no_such_package/lamp: pkg: no installed package of this name" in message
    assert (
        "tactile_skin.nodes (there are: Robot-Lamps)" in message and "no Python module" in message
    )


@pytest.mark.parametrize("package", ["..", "a b", "no_such.module", "skin_lamps.none"])
def test_a_package_that_cannot_be_one(write, package):
    assert "pkg: " in refused(write(package, "lamp"))


@pytest.mark.usefixtures("installed")
def test_an_entry_point_that_the_package_does_not_have(write):
    assert "exec: robot_lamps has no node of this name; there are: lamp" in refused(
        write("robot_lamps", "lmap")
    )


@pytest.mark.parametrize("name", ["Lmap", "lamp"])
def test_a_class_that_the_module_does_not_have(write, name):
    assert f"exec: skin_lamps has no class {name!r}; there are: Lamp" in refused(
        write("skin_lamps", name)
    )


def test_a_module_that_cannot_be_imported(write):
    message = refused(write("skin_broken", "Lamp"))
    assert "importing skin_broken failed: No module named 'no_such_module_at_all'" in message


def test_an_unknown_parameter_of_it_is_refused(write):
    path = write("skin_lamps", "Lamp")
    path.write_text(path.read_text().replace("name: lit", "name: unlit"))
    with (
        pytest.raises(LaunchError, match=r"parameter 'unlit' is unknown; did you mean 'lit'"),
        launch(path),
    ):
        pass


def test_processes_on_ros_refuse_it(write):
    plan = read_plan(write("skin_lamps", "Lamp"), {})
    with pytest.raises(RosError, match=r"mine\.launch\.yaml: node skin_lamps/Lamp: --ros starts"):
        ros.launch_processes(plan)
