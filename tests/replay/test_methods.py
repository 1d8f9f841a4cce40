"""`bench recorded`, and `doctor`, on recorded files."""

import json

import numpy as np
import pytest
from test_replay import CELLS, write

from tactile_skin import cli
from tactile_skin.recording.convert import export
from tactile_skin.recording.frames import read_frames
from tactile_skin.replay.methods import measure, table
from tactile_skin.solvers import METHODS

pytest.importorskip("mcap")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write(tmp_path_factory.mktemp("recorded") / "a.mcap", 5.0)


def test_every_method_is_measured_where_most_happens(path):
    data = measure(40, str(path), None, 1)["recorded"]
    networks = {"cnn", "physics"}  # know the circuit of their training
    assert set(data["methods"]) == set(METHODS) - networks
    assert {note.split()[0] for note in data["notes"]} == {*networks, "the"}
    assert data["frames"] == 40
    assert data["methods"]["map"]["apart_g"] == 0.0 < data["methods"]["naive"]["apart_g"]
    assert data["methods"]["map"]["total_n"] == pytest.approx(40.0, rel=0.1)
    assert len(table(data).splitlines()) == 3 + len(METHODS)  # a line for each, or a note
    assert data["methods"]["map"]["suspect"] < 0.05  # the cells' rest is measured


def test_the_bench_takes_a_foreign_file(path, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    frames, config = tmp_path / "a.csv", tmp_path / "mine.yaml"
    export(read_frames(path), read_frames(path), frames)
    text = ", ".join(f"{k.removeprefix('circuit.')}: {v}" for k, v in CELLS.items())
    config.write_text(f"/**: {{ros__parameters: {{circuit: {{{text}}}}}}}\n")
    words = ["--frames", str(frames), "--config", str(config), "--out", str(tmp_path / "out")]
    assert cli.main(["bench", "recorded", "--quick", *words]) == 0
    assert "the busiest 30 frames" in capsys.readouterr().out
    written = json.loads((tmp_path / "out" / "recorded.json").read_text())
    assert written["methods"]["map"]["p50_ms"] > 0.0
    assert (tmp_path / "out" / "recorded.png").exists()


def test_a_few_blanks_cost_frames_and_no_method(path, tmp_path):
    frames = read_frames(path)
    frames.values[[20, 340, 350], 2, 3] = np.nan
    export(frames, frames, tmp_path / "a.npy")
    config = tmp_path / "mine.yaml"
    text = ", ".join(f"{k.removeprefix('circuit.')}: {v}" for k, v in CELLS.items())
    config.write_text(f"/**: {{ros__parameters: {{circuit: {{{text}}}}}}}\n")
    data = measure(40, str(tmp_path / "a.npy"), str(config), 1)["recorded"]
    assert set(data["methods"]) == set(METHODS) - {"cnn", "physics"}
    assert any("3 of 500 frames with blanks are left out" in note for note in data["notes"])


@pytest.mark.parametrize("words", [["recorded"], ["speed", "--frames", "a.csv"]])
def test_frames_belong_to_recorded(words, capsys):
    assert cli.main(["bench", "--quick", *words]) == 2
    assert "needs --frames FILE" in capsys.readouterr().err


def test_the_doctor_takes_a_recording_with_its_circuit(path, capsys):
    """6 x 7 cells; the default circuit is 16 x 16."""
    assert cli.main(["doctor", str(path)]) in (0, 1)
    said = capsys.readouterr().out
    assert "500 frames of 6 x 7" in said
    assert np.isfinite(read_frames(path).values).all()
