# SPDX-License-Identifier: Apache-2.0
"""`calibrate` from end to end: an unknown board, and a person who does as he is told."""

import copy
import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from support.lab.unknown import Creeping, Unknown
from support.marks import slow
from support.resting import noisy_cells
from support.weights import bodies, objects

from tactile_skin import Circuit, compensate
from tactile_skin.calibration.creep import LAID
from tactile_skin.commands import calibrate
from tactile_skin.commands.calibrate import picture
from tactile_skin.guide.calibration import MOST_MOVED, Guide
from tactile_skin.guide.creep import stand
from tactile_skin.guide.weight import newtons
from tactile_skin.middleware import written
from tactile_skin.middleware.config import read_skin
from tactile_skin.physics.curve import GRAM, PressureCurve

SHAPE = 12, 12
WEIGHTS = 3.0, 5.0, 8.0, 12.0, 17.0, 23.0, 30.0, 38.0, 44.0, 49.0  # N


class Person:
    """Answers each question, and presses or lays things on as it asks.

    Attributes:
        heard: all that was said.
    """

    def __init__(self, board: Unknown, weights, spoil=lambda frames: frames, shape=SHAPE):
        self.board, self.heard, self._spoil = board, [], spoil
        rng = np.random.default_rng(5)
        self._touches = list(bodies(40, shape, rng))
        things = bodies(len(weights), shape, rng)
        self._things = [f * (w / f.sum()) for f, w in zip(things, weights, strict=True)]
        self._weights = list(weights)
        self._force, self._pressing, self._looks = np.zeros(shape), False, 0

    def ask(self, text: str) -> str:
        self.heard.append(text)
        if "hands off" in text:
            self._force = np.zeros_like(self._force)
            return ""
        self._pressing = False
        if "its weight" not in text or not self._things:
            return ""
        self._force = self._things.pop(0)
        return f"{self._weights.pop(0) / GRAM:.0f} g"

    def say(self, text: str) -> None:
        self.heard.append(text)
        self._pressing = self._pressing or "Press here and there" in text

    def frames(self, seconds: float) -> np.ndarray:
        if self._pressing:
            self._looks += 1
            if self._looks % 2:
                self._force = self._touches.pop(0)
        return self._spoil(self.board.frames([self._force] * max(2, round(10 * seconds))))


@pytest.fixture(scope="module")
def done():
    board = Unknown(SHAPE, seed=21)
    person = Person(board, WEIGHTS)
    guide = Guide(board.supposed, person.frames, person.ask, person.say)
    guide.run()
    return board, person, guide


def test_new_touches_are_felt_in_newtons(done):
    """Within 5 % in the median, with what was written to a file and read again."""
    board, _, guide = done
    rest = guide.rest
    off = []
    cells = 1.0 / rest.conductance
    for force in bodies(12, SHAPE, np.random.default_rng(99)):
        force = force * (20.0 / force.sum())
        curve = guide.fitted.curve.resting_at(cells)
        found = compensate(board.frames([force])[0], guide.circuit, curve, "map")
        off.append(found.force.sum() / force.sum() - 1.0)
    assert np.median(np.abs(off)) < 0.05


def test_each_step_says_what_it_found(done):
    _, person, _ = done
    heard = "\n".join(person.heard)
    for words in ("1 of 3", "at rest", "2 of 3", "r_par = ", "3 of 3", "felt: "):
        assert words in heard


@pytest.mark.parametrize(
    ("shape", "kind"),
    [((4, 4), "scatters"), slow((8, 8), "jumps"), slow((16, 16), "drops to 0")],
)
def test_noisy_cells_are_named_and_left_out(shape, kind):
    """As is a cell with a loose contact; the rest of the skin is calibrated all the same."""
    board = Unknown(shape, seed=23)
    cells, spoil = noisy_cells(board, kind, np.random.default_rng(3))
    person = Person(board, (3.0, 8.0, 17.0, 30.0), spoil, shape)
    guide = Guide(board.supposed, person.frames, person.ask, person.say)
    guide.run()
    assert set(guide.rest.noisy) == set(cells)
    assert f"row {cells[0][0]}, column {cells[0][1]} is noisy" in "\n".join(person.heard)
    assert guide.fitted.error < 0.25


def test_creep_is_measured_and_written(tmp_path):
    """By one object, on a skin whose file has a curve; that is then of a load that just came."""
    skin = Creeping((8, 8), seed=25, share=0.06, time=1.0)
    force = objects(1, (8, 8), np.random.default_rng(25))[0][0]
    rest, load = skin.at_rest(), None
    heard, clock = [], 0.0

    def frames(seconds):
        nonlocal clock
        if len(heard) == 1 or clock < 1.0:
            clock += seconds if load is not None else 0.0
            return rest
        clock += seconds
        return load[int((clock - 1.0) / seconds)][None]

    def ask(text):
        nonlocal load
        heard.append(text)
        if "Take a thing" in text:
            times = np.arange(0.0, 125.0, 0.25)
            load = skin.standing(times, force, np.ones(times.size))
        return ""

    source = tmp_path / "mine.yaml"
    source.write_text("/**: {ros__parameters: {circuit: {rows: 8, cols: 8}}}\n")
    before, guide = read_skin(source), Guide(skin.supposed, frames, ask, heard.append)
    stand(guide, before.curve)
    assert guide.creep.share == pytest.approx(0.06, abs=0.006)
    assert any("110 s of 120 s" in text for text in heard)
    for _ in range(2):  # the second time it is that of a load that just came already
        calibrate.write(source, source, guide, read_skin(source))
        after = read_skin(source)
        assert after.creep.share == pytest.approx(guide.creep.share, abs=1e-4)
        added = [1.0 / c.points[5][1] - 1.0 / c.points[0][1] for c in (before.curve, after.curve)]
        assert added[0] / added[1] == pytest.approx(float(guide.creep.gain(LAID)), rel=1e-3)


def test_each_press_that_does_not_count_says_why(done):
    """A short one once it ends, and not what is left of one that has counted."""
    moves, known = "it moves: hold it still", "it is counted already: press somewhere else"
    light = [f"too light, {n}.5 of 9.0 ADC steps: press harder" for n in (5, 6)]
    looks = [moves, "", light[0], "", *light, "", moves, None, known, light[0], "", known, ""]
    looks = iter([*looks, moves, *[known] * 4, "", None, *[known] * 4, ""])

    def look():
        reason = next(looks, "")
        return (np.zeros(SHAPE), "") if reason is None else (None, reason)

    heard, board = [], done[0]
    guide = Guide(board.supposed, board.frames, input, heard.append)
    guide._new_touch = look
    assert len(list(guide.presses())) == 2
    said = [text.removeprefix("  does not count: ") for text in heard[:-1]]
    assert said == [moves, light[1], known, known, known]


def test_touches_that_tell_nothing_are_not_asked_for_further(done):
    """After ten it says so once, with what to do; the person may go on."""
    heard, looks = [], iter(done[0].at_rest(40))
    guide = Guide(done[0].supposed, None, input, heard.append)
    guide.rest, guide._new_touch = done[2].rest, lambda: (next(looks), "")
    guide.identify()
    assert len(guide.touches) == 10
    assert sum("do not tell r_par and r_line" in text for text in heard) == 1


def test_without_a_curve_enter_ends_after_a_question_only(done):
    guide, asked = copy.copy(done[2]), []
    guide.ask, guide.fitted = lambda text: asked.append(text) or "", None
    assert guide.fit_curve() and len(asked) == 2 and "0 of at least 3 objects: no curve" in asked[1]


def test_a_skin_that_never_rests_ends_it():
    """With what to do about it, and not by asking for ever: a line may be loose."""
    board = Unknown(SHAPE, seed=22)
    asked, frames = [], board.at_rest(30)
    frames[::3, 4] += 0.3
    guide = Guide(board.supposed, lambda _: frames, asked.append, print)
    with pytest.raises(ValueError, match=r"row 4, column.*doctor"):
        guide.run()
    assert len(asked) == 5


def test_the_file_is_one_that_the_launch_takes(done, tmp_path):
    """What was there before stays, beside it and in it."""
    board, _, guide = done
    source = tmp_path / "mine.yaml"
    source.write_text(
        "/**: {ros__parameters: {circuit: {rows: 12, cols: 12}, geometry: {radius: 0.2}}}\n"
        "serial_driver: {ros__parameters: {baud: 115200}}\n"
    )
    before = source.read_text()
    calibrate.write(source, source, guide, read_skin(source))
    assert (tmp_path / "mine.yaml.bak").read_text() == before
    skin = read_skin(source)
    assert skin.circuit.r_par == pytest.approx(guide.circuit.r_par, abs=0.06)
    assert skin.circuit.r_par == pytest.approx(board.r_par, rel=0.05)
    assert skin.circuit.r_line == pytest.approx(board.r_line, abs=5.0)
    force = np.array([0.5, 2.0, 8.0])
    np.testing.assert_allclose(
        skin.curve.resistance(force), guide.fitted.curve.resistance(force), rtol=0.01
    )
    data = yaml.safe_load(source.read_text())
    assert data["serial_driver"]["ros__parameters"]["baud"] == 115200
    assert source.read_text().startswith("# calibrate: made by tactile-skin calibrate")


def test_limits_of_the_file_stay_within_the_curve(done, tmp_path):
    """Soft objects tell little of a hard cell: `peak` must still be a force that the curve has."""
    guide, source = copy.copy(done[2]), tmp_path / "mine.yaml"
    source.write_text("/**: {ros__parameters: {circuit: {rows: 12, cols: 12}}}\n")
    gain = np.full(SHAPE, 0.92345)
    soft = PressureCurve([0.0, 1.0, 5.1], [40000.0, 800.0, 150.0]).with_gain(gain)
    guide.fitted = dataclasses.replace(guide.fitted, curve=soft)
    skin = read_skin(source)
    calibrate.write(source, source, guide, skin)
    assert read_skin(source).curve.max_force == pytest.approx(skin.curve.max_force, rel=1e-3)


@pytest.mark.parametrize("step", ["fsync", "replace", "copy2"])
def test_a_crash_while_writing_leaves_a_file(tmp_path, monkeypatch, step):
    """The old one, whole, and nothing half written beside it."""
    path = tmp_path / "mine.yaml"
    path.write_text("old")

    def crash(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(written.shutil if step == "copy2" else written.os, step, crash)
    with pytest.raises(KeyboardInterrupt):
        written.replace_file(path, "new")
    assert path.read_text() == "old"
    monkeypatch.undo()
    written.replace_file(path, "new")
    assert path.read_text() == "new"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.yaml", "mine.yaml.bak"]


@pytest.mark.parametrize(
    ("text", "weight"),
    [("500 g", 500 * GRAM), ("1,2 kg", 1200 * GRAM), (" 5 N ", 5.0), ("250g", 250 * GRAM)]
    + [(text, None) for text in ("", "heavy", "-3 N", "0 g", "5 lb", "1.5", "250")],
)
def test_weights_as_people_write_them(text, weight):
    assert newtons(text) == (None if weight is None else pytest.approx(weight))


def test_a_picture_of_text():
    """A line a row, two characters a cell, the hardest the darkest."""
    force = np.zeros((2, 3))
    force[1, 2] = 4.0
    assert picture(force).splitlines()[1:-1] == ["  |      |", "  |    @@|"]


@pytest.mark.parametrize(
    ("path", "why"),
    [(".", "is a folder"), ("no/such.yaml", "no folder"), ("/proc/x.yaml", "/proc")],
)
def test_a_file_that_cannot_be_written_is_told_before_the_work(path, why):
    with pytest.raises(ValueError, match=f"--out.*{why}"):
        calibrate.run(SimpleNamespace(out=Path(path), config=None, words=[], creep=None))


@pytest.mark.parametrize("word", ["port", "speed:=3", "baud:=fast"])
def test_words_that_are_no_parameters_of_a_board(word):
    with pytest.raises(ValueError, match=r"must be|is unknown"):
        calibrate.split_words([word])


def test_a_curve_that_contradicts_its_weights_is_not_kept():
    """A misread unit in one line, and again: what is left would be off by more than half."""
    board = Unknown(SHAPE, seed=22)
    person = Person(board, WEIGHTS[:4])
    person._weights = [0.005 * w if k % 2 else w for k, w in enumerate(person._weights)]
    guide = Guide(board.supposed, person.frames, person.ask, person.say)
    guide.measure_rest()
    guide.fit_curve()
    assert guide.fitted is None
    assert "this curve is not kept" in person.heard[-1]


def test_an_object_can_be_taken_back():
    board = Unknown(SHAPE, seed=23)
    person = Person(board, WEIGHTS[:4])
    said = iter(["", "back"])

    def ask(text):
        if "object 3" in text and next(said, None) == "":
            return "back"
        return person.ask(text)

    guide = Guide(board.supposed, person.frames, ask, person.say)
    guide.measure_rest()
    guide.fit_curve()
    assert guide.fitted is not None and len(guide.fitted.off) == 3


def test_frames_before_the_object_came_or_slid_are_seen():
    guide = Guide(Circuit(rows=4, cols=4), lambda s: None, lambda q: "", lambda t: None)
    guide.rest = SimpleNamespace(adc=np.full((4, 4), 0.1), noise=1.0)
    noise = np.random.default_rng(0).normal(0.0, 0.001, (90, 4, 4))
    stands = 0.1 + noise
    stands[:, 1:3, 1:3] += 0.3
    came = stands.copy()
    came[:50, 1:3, 1:3] -= 0.3
    slid = stands.copy()
    slid[45:, 1:3, 1] -= 0.05
    assert guide.moved(stands) <= MOST_MOVED < min(guide.moved(came), guide.moved(slid))


def test_a_touch_that_creeps_counts_and_one_that_slides_does_not():
    """Velostat gains 3 % in the 0.3 s of a glance."""
    frames = np.full((3, 4, 4), 0.1) + np.random.default_rng(0).normal(0.0, 1e-4, (3, 4, 4))
    frames[:, 1:3, 1:3] += 0.3 * np.array([0.97, 0.985, 1.0])[:, None, None]
    slides = frames.copy()
    slides[2, 1:3, 2] -= 0.1
    given = []
    guide = Guide(Circuit(rows=4, cols=4), lambda s: given.pop(), lambda q: "", lambda t: None)
    guide.rest = SimpleNamespace(
        adc=np.full((4, 4), 0.1), noise=0.1, quiet=lambda frames: np.asarray(frames)
    )
    given += [slides, frames]
    assert guide._new_touch()[0] is not None
    assert "it moves" in guide._new_touch()[1]
