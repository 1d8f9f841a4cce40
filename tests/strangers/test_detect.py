# SPDX-License-Identifier: Apache-2.0
"""From plugging in an unknown board to the right picture: detect, four answers at most, launch."""

import io
import re

import numpy as np
import pytest
import yaml
from support.strangers import boards, sim
from support.strangers.pty_board import PtyBoard

from tactile_skin import Circuit
from tactile_skin.board.formats import make_format, make_parser
from tactile_skin.board.recognise import explain
from tactile_skin.cli import main
from tactile_skin.launch import launch
from tactile_skin.msg import Image, image_array

RATE = 20.0  # frames a second
KINDS = {  # printed by -> what is typed
    "frame_a_line": ["8 x 8", "loaded-pullup", "35000", "1023"],
    "row_a_line": ["loaded-pullup", "", ""],  # as boards.md has it
    "json_lines": ["loaded-pullup", "35000", ""],
    "index_value": ["8 8", "loaded-pullup", "35000", ""],
    "status_lines": ["8x8", "loaded-pullup", "35000", ""],
    "time_and_class": ["8x8", "loaded-pullup", "35000", ""],
}


class Stranger:
    """An 8 x 8 board with pull-ups; a finger of 20 N from 5 s to 7 s of each 8 s."""

    circuit = Circuit(8, 8, r_ref=35e3, r_par=25.0, readout="loaded")

    def __init__(self, make):
        self.make, self.rng = make, np.random.default_rng(0)
        self.curve = sim.fabric(self.circuit)
        self.finger = sim.finger((8, 8), 2, 5, 20.0)

    def __call__(self, k: int) -> bytes:
        pressed = 5.0 < k / RATE % 8.0 < 7.0
        force = self.finger if pressed else 0.0 * self.finger
        steps = sim.counts(self.circuit, self.curve, force, self.rng, inverted=True)
        return boards.sent(self.make, [steps], k)


@pytest.mark.ci
@pytest.mark.parametrize(
    "kind",
    [
        *list(KINDS)[:1],
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in list(KINDS)[1:]),
    ],
)
def test_from_an_unknown_board_to_the_right_picture(kind, tmp_path, monkeypatch, capsys):
    answers = KINDS[kind]
    assert len(answers) <= 4
    mine = tmp_path / "mine.yaml"
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(answers) + "\n"))
    with PtyBoard(Stranger(boards.TEXT[kind]), RATE) as board:
        assert main(["detect", f"port:={board.port}", "seconds:=2", f"out:={mine}"]) == 0
    said = capsys.readouterr().out
    assert "(sure)" in said and "what arrives:" in said
    pictures = []
    with PtyBoard(Stranger(boards.TEXT[kind]), RATE) as board:
        arguments = {"port": board.port, "config": mine, "monitor": "false"}
        with launch("skin.launch.yaml", **arguments) as skin:
            skin.node.create_subscription(
                Image, "skin/pressure", lambda m: pictures.append(image_array(m)), 100
            )
            skin.spin(6.9)
    pressed = max(pictures, key=np.sum) * 0.012**2  # N
    assert np.unravel_index(pressed.argmax(), pressed.shape) == (2, 5)
    assert pressed.sum() == pytest.approx(20.0, rel=0.25)


@pytest.mark.ci
def test_a_board_that_must_be_asked_gets_its_request(tmp_path, monkeypatch):
    mine, stranger = tmp_path / "mine.yaml", Stranger(boards.frame_a_line)
    count = iter(range(10_000))
    monkeypatch.setattr("sys.stdin", io.StringIO("8x8\nloaded-pullup\n35000\n\n"))
    with PtyBoard(lambda k: b"", 0.0, lambda data: stranger(next(count)) if b"A" in data else b""):
        pass  # it can be closed unasked
    with PtyBoard(
        lambda k: b"", 0.0, lambda data: stranger(next(count)) if b"A" in data else b""
    ) as board:
        words = [f"port:={board.port}", "baud:=115200", "seconds:=1.5", f"out:={mine}"]
        assert main(["detect", *words]) == 0
    assert re.search(r"request: A", mine.read_text())


@pytest.mark.parametrize("make", [boards.run_lengths, boards.packed])
def test_what_nothing_reads_is_shown_and_no_file_is_written(make, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    pictures = rng.integers(20, 900, (40, 8, 8))
    (tmp_path / "bytes.bin").write_bytes(boards.sent(make, pictures))
    assert main(["detect", "bytes.bin"]) == 1
    assert "not recognised" in capsys.readouterr().out
    assert not (tmp_path / "mine.yaml").exists()


def test_an_old_file_is_not_overwritten(tmp_path, capsys):
    (tmp_path / "mine.yaml").write_text("mine")
    assert main(["detect", "port:=loop://", f"out:={tmp_path / 'mine.yaml'}"]) == 2
    assert "exists" in capsys.readouterr().err


def detected(data: bytes, typed: str, folder, monkeypatch) -> dict:
    """Return the parameter file that `detect` writes of these bytes, by what is typed."""
    (folder / "bytes.bin").write_bytes(data)
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert main(["detect", "bytes.bin"]) == 0
    return yaml.safe_load((folder / "mine.yaml").read_text())


def test_cells_that_are_typed_are_looked_for_again_in_the_bytes(tmp_path, monkeypatch, capsys):
    """The first reading's high byte never changes: it looks like the head."""
    rng = np.random.default_rng(4)
    pictures = 900 + rng.integers(0, 40, (60, 8, 8))
    data = boards.sent(boards.words_with_an_end, pictures)
    found = detected(data, "8 x 8\nloaded-columns-pullup\n35000\n\n", tmp_path, monkeypatch)
    circuit = found["/**"]["ros__parameters"]["circuit"]
    link = found["/**/serial_driver"]["ros__parameters"]
    assert (circuit["rows"], circuit["driven"], circuit["inverted"]) == (8, "columns", True)
    parser = make_parser("packets", 8, 8, 10, make_format("packets", link["format"]))
    frames = parser.feed(data)  # the first packet's head is cut off
    assert len(frames) >= len(pictures) - 2
    np.testing.assert_array_equal(frames[0].samples, pictures[1] * 64)


def test_what_is_no_reading_of_the_cells_that_were_typed_is_no_full_scale(
    tmp_path, monkeypatch, capsys
):
    """Enter takes the value in brackets: that of an ADC of 14 bits would hide most of a force."""
    pictures = np.random.default_rng(4).integers(20, 900, (30, 8, 8))
    data = boards.sent(lambda a, k: "9999," + boards.frame_a_line(a, k), pictures)
    found = detected(data, "8 x 8\nloaded\n35000\n\n", tmp_path, monkeypatch)
    assert found["/**"]["ros__parameters"]["circuit"]["adc_bits"] == 10
    assert "64 readings, 1 in front that are none: text, 29 frames" in capsys.readouterr().out


def heard(folder, monkeypatch, *shape: int) -> None:
    """Write what a board of this shape sends to bytes.bin in this folder, and go there."""
    pictures = np.random.default_rng(4).integers(20, 900, (30, *shape))
    (folder / "bytes.bin").write_bytes(boards.sent(boards.frame_a_line, pictures))
    monkeypatch.chdir(folder)


def test_what_nobody_answers_is_said(tmp_path, monkeypatch, capsys):
    heard(tmp_path, monkeypatch, 8, 10)
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert main(["detect", "bytes.bin"]) == 0
    asked = capsys.readouterr().out.count("no answer: what is in brackets holds")
    assert asked == 4  # shape, wiring, r_ref and full scale


def test_a_shape_that_no_frame_has_is_refused(tmp_path, monkeypatch, capsys):
    """Nobody is asked, and nothing guessed, against what was given."""
    heard(tmp_path, monkeypatch, 8, 10)
    assert main(["detect", "bytes.bin", "rows:=10", "cols:=9", "r_ref:=470"]) == 2
    said = "rows = 10, cols = 9: must be 80 cells together, as a frame has"
    assert said in capsys.readouterr().err
    assert not (tmp_path / "mine.yaml").exists()


def test_lines_of_another_length_than_was_given_are_refused(tmp_path, monkeypatch, capsys):
    """Their cells are as many, but no frame would ever be read."""
    noise = np.random.default_rng(4).integers(0, 5, (30, 8, 6))
    pictures = 400 + 20 * np.arange(8)[:, None] + noise
    (tmp_path / "bytes.bin").write_bytes(boards.sent(boards.row_a_line, pictures))
    monkeypatch.chdir(tmp_path)
    assert main(["detect", "bytes.bin", "rows:=6", "cols:=8", "r_ref:=470"]) == 2
    assert "rows = 6, cols = 8: must be 8 x 6, as the lines show" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["{:.1f}", "{:.0f}"])
def test_no_scale_is_proposed_for_numbers_that_may_be_resistances(
    form, tmp_path, monkeypatch, capsys
):
    kilo = 1e-3 if "1" in form else 1.0
    ohm = np.random.default_rng(4).uniform(9_000.0, 11_000.0, (30, 64)) * kilo
    (tmp_path / "bytes.bin").write_text("\n".join(",".join(map(form.format, r)) for r in ohm))
    monkeypatch.chdir(tmp_path)
    if kilo < 1.0:
        words = ["rows:=8", "cols:=8", "r_ref:=1780", "readout:=floating", "full_scale:=12"]
        assert main(["detect", "bytes.bin", *words]) == 2
        assert "full_scale = 12: must be 1023 or 4095 of ADC steps" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin", io.StringIO("8 x 8\nfloating\n1780\n\n"))
    assert main(["detect", "bytes.bin"]) == 2
    said = capsys.readouterr()
    assert "resistances and forces cannot be read: print what the ADC reads" in said.out
    assert "full_scale = '': must be a number above 0" in said.err


def test_a_shape_that_is_not_sure_is_asked(tmp_path, monkeypatch):
    """A counter of frames looks like the number of a row."""
    pictures = np.random.default_rng(4).integers(20, 900, (60, 8, 8))
    data = boards.sent(lambda a, k: f"{k % 10}," + boards.frame_a_line(a, k), pictures)
    found = detected(data, "8 x 8\nfloating\n1780\n\n", tmp_path, monkeypatch)
    assert found["/**"]["ros__parameters"]["circuit"]["rows"] == 8
    assert found["/**/serial_driver"]["ros__parameters"]["format"] == {"line": "{skip},{values}"}


def test_what_a_parameter_file_knows_of_the_wiring_is_kept(tmp_path, monkeypatch):
    heard(tmp_path, monkeypatch, 6, 6)
    given = {"rows": 6, "cols": 6, "r_ref": 470.0, "r_par": 12.0, "adc_bits": 12, "inverted": True}
    given |= {"readout": "grounded", "driven": "columns", "r_drive": 7.0}
    mine = {"/**": {"ros__parameters": {"circuit": given}}}
    (tmp_path / "old.yaml").write_text(yaml.safe_dump(mine))
    monkeypatch.setattr("sys.stdin", io.StringIO("6 x 6\n1023\n"))
    assert main(["detect", "bytes.bin", "config:=old.yaml"]) == 0
    found = yaml.safe_load((tmp_path / "mine.yaml").read_text())["/**"]["ros__parameters"]
    assert found["circuit"] == given | {"adc_bits": 10}


def test_an_unknown_word_behind_the_wiring_is_an_error(tmp_path, monkeypatch, capsys):
    heard(tmp_path, monkeypatch, 6, 6)
    monkeypatch.setattr("sys.stdin", io.StringIO("6 x 6\nloaded-rows\n\n\n"))
    assert main(["detect", "bytes.bin"]) == 2
    assert "wiring -rows: must be -columns, -pullup, -diodes or -esp32" in capsys.readouterr().err


def test_diodes_and_an_esp32_are_asked_for(tmp_path, monkeypatch):
    """No byte shows them, and a hard push behind a diode that nobody entered is felt as a fifth."""
    heard(tmp_path, monkeypatch, 6, 6)
    monkeypatch.setattr("sys.stdin", io.StringIO("6 x 6\nloaded-diodes-esp32\n\n4095\n"))
    assert main(["detect", "bytes.bin"]) == 0
    text = (tmp_path / "mine.yaml").read_text()
    found = yaml.safe_load(text)["/**"]["ros__parameters"]["circuit"]
    assert (found["diode"], found["adc_table"]) == (0.58, "esp32")
    assert "circuit.diode: as of a 1N4148" in text


def test_bytes_of_which_nothing_is_known_get_a_reason(tmp_path, capsys):
    """Words of 16 bits with no head: the sentence ended where its reason should stand."""
    words = np.random.default_rng(1).integers(700, 900, (100, 64)).astype("<u2")
    (tmp_path / "words.bin").write_bytes(words.tobytes())
    out = f"out:={tmp_path / 'mine.yaml'}"
    assert main(["detect", str(tmp_path / "words.bin"), out, "rows:=8", "cols:=8"]) == 1
    assert "not recognised: neither text, nor packets that begin alike." in capsys.readouterr().out


@pytest.mark.parametrize(("largest", "kind"), [(9.5, "resistances"), (4.7, "volts")])
def test_small_numbers_with_decimals_are_no_means_of_adc_steps(largest, kind):
    """They were taken as steps of an ADC of 12 bits, and no touch was felt."""
    ohm = np.random.default_rng(4).uniform(0.9 * largest, largest, (60, 64))
    parser = make_parser("text", 8, 8, 12)
    lines = "".join(",".join(f"{r:.2f}" for r in each) + "\n" for each in ohm)
    assert not parser.feed(lines.encode())
    said = explain(parser)
    assert f"these look like {kind}: set" in said and "Resistances cannot be read" in said


def test_means_that_an_adc_reads_are_no_resistances():
    means = np.random.default_rng(4).uniform(20.0, 40.0, (60, 64))
    lines = "".join(",".join(f"{r:.2f}" for r in each) + "\n" for each in means)
    assert len(make_parser("text", 8, 8, 12).feed(lines.encode())) == 59
