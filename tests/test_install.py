# SPDX-License-Identifier: Apache-2.0
"""What a user gets: the wheel, its metadata, and package.xml. `.ci/run` installs the wheel."""

import configparser
import email
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import tactile_skin
from tactile_skin.cli import main
from tactile_skin.launch import share_dir

SOURCE = share_dir()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of a copy of the source tree, built without a compiler."""
    pytest.importorskip("setuptools", "70.1", reason="builds the wheel")
    if not (SOURCE / "setup.py").exists():
        pytest.skip("no source tree")
    folder = tmp_path_factory.mktemp("wheel")
    skip = shutil.ignore_patterns(".*", "build", "install", "log", "*.egg-info", "*.so", "docs")
    shutil.copytree(SOURCE, folder / "source", ignore=skip)
    code = f"from setuptools import build_meta; build_meta.build_wheel({str(folder)!r})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder / "source",
        env=os.environ | {"CC": "false"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = folder.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name).decode("utf-8", "ignore") for name in archive.namelist()}


def the(wheel, name: str) -> str:
    """The one file of the wheel whose path ends so."""
    (found,) = [text for path, text in wheel.items() if path.endswith(name)]
    return found


def test_the_wheel_says_what_it_is_and_what_it_needs(wheel):
    data = email.message_from_string(the(wheel, ".dist-info/METADATA"))
    assert data["Version"] == tactile_skin.__version__
    assert data["Requires-Python"] == ">=3.10"
    assert data["Description-Content-Type"] == "text/markdown"
    readme = (SOURCE / "README.md").read_text(encoding="utf-8")
    assert the(wheel, ".dist-info/METADATA").endswith(readme)
    needs = [line for line in data.get_all("Requires-Dist") if "extra ==" not in line]
    assert {re.match(r"\w+", line)[0] for line in needs} == {
        "numpy",
        "scipy",
        "pyserial",
        "pyyaml",
        "ruamel",
        "threadpoolctl",
    }
    assert {"train", "charts", "test"} <= set(data.get_all("Provides-Extra"))


def test_pip_puts_one_command_on_the_path(wheel):
    """A program named `monitor`, say, would stand in a user's way."""
    points = configparser.ConfigParser()
    points.read_string(the(wheel, "entry_points.txt"))
    assert points.sections() == ["console_scripts"]
    assert dict(points["console_scripts"]) == {"tactile-skin": "tactile_skin.__main__:main"}
    assert not [name for name in wheel if ".data/scripts/" in name]


def test_the_wheel_holds_what_the_skin_reads(wheel):
    assert "tactile_skin/py.typed" in wheel
    for path in [*SOURCE.glob("tactile_skin/**/*.py"), *SOURCE.glob("tactile_skin/weights/*")]:
        assert str(path.relative_to(SOURCE)) in wheel
    shared = {Path(name).name for name in wheel if "/share/tactile_skin/" in name}
    folders = "launch", "config", "examples", "examples/robot"
    assert shared == {"package.xml", *(p.name for f in folders for p in SOURCE.glob(f"{f}/*.*"))}
    assert not [name for name in wheel if name.startswith("tests")]


def test_the_version_is_told_and_package_xml_repeats_it(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"tactile-skin {tactile_skin.__version__}\n"
    text = (SOURCE / "package.xml").read_text()
    assert f"<version>{tactile_skin.__version__}</version>" in text


def test_without_pytorch_the_extra_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.chdir(tmp_path)
    assert main(["train", "--out", "weights"]) == 2
    line = "tactile-skin train: error: needs PyTorch: pip install 'tactile_skin[train]'\n"
    assert capsys.readouterr().err == line
    assert list(tmp_path.iterdir()) == []


def test_a_robot_imports_nothing_of_what_learning_needs():
    """Not even with the modules that use it; `install_requires` is tested above."""
    ours = ("launch", "opened", "cli", "commands.replay", "recording.lerobot", "simulation.mujoco")
    code = "import sys; " + "; ".join(f"import tactile_skin.{name}" for name in ours)
    code += "; print({'lerobot', 'mujoco', 'pyarrow', 'pandas', 'torch'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=SOURCE, capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr
