# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin gestures`: takes are recorded, a recogniser is trained, and judged."""

import re

import numpy as np
import pytest
import yaml
from support.simulated import make_board

from tactile_skin import Circuit, cli
from tactile_skin.commands.gestures import record
from tactile_skin.learning.hands import simulated
from tactile_skin.middleware.bus import Time
from tactile_skin.middleware.config import skin_of
from tactile_skin.msg import Header, Image, image
from tactile_skin.nodes.observers.gestures import SHIPPED
from tactile_skin.recording import cdr
from tactile_skin.recording.writer import Writer
from tactile_skin.touch.geometry import CELL_AREA
from tactile_skin.touch.model import load_model
from tactile_skin.touch.take import PAUSE, SUFFIX, Take, load_take

for library in ("sklearn", "tqdm", "mcap"):
    pytest.importorskip(library)


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("takes")
    gestures = "stroke", "tickle", "poke"
    for k, take in enumerate(simulated(range(300, 303), 3, 0, gestures=gestures)):
        take.save(folder / f"{k}{SUFFIX}")
    return folder


@pytest.mark.ci
def test_a_recogniser_is_trained_from_ones_own_takes(takes, tmp_path, capsys):
    out = tmp_path / "mine.gestures.npz"
    assert cli.main(["gestures", "train", str(takes), "--out", str(out)]) == 0
    model = load_model(out)
    assert model.classes == ("poke", "stroke", "tickle")
    assert model.about["takes"] == dict.fromkeys(model.classes, 9)
    capsys.readouterr()
    assert cli.main(["gestures", "evaluate", str(takes), "--model", str(out)]) == 0
    said = capsys.readouterr().out
    assert "right: 1.000 +- 0.000" in said  # those that it was trained on


def test_people_are_left_out_in_turn(takes, capsys):
    assert cli.main(["gestures", "evaluate", str(takes)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "people left out in turn"
    assert [line.split()[0] for line in lines[2:5]] == ["poke", "stroke", "tickle"]
    (right,) = (line for line in lines if line.startswith("right: "))
    assert float(right.split()[1]) > 0.7
    people = {take.person for take in map(load_take, takes.iterdir())}
    assert {line.split(": ")[0] for line in lines if " takes" in line} == people | {"right"}


def test_an_evaluation_is_drawn(takes, tmp_path, capsys):
    image = pytest.importorskip("matplotlib.image")
    picture = tmp_path / "evaluation.png"
    assert cli.main(["gestures", "evaluate", str(takes), "--picture", str(picture)]) == 0
    said = capsys.readouterr().out
    assert str(picture) in said and "nothing was recorded as 'other'" in said
    drawn = image.imread(picture)
    assert drawn.shape[1] > 600 and drawn.std() > 0.05


def test_false_gestures_are_counted_an_hour_of_what_is_none(tmp_path, capsys):
    for k in range(6):
        picture = np.zeros((50, 16, 16))  # 2 s of a thing that shakes, and the silence after it
        picture[:, 4:7, 4:7] = 1.0 + np.sin(np.arange(50) + k)[:, None, None]
        label = "other" if k < 4 else "tickle"
        Take(label, "robot", picture, 0.04, 0.018).save(tmp_path / f"{k}{SUFFIX}")
    given = ["--model", str(SHIPPED)]
    assert cli.main(["gestures", "evaluate", str(tmp_path), *given]) == 0
    (line,) = (x for x in capsys.readouterr().out.splitlines() if x.startswith("false gestures"))
    found = re.fullmatch(r"false gestures: (\d) of 4, (\d+) an hour of 'other'", line)
    assert int(found[2]) == pytest.approx(int(found[1]) / 4 * 3600 / 2.0, rel=0.25)


def test_few_takes_and_absent_ones_are_mistakes_that_are_named(takes, tmp_path, capsys):
    one = tmp_path / f"one{SUFFIX}"
    load_take(next(takes.iterdir())).save(one)
    out = str(tmp_path / "model")
    for words, said in (
        (["train", str(one), "--alone", "--out", out], "3 takes of a gesture at least are needed"),
        (["train", "--alone", "--out", out], "--alone needs takes"),
        (["train", str(tmp_path / "absent"), "--out", out], "absent: does not exist"),
        (["evaluate", str(one)], "takes of two gestures at least"),
        (["record", "a/b"], "NAME 'a/b': must be of letters"),
        (["record", "a.mcap"], "NAME 'a.mcap': must be of letters"),
        (["record", "stroke", "--times", "0"], "--times 0: must be 1 or more"),
        (["record", "hold", "a.mcap", "config:=b"], "config: of a file, only namespace:= is taken"),
    ):
        assert cli.main(["gestures", *words]) == 2
        assert said in capsys.readouterr().err
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("words", [[], ["namespace:=left"]])
def test_each_touch_of_a_recording_is_a_take(words, tmp_path, capsys):
    path = tmp_path / "touches.mcap"
    on = np.array([0] * 20 + [1] * 30 + [0] * 150 + [1] * 20 + [0] * 150 + [1] + [0] * 20)
    writer = Writer(path, {}, 0)
    for k, touched in enumerate(on):
        t = (k + 1) * 10_000_000  # ns: a hundred frames a second
        header = Header(Time(nanoseconds=t).to_msg(), "base_link")
        spot = np.zeros((16, 16))
        spot[5:7, 5:7] = touched * 2.0 / CELL_AREA
        for topic, picture in (
            ("adc", image(np.zeros((16, 16)), "16UC1", header)),
            ("pressure", image(spot, "32FC1", header)),
        ):
            writer.write(f"/left/skin/{topic}", Image, t, cdr.encode(picture))
    if words:  # there is another skin
        writer.write("/right/skin/adc", Image, t, cdr.encode(picture))
    writer.close()
    out = tmp_path / "takes"
    assert cli.main(["gestures", "record", "hold", str(path), *words, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "2 takes of hold" in said and "a touch of 0.04 s is too short" in said
    seconds = sorted(take.period * len(take.pictures) for take in map(load_take, out.iterdir()))
    # a picture of 0.04 s at each end may hold a part of it
    assert seconds == pytest.approx([0.2, 0.3], abs=0.08)
    assert all(take.pictures.max() == pytest.approx(2.0) for take in map(load_take, out.iterdir()))


@pytest.fixture(scope="module")
def labelled(tmp_path_factory):
    """Three presses and three strokes of two people in one table, and the skin's configuration."""
    folder, circuit = tmp_path_factory.mktemp("labelled"), Circuit(8, 8, r_ref=4700.0)
    board, rng = make_board(circuit=circuit), np.random.default_rng(0)
    path = folder / "mine.yaml"
    given = {"circuit": {"rows": 8, "cols": 8, "r_ref": 4700.0}, "geometry": {"shape": "plane"}}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    lines = ["time_s,gesture,subject," + ",".join(f"s_{k}" for k in range(64))]
    for k in range(400):
        force, (part, at) = np.zeros((8, 8)), divmod(k - 40, 60)
        name = "" if part < 0 else ("press", "stroke")[part % 2]
        if part >= 0 and at < 25:
            place = 3 if name == "press" else at // 6
            force[3:5, place : place + 2] = 3.0
        steps = 1023 * board.matrix.ratio(force[None])[0] + 0.4 * rng.standard_normal((8, 8))
        words = [f"{k / 20:.3f}", name or "none", "ab"[k >= 220]]
        lines.append(",".join([*words, *map(str, np.rint(steps).astype(int).ravel())]))
    (folder / "table.csv").write_text("\n".join(lines))
    return folder / "table.csv", path


def test_a_labelled_table_is_takes_of_each_of_its_classes(labelled, tmp_path, capsys):
    table, config = labelled
    words = [str(table), f"config:={config}", "--out", str(tmp_path)]
    assert cli.main(["gestures", "record", *words]) == 0
    said = capsys.readouterr()
    assert "3 takes of press in" in said.out and "3 takes of stroke in" in said.out
    found = [load_take(path) for path in tmp_path.iterdir()]
    named = {(take.label, take.person) for take in found}
    assert named == {(name, person) for name in ("press", "stroke") for person in "ab"}
    assert all(take.period * len(take.pictures) == pytest.approx(1.25, abs=0.2) for take in found)
    assert cli.main(["gestures", "record", "poke", *words]) == 2
    assert "must be one of its labels, none, press, stroke" in capsys.readouterr().err


@pytest.mark.ci
def test_a_recogniser_is_trained_from_a_labelled_table(labelled, tmp_path):
    table, config = labelled
    words = ["--config", str(config), "--out", str(tmp_path / "model.npz")]
    assert cli.main(["gestures", "train", str(table), *words]) == 0
    assert load_model(tmp_path / "model.npz").about["takes"] == {"press": 3, "stroke": 3}


def test_a_take_is_over_when_the_skin_is_left_alone():
    course = record.Course(skin_of({}, "").geometry)
    touch = np.zeros((16, 16))
    touch[5:7, 5:7] = 2.0 / CELL_AREA
    for k in range(1, 100):
        course.add(k / 100, touch if 20 <= k < 50 else 0.0 * touch)
        assert course.takes(PAUSE) == []
    for k in range(100, 170):
        course.add(k / 100, 0.0 * touch)
    ((pictures, period, pitch),) = course.takes(PAUSE)
    assert period * len(pictures) == pytest.approx(0.3, abs=0.08)
    assert pictures.max() == pytest.approx(2.0) and pitch > 0.0
    assert course.takes() == []


@pytest.mark.ci
def test_takes_are_made_on_a_live_skin(tmp_path, capsys):
    words = ["gestures", "record", "tap", "scene:=gestures", "--times", "1", "--person", "anna"]
    assert cli.main([*words, "--out", str(tmp_path)]) == 0
    (take,) = map(load_take, tmp_path.iterdir())
    assert take[:2] == ("tap", "anna") and take.pictures.any()
    assert "1 take of tap" in capsys.readouterr().out
