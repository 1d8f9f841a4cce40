# SPDX-License-Identifier: Apache-2.0
"""The recorder on a running skin: everything is in the file, and replay gives it again."""

import contextlib
import errno
import os
import resource
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml
from support.patience import until
from support.simulated import CIRCUIT, make_board, serving

from tactile_skin import PressureCurve
from tactile_skin.errors import FileError
from tactile_skin.launch import launch
from tactile_skin.msg import DiagnosticArray, DiagnosticStatus, Image
from tactile_skin.recording import Recording, writer
from tactile_skin.replay.replay import Replay
from tactile_skin.simulation import scenes, simulator

pytestmark = pytest.mark.live

pytest.importorskip("mcap")
SHARED = {"circuit": {"rows": CIRCUIT.rows, "cols": CIRCUIT.cols}}


@pytest.fixture
def config(tmp_path):
    """A function that writes a parameter file, with parameters of the recorder."""

    def write(**recorder):
        path = tmp_path / "skin.yaml"
        sections = {"/**": SHARED, "recorder": recorder}
        text = {name: {"ros__parameters": values} for name, values in sections.items()}
        path.write_text(yaml.safe_dump(text))
        return path

    return write


def ended(path):
    """The recording at a path, once it is whole: a busy disk ends it after the skin."""

    def whole():
        with contextlib.suppress(FileError):  # nothing of it is on the disk yet
            return not Recording(path).damage

    until(whole)
    return Recording(path)


def run(tmp_path, config, record, enough, board=None):
    """A skin on a simulated board, until a condition of (received images, skin) holds."""
    heard = {"skin/adc": [], "skin/pressure": []}
    link = tmp_path / "port"
    given = {"port": link, "config": config, "monitor": False, "record": record}
    with (
        serving(link, board or make_board("one_finger")),
        launch("skin.launch.yaml", **given) as skin,
    ):
        for topic, into in heard.items():
            skin.node.create_subscription(Image, topic, into.append, 1000)
        until(lambda: enough(heard, skin))
    return heard


def test_all_that_was_published_is_read_back_and_replay_gives_the_same_pressure(tmp_path, config):
    path = tmp_path / "a.mcap"
    heard = run(tmp_path, config(), path, lambda h, _: len(h["skin/pressure"]) >= 150)
    found = ended(path)
    for topic, messages in heard.items():
        first = heard[topic][0].header.stamp
        recorded = [m for _, _, m in found.messages(f"/{topic}")]
        start = next(k for k, m in enumerate(recorded) if m.header.stamp == first)
        assert recorded[start : start + len(messages)] == messages
    for topic in ("contacts", "wrench", "stop", "stop_status", "push_direction"):
        assert found.topics[f"/skin/{topic}"].count > 100
    assert found.skin.circuit.shape == CIRCUIT.shape
    assert found.parameters["/compensation"]["method"] == "auto"
    names = {s.name for _, _, m in found.messages("/diagnostics") for s in m.status}
    assert {"serial_driver", "compensation", "gesture_feature", "recorder"} <= names

    stamps, pressure = found.images("/skin/pressure")
    replay = Replay(found)
    again = {step.stamp: step.force for step in replay}
    assert list(again) == stamps.tolist()
    for stamp, picture in zip(stamps.tolist(), pressure, strict=True):
        np.testing.assert_array_equal(again[stamp], picture * replay.cell_area)


def test_a_full_disk_ends_the_recording_and_never_the_skin(tmp_path, config):
    """The limit of a file's size is the operating system's own: EFBIG."""
    path, warned, counts = tmp_path / "a.mcap", [], []
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def on_diagnostics(message):
        warned.extend(s for s in message.status if s.name == "recorder" and s.level)

    def ended(heard, skin):
        """The disk is full after 150 frames; 50 frames after that was said."""
        if not counts and len(heard["skin/pressure"]) >= 150:
            skin.node.create_subscription(DiagnosticArray, "skin/diagnostics", on_diagnostics, 100)
            resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size, before[1]))
            counts.append(0)
        if warned and len(counts) == 1:
            counts.append(len(heard["skin/pressure"]))
        return warned and len(heard["skin/pressure"]) >= counts[-1] + 50

    try:
        run(tmp_path, config(), path, ended)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert warned[0].message == f"recording has ended: {os.strerror(errno.EFBIG)}"
    assert warned[0].level == DiagnosticStatus.WARN  # an error would stop the robot
    found = Recording(path)
    assert found.damage
    assert len(found.adc) > 10


def test_a_slow_disk_has_the_file_when_the_skin_has_ended(tmp_path, config, monkeypatch):
    """At the end of the process, which comes next, its thread would be cut."""
    path, close = tmp_path / "a.mcap", writer.Writer.close

    def slowly(self):
        time.sleep(0.2)  # longer than the other nodes are kept waiting
        close(self)

    monkeypatch.setattr(writer.Writer, "close", slowly)
    run(tmp_path, config(), path, lambda heard, _: len(heard["skin/pressure"]) >= 10)
    assert not Recording(path).damage


@pytest.mark.ci
def test_a_stop_is_kept_with_what_led_to_it(tmp_path, config):
    folder = tmp_path / "stops"
    folder.mkdir()

    def scene(t):  # idle, then 60 N
        return scenes.finger(*CIRCUIT.shape, 1.5, 2.0, 60.0 * (t % 4.0 > 2.0), 1.5)

    # of this fabric no frame is in doubt before its rest is measured, which would be the first stop
    board = simulator.Board(CIRCUIT, PressureCurve(), scene, seed=3)
    run(tmp_path, config(last=30.0), folder, lambda *_: any(folder.iterdir()), board)
    first = min(folder.iterdir())
    found = ended(first)
    assert first.name.startswith("stop_")
    stops = [m.data for _, _, m in found.messages("/skin/stop")]
    begin = next(k for k in range(1, len(stops)) if stops[k] and not stops[k - 1])
    assert begin > 50 and len(stops) - begin > 20
    assert any("push" in m.status[0].message for _, _, m in found.messages("/skin/stop_status"))


def test_a_file_that_is_there_ends_the_launch_before_it_begins(tmp_path, config):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"")
    skin = launch("skin.launch.yaml", port="loop://", config=config(), record=path)
    with pytest.raises(ValueError, match="is there already"):
        skin.__enter__()
    assert path.read_bytes() == b""


@pytest.mark.ci
def test_a_full_disk_is_in_the_summary_and_in_the_status(tmp_path):
    """A file that may not grow further fails as on a full disk; the skin runs on until its end."""
    command = [sys.executable, "-m", "tactile_skin", "record", tmp_path / "a.mcap"]
    done = subprocess.run(
        [*map(str, command), "demo.launch.yaml", "duration:=2"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000)),
    )
    assert done.returncode == 1
    summary = done.stdout[done.stdout.index("summary") :]
    assert "recorder: recording has ended: File too large" in summary
    assert "Traceback" not in done.stderr
