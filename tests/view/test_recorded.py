# SPDX-License-Identifier: Apache-2.0
"""A recording's snapshots, by time."""

import asyncio

import numpy as np
import pytest

pytest.importorskip("mcap", reason="reads recordings")
pytest.importorskip("websockets", reason="serves the page")

from tactile_skin.cli import main
from tactile_skin.errors import FileError
from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    KeyValue,
    Time,
    cloud_of,
    image,
)
from tactile_skin.nodes.gesture_feature import CONTACT
from tactile_skin.recording import cdr
from tactile_skin.recording.reader import Recording
from tactile_skin.recording.writer import Writer
from tactile_skin.view.recorded import Recorded
from tactile_skin.view.server import Wanted


def write(path, readings: int, where="/skin"):
    """Readings 10 ms apart: the k-th is of k counts and k newtons, and stops from 30 N on."""
    writer = Writer(path, {}, 0)

    def put(topic, t, message):
        writer.write(topic, type(message), t, cdr.encode(message))

    for k in range(readings):
        t = 10**18 + k * 10**7
        header = Header(Time(*divmod(t, 10**9)))
        adc = np.full((16, 16), 64 * k, np.uint16)
        put(f"{where}/adc", t, image(adc, "16UC1", header))
        put(f"{where}/pressure", t + 1, image(np.full((16, 16), float(k)), "32FC1", header))
        contact = [(0.15, 0.0, 0.0, k, 1e-4, 1.0, 7.0, 0.0, 0.0, 0.0, 1.0, k, 1.0)]
        put(f"{where}/contacts", t + 2, cloud_of(CONTACT, contact, header))
        values = [KeyValue("causes", "push" * (k >= 30)), KeyValue("counts_as", f"{k}")]
        said = (2, "stop_on_push", "push") if k >= 30 else (0, "stop_on_push", "")
        status = DiagnosticStatus(*said, "", values)
        put(f"{where}/stop_status", t + 3, DiagnosticArray(header, [status]))
    writer.close()
    return path


def test_each_time_has_all_that_was_said_of_its_reading(tmp_path):
    shown = Recorded(Recording(write(tmp_path / "a.mcap", 50)))
    hello, history = shown.hello()["recording"], shown.hello()["history"]
    assert hello["duration"] == pytest.approx(0.49) and hello["interval"] == pytest.approx(0.01)
    assert history["force"] == list(range(50)) and history["stop"] == [k >= 30 for k in range(50)]
    (stop,) = shown.log.entries()
    assert (stop["kind"], stop["end"], stop["causes"]) == ("stop", None, ["push"])
    assert stop["begin"] == pytest.approx(0.3) and stop["force"] == 49.0
    assert stop["stamp"] - hello["start"] == pytest.approx(0.49)
    for at, k in ((0.0, 0), (0.301, 30), (0.309, 30), (0.31, 31), (99.0, 49), (-1.0, 0)):
        number, snapshot = asyncio.run(shown.snapshot(Wanted(at=at)))
        assert number == k + 1
        assert (snapshot.adc == 64 * k).all() and (snapshot.pressure == k).all()
        assert snapshot.contacts[0, 3] == k and snapshot.stop is (k >= 30)
        assert snapshot.reason == ("push" if k >= 30 else "")


def test_a_long_recording_is_read_by_blocks(tmp_path, monkeypatch):
    """Of several blocks, in any order, the same as of one; few are kept."""
    recording = Recording(write(tmp_path / "a.mcap", 50))
    for name, value in (("_BLOCK", 8), ("_BLOCKS", 2)):
        monkeypatch.setattr(f"tactile_skin.view.recorded.{name}", value)
    shown = Recorded(recording)
    assert len(shown._blocks) == 7
    for k in (49, 0, 7, 8, 9, 15, 16, 40, 48, 3):
        number, snapshot = asyncio.run(shown.snapshot(Wanted(at=k / 100)))
        assert number == k + 1
        assert (snapshot.adc == 64 * k).all() and (snapshot.pressure == k).all()
        assert snapshot.contacts[0, 3] == k and snapshot.stop is (k >= 30)
    assert shown._block.cache_info().currsize == 2


def test_a_skin_of_several_is_chosen_by_its_namespace(tmp_path):
    path = write(tmp_path / "a.mcap", 3, "/left/skin")
    assert Recorded(Recording(path, "left")).shape == (16, 16)


def test_a_long_recordings_force_is_drawn_by_its_peaks(tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_skin.view.recorded._POINTS", 10)
    hello = Recorded(Recording(write(tmp_path / "a.mcap", 45))).hello()["history"]
    assert hello["force"] == [4, 9, 14, 19, 24, 29, 34, 39, 44] and len(hello["times"]) == 9


def test_what_cannot_be_shown_is_said_in_a_line(tmp_path, capsys):
    empty = tmp_path / "empty.mcap"
    Writer(empty, {}, 0).close()
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("/**: {ros__parameters: {circuit: {rows: 8}}}")
    good = str(write(tmp_path / "good.mcap", 3))
    for words, said in (
        ([str(empty)], "holds no message"),
        ([str(tmp_path / "none.mcap")], "none.mcap"),
        ([good, "view_port:=http"], "view_port:=http: must be a whole number"),
        ([good, "speed:=2"], "argument 'speed' is unknown"),
        ([good, good], "one recording, not 2"),
        ([good, "view_port:=0", f"config:={wrong}"], "16 x 16, the configuration says 8 x 16"),
    ):
        assert main(["view", *words]) == 2
        error = capsys.readouterr().err.strip().splitlines()
        assert len(error) == 1 and said in error[0]


def test_a_message_of_another_size_names_the_file(tmp_path):
    path = tmp_path / "a.mcap"
    writer = Writer(path, {}, 0)
    bad = Image(Header(), 4, 4, "16UC1", 0, 8, b"short")
    writer.write("/skin/adc", Image, 1, cdr.encode(bad))
    writer.close()
    with pytest.raises(FileError, match=r"a\.mcap"):
        Recorded(Recording(path))
