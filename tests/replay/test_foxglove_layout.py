# SPDX-License-Identifier: Apache-2.0
"""The layout that ships for Foxglove: its panels show what a recording holds."""

import json
import re
from pathlib import Path

import pytest
from test_replay import write

from tactile_skin.msg import Image, PointCloud2
from tactile_skin.recording import Recording
from tactile_skin.replay.replay import Replay

pytest.importorskip("mcap")
LAYOUT = json.loads(
    (Path(__file__).parents[2] / "config" / "foxglove_layout.json").read_text(encoding="utf-8")
)
PANELS = LAYOUT["configById"]
STEP = re.compile(r"\.(\w+)|\[(\d+)\]")


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Topic -> the last message of a recording of a push."""
    folder = tmp_path_factory.mktemp("layout")
    replay = Replay(Recording(write(folder / "a.mcap", 4.0)))
    replay.record(folder / "b.mcap")
    list(replay)
    return {topic: message for topic, _, message in Recording(folder / "b.mcap").messages()}


def panels(kind):
    return [config for name, config in PANELS.items() if name.split("!")[0] == kind]


def test_every_panel_has_its_place():
    def placed(part):
        return [part] if isinstance(part, str) else placed(part["first"]) + placed(part["second"])

    assert sorted(placed(LAYOUT["layout"])) == sorted(PANELS)


def test_pictures_and_points_are_of_recorded_topics(messages):
    assert {type(messages[c["imageMode"]["imageTopic"]]) for c in panels("Image")} == {Image}
    (scene,) = panels("3D")
    for topic, settings in scene["topics"].items():
        message = messages[topic]
        assert isinstance(message, PointCloud2) and settings["visible"]
        assert settings["colorField"] in [field.name for field in message.fields]
        assert message.header.frame_id == scene["followTf"]
    (summary,) = panels("DiagnosticSummary")
    assert summary["topicToRender"] in messages


@pytest.mark.parametrize(
    ("kind", "types"), [("Plot", (int, float)), ("StateTransitions", (bool, str))]
)
def test_paths_lead_to_values_of_recorded_messages(messages, kind, types):
    (panel,) = panels(kind)
    assert panel["paths"] and all(path["enabled"] for path in panel["paths"])
    for path in panel["paths"]:
        topic, rest = re.fullmatch(r"(/[\w/]+)(.*)", path["value"]).groups()
        value = messages[topic]
        for name, index in STEP.findall(rest):
            value = getattr(value, name) if name else value[int(index)]
        assert isinstance(value, types)
