# SPDX-License-Identifier: Apache-2.0
"""A hobby board's lines through a real pty and the real driver: what its maker is told.

docs/boards.md configures this board; its YAML is what is run here.
"""

from __future__ import annotations

import contextlib
import re
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.simulated import PATIENCE, TextBoard, serving

from tactile_skin.launch import launch, read_skin
from tactile_skin.msg import DiagnosticArray, DiagnosticStatus, Image, image_array
from tactile_skin.nodes.stop_on_push import STATUS_TOPIC
from tactile_skin.physics.adc import NOT_READ

pytestmark = pytest.mark.live

PAGE = Path(__file__).parents[2] / "docs" / "boards.md"
LAUNCH = """launch:
- node: {pkg: tactile_skin, exec: serial_driver, param: [{from: $(dirname)/mine.yaml}]}
- node: {pkg: tactile_skin, exec: stop_on_push, param: [{from: $(dirname)/mine.yaml}]}
- node: {pkg: tactile_skin, exec: compensation, param: [{from: $(dirname)/mine.yaml}]}
- node: {pkg: tactile_skin, exec: gesture_feature, param: [{from: $(dirname)/mine.yaml}]}
"""


def example() -> dict:
    """The parameter file of docs/boards.md."""
    (block,) = re.findall(r"```yaml\n(# my_skin.*?)```", PAGE.read_text(), re.DOTALL)
    return yaml.safe_load(block)


class Heard:
    """What a running skin says.

    Attributes:
        stops: each other text of the stop, oldest first.
        levels: node -> (level, message) of its last report.
        frames: of skin/adc.
    """

    def __init__(self):
        self.stops, self.levels, self.frames = [], {}, []
        self.values = {}
        self._news = threading.Condition()

    def on_status(self, message) -> None:
        status = message.status[0]
        with self._news:
            if not self.stops or self.stops[-1] != status.message:
                self.stops.append(status.message)
            self.values = {pair.key: pair.value for pair in status.values}
            self._news.notify_all()

    def on_diagnostics(self, message) -> None:
        with self._news:
            for status in message.status:
                self.levels[status.name] = status.level, status.message
            self._news.notify_all()

    def on_adc(self, message) -> None:
        with self._news:
            self.frames.append(image_array(message))
            self._news.notify_all()

    def wait_for(self, condition) -> None:
        with self._news:
            said = self._news.wait_for(condition, PATIENCE)
            assert said, f"{self.stops[-5:]} {self.levels}"

    def wait_for_stop(self, text: str) -> None:
        self.wait_for(lambda: any(text in stop for stop in self.stops))


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
    (folder / "test.launch.yaml").write_text(LAUNCH)
    heard = Heard()
    with launch(folder / "test.launch.yaml") as skin:
        skin.node.create_subscription(DiagnosticArray, STATUS_TOPIC, heard.on_status, 50)
        skin.node.create_subscription(DiagnosticArray, "skin/diagnostics", heard.on_diagnostics, 50)
        skin.node.create_subscription(Image, "skin/adc", heard.on_adc, 100)
        spinning = threading.Thread(target=skin.spin)
        spinning.start()
        try:
            yield heard
        finally:
            skin.shutdown()
            spinning.join(PATIENCE)


def driver(heard) -> tuple[int, str]:
    return next((v for k, v in heard.levels.items() if "serial_driver" in k), (None, ""))


def test_the_pages_parameters_are_those_of_the_board(tmp_path):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(example()))
    skin = read_skin(tmp_path / "mine.yaml")
    assert skin.circuit == TextBoard.CIRCUIT
    assert skin.adc.ratio(4095.0) == 1.0


def test_its_lines_arrive(tmp_path):
    board = TextBoard(absent=[(4, 11)])
    with serving(tmp_path / "board", board), skin_on(tmp_path / "board", tmp_path) as heard:
        heard.wait_for(lambda: len(heard.frames) > 10)
        assert np.argwhere(heard.frames[-1] == NOT_READ).tolist() == [[4, 11]]
        heard.wait_for(lambda: driver(heard)[1].startswith("no reading at row 4, column 11: "))


def test_a_setting_that_does_not_fit_is_named_in_the_stop(tmp_path):
    """At once, not after the watchdog; and in words that stay the same when the port is reopened.

    The live line prints the reason of the stop as it is.
    """
    wrong = {"serial_driver__protocol": "binary", "serial_driver__watchdog": 1.5}
    with (
        serving(tmp_path / "board", TextBoard()),
        skin_on(tmp_path / "board", tmp_path, **wrong) as heard,
    ):
        heard.wait_for_stop("text arrives")
        assert "at 115200 baud: bytes arrive, but no frame: " in heard.stops[-1]
        told = len(heard.stops)
        time.sleep(1.6)  # the port is reopened meanwhile
        assert heard.stops[told:] == []
        level, message = driver(heard)
        assert level == DiagnosticStatus.ERROR
        assert message in heard.stops[-1]
