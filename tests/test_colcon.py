# SPDX-License-Identifier: Apache-2.0
"""The package as colcon builds and installs it, and its manifest.

These tests skip where colcon or ament_xmllint is missing; `--require-ros` makes that a failure.
"""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_docs import KINDS

from tactile_skin.launch import share_dir
from tactile_skin.middleware.package import COMPOSED, NODES

pytestmark = pytest.mark.ros

SOURCE = share_dir()
PROGRAMS = {*NODES, COMPOSED, "tactile-skin"}
XMLLINT = "/usr/bin/ament_xmllint"  # Debian's brings the schema along; others fetch it


def run(*words, cwd, **env) -> subprocess.CompletedProcess:
    done = subprocess.run(
        [str(w) for w in words],
        cwd=cwd,
        env=os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"} | env,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done


def need(request, there, what: str) -> None:
    if not there:
        if request.config.getoption("--require-ros"):
            pytest.fail(f"{what} is not installed")
        pytest.skip(f"{what} is not installed: see .ci/run")


@pytest.fixture(scope="module")
def workspace(request, tmp_path_factory):
    """With a copy of the source tree: its folder, and a function that builds with given options."""
    colcon = shutil.which("colcon", path=str(Path(sys.executable).parent))
    need(request, colcon, "colcon")
    workspace = tmp_path_factory.mktemp("workspace")
    skip = shutil.ignore_patterns(".*", "build", "install", "log", "*.egg-info", "__pycache__")
    shutil.copytree(SOURCE, workspace / "src" / "tactile_skin", ignore=skip)
    return workspace, lambda *options: run(colcon, "build", *options, cwd=workspace)


@pytest.fixture(scope="module")
def prefix(workspace):
    """The installation, share and lib."""
    folder, build = workspace
    build()
    return folder / "install" / "tactile_skin"


@pytest.mark.ci
def test_what_ros_2_looks_for_is_where_it_looks(prefix):
    """`ros2 run`, `ros2 launch` and `find-pkg-share`."""
    programs = {p.name for p in (prefix / "lib" / "tactile_skin").iterdir()}
    assert programs == PROGRAMS
    assert all(os.access(prefix / "lib" / "tactile_skin" / p, os.X_OK) for p in programs)
    share = prefix / "share" / "tactile_skin"
    for folder in ("launch", "config", "examples", "examples/robot"):
        names = {p.name for p in (SOURCE / folder).glob("[!_]*")}
        assert {p.name for p in (share / folder).iterdir()} == names
        assert names
    assert (share / "package.xml").read_bytes() == (SOURCE / "package.xml").read_bytes()
    index = prefix / "share" / "ament_index" / "resource_index" / "packages" / "tactile_skin"
    assert index.is_file()


@pytest.mark.ci
def test_links_instead_of_copies(workspace):
    """`--symlink-install` sets up the same from a folder with no more than it links."""
    folder, build = workspace
    build("--symlink-install", "--install-base", "linked", "--build-base", "links")
    prefix = folder / "linked" / "tactile_skin"
    assert {p.name for p in (prefix / "lib" / "tactile_skin").iterdir()} == PROGRAMS
    assert (prefix / "share" / "tactile_skin" / "launch" / "skin.launch.yaml").is_symlink()


@pytest.mark.ci
def test_the_installed_programs_run(prefix, tmp_path):
    """From the installation alone: nodes, launch files, parameters, weights."""
    (site,) = prefix.glob("lib/python3*/site-packages")
    for name in NODES:
        done = run(prefix / "lib/tactile_skin" / name, "--help", cwd=tmp_path, PYTHONPATH=str(site))
        assert f"usage: {name}" in done.stdout
    words = ["launch", "duration:=1"]
    program = prefix / "lib" / "tactile_skin" / "tactile-skin"
    done = run(program, *words, cwd=tmp_path, PYTHONPATH=str(site))
    assert "summary" in done.stdout
    code = (
        "import tactile_skin, tactile_skin.launch as l; print(tactile_skin.__file__, l.share_dir())"
    )
    done = run(sys.executable, "-c", code, cwd=tmp_path, PYTHONPATH=str(site))
    assert done.stdout.split() == [
        str(site / "tactile_skin" / "__init__.py"),
        str(prefix / "share" / "tactile_skin"),
    ]


def catkin_pkg(request, name: str):
    """A module of catkin_pkg."""
    try:
        return importlib.import_module(f"catkin_pkg.{name}")
    except ImportError:
        need(request, False, "catkin_pkg")


def test_bloom_can_read_the_changelog(request):
    changelog = catkin_pkg(request, "changelog").get_changelog_from_path(SOURCE / "CHANGELOG.rst")
    versions = [version for version, _, _ in changelog.foreach_version()]
    assert versions == ["0.1.0", "0.2.0"]
    said = {str(part) for part in changelog.get_content_of_version("0.2.0")}
    assert said >= KINDS


def test_the_manifest_is_accepted_by_catkin_pkg(request):
    parse_package = catkin_pkg(request, "package").parse_package
    warnings = []
    package = parse_package(str(SOURCE / "package.xml"), warnings=warnings)
    assert warnings == []
    assert package.name == "tactile_skin"
    assert package.get_build_type() == "ament_python"
    named = {d.name for d in package.exec_depends}
    assert {"rclpy", "sensor_msgs", "ros2launch"} <= named


def test_the_manifest_is_accepted_by_ament_xmllint(request, tmp_path):
    need(request, Path(XMLLINT).exists(), "ament_xmllint")
    assert "No problems found" in run(XMLLINT, SOURCE / "package.xml", cwd=tmp_path).stdout
    wrong = (SOURCE / "package.xml").read_text().replace("<license", "<licence", 1)
    (tmp_path / "package.xml").write_text(wrong.replace("</license>", "</licence>", 1))
    with pytest.raises(AssertionError, match="licence"):
        run(XMLLINT, tmp_path / "package.xml", cwd=tmp_path)


def test_the_manifest_names_the_packages_that_the_code_uses():
    """Every ROS package that a message comes from."""
    from tactile_skin import msg

    text = (SOURCE / "package.xml").read_text()
    packages = {c.TYPE.split("/")[0] for c in vars(msg).values() if hasattr(c, "TYPE")}
    for name in packages:
        assert f"<exec_depend>{name}</exec_depend>" in text
