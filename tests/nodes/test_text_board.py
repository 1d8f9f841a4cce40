# SPDX-License-Identifier: Apache-2.0
"""A hobby board's lines through a real pty and the real driver: what its maker is told.

docs/boards.md configures this board; its YAML is what is run here.
"""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.patience import spin_until
from support.simulated import TextBoard, serving
from support.told import Told

from tactile_skin.launch import launch, read_skin
from tactile_skin.msg import DiagnosticArray, DiagnosticStatus, Image, image_array
from tactile_skin.physics.adc import NOT_READ

pytestmark = pytest.mark.live

PAGE = Path(__file__).parents[2] / "docs" / "boards.md"


def example() -> dict:
    """The parameter file of docs/boards.md."""
    (block,) = re.findall(r"```yaml\n(# my_skin.*?)```", PAGE.read_text(), re.DOTALL)
    return yaml.safe_load(block)


@contextlib.contextmanager
def skin_on(port, folder, **changes):
    """A skin with the page's parameters, some changed, on a port."""
    given = example()
    given.setdefault("serial_driver", {"ros__parameters": {}})
    given["serial_driver"]["ros__parameters"]["port"] = str(port)
    for name, value in changes.items():
        section, key = name.split("__")
        if section == "circuit":
            given["/**"]["ros__parameters"]["circuit"][key] = value
        else:
            given.setdefault(section, {"ros__parameters": {}})["ros__parameters"][key] = value
    (folder / "mine.yaml").write_text(yaml.safe_dump(given))
    with launch("skin.launch.yaml", config=folder / "mine.yaml", monitor=False) as skin:
        yield skin


def driver_of(skin) -> list[DiagnosticStatus]:
    """What serial_driver will have reported."""
    said = []

    def note(message):
        said.extend(s for s in message.status if "serial_driver" in s.name)

    skin.node.create_subscription(DiagnosticArray, "skin/diagnostics", note, 50)
    return said


def test_the_pages_parameters_are_those_of_the_board(tmp_path):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(example()))
    skin = read_skin(tmp_path / "mine.yaml")
    assert skin.circuit == TextBoard.CIRCUIT
    assert skin.adc.ratio(4095.0) == 1.0


def test_its_lines_arrive(tmp_path):
    board = TextBoard(absent=[(4, 11)])
    with serving(tmp_path / "board", board), skin_on(tmp_path / "board", tmp_path) as skin:
        driver, frames = driver_of(skin), []
        skin.node.create_subscription(Image, "skin/adc", frames.append, 100)
        spin_until(skin, lambda: len(frames) > 10)
        assert np.argwhere(image_array(frames[-1]) == NOT_READ).tolist() == [[4, 11]]
        said = "no reading at row 4, column 11: "
        spin_until(skin, lambda: driver and driver[-1].message.startswith(said))


def test_a_setting_that_does_not_fit_is_named_in_the_stop(tmp_path):
    """At once, not after the watchdog; and in words that stay the same when the port is reopened.

    The live line prints the reason of the stop as it is.
    """
    wrong = {"serial_driver__protocol": "binary", "serial_driver__watchdog": 1.5}
    with (
        serving(tmp_path / "board", TextBoard()),
        skin_on(tmp_path / "board", tmp_path, **wrong) as skin,
    ):
        driver, told = driver_of(skin), Told()
        skin.on_stop(told)
        told.wait_for_reason("text arrives")
        reason = told.calls[-1][1]
        assert "at 115200 baud: bytes arrive, but no frame: " in reason
        told.calls.clear()
        skin.spin(1.6)  # the port is reopened meanwhile
        assert told.calls == []
        assert driver[-1].level == DiagnosticStatus.ERROR
        assert driver[-1].message in reason
