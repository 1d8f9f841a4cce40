# SPDX-License-Identifier: Apache-2.0
"""Detect, calibration and doctor from the page in Chromium, on a board that nobody knows."""

import threading

import numpy as np
import pytest

pytest.importorskip("websockets", reason="serves the page")

from support import chromium
from support.chromium import Chromium, until
from support.lab.unknown import Unknown
from support.page import served
from support.strangers import boards
from support.strangers.pty_board import PtyBoard
from support.weights import bodies

from tactile_skin import compensate
from tactile_skin.calibration.rest import measure_rest
from tactile_skin.guide import calibration as guide
from tactile_skin.launch import launch
from tactile_skin.middleware.config import read_skin, skin_of
from tactile_skin.nodes.observers.view import View
from tactile_skin.physics.curve import GRAM
from tactile_skin.view import work as working
from tactile_skin.view.snapshot import NodeStatus, Snapshot
from tactile_skin.view.work import CALIBRATED, DETECTED, Work

pytestmark = pytest.mark.live

if chromium.program() is None:
    pytest.skip("no Chromium here: apt-get install chromium", allow_module_level=True)

SHAPE = 12, 12
WEIGHTS = 3.0, 8.0, 17.0, 30.0, 5.0, 44.0, 12.0, 23.0  # N
FRAME = 0.002  # s between two readings
STANDS = 90  # readings for which a touch stands
SAID = "document.getElementById('work').innerText"
FAST = {"REST": 0.4, "OBJECT": 0.3, "_GLANCE": 0.1, "_COUNTED": 0.05, "PATIENCE": 5.0}
GIVEN = {"circuit.rows": 12, "circuit.cols": 12, "geometry.shape": "plane", "port": 8321}
CHANGE = """(() => { const form = document.getElementById('question');
form.elements.text.value = '%s'; form.requestSubmit(); })()"""


class Hands:
    """Hands over a board: they press here and there, or lay things on it; `force` on each cell.

    They press while the skin's readings are handed to the work, or the board prints.
    """

    def __init__(self, board, work):
        self.board, self._work, self._k = board, work, 0
        self._none = np.zeros(SHAPE)
        self.force, self.pressing = self._none, False
        self._touches = bodies(60, SHAPE, np.random.default_rng(5))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def off(self):
        self.force, self.pressing = self._none, False

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()

    def _read(self):
        """(rows, cols) ADC ratio of the next frame."""
        self._k += 1
        if self.pressing and self._k % STANDS == 0:
            self.force = self._touches[self._k // STANDS % len(self._touches)]
        return self.board.frames([self.force])[0]

    def prints(self, k) -> bytes:
        """The next line of text."""
        steps = np.rint(self._read() * self.board.supposed.full_scale).astype(int)
        return boards.sent(boards.frame_a_line, [steps], k)

    def _run(self):
        full = 64 * self.board.supposed.full_scale
        while not self._ended.wait(FRAME):
            adc = np.rint(self._read() * full).astype(np.uint16)
            self._work.take(Snapshot(stamp=float(self._k), adc=adc))


@pytest.fixture
def fast(monkeypatch):
    for name, seconds in FAST.items():
        monkeypatch.setattr(guide, name, seconds)
    monkeypatch.setattr(working, "_POLL", 0.01)
    monkeypatch.setattr(working, "SECONDS", 1.0)


@pytest.fixture
def newcomer(tmp_path, fast):
    """A browser, hands, and the work of the page that it shows."""
    skin = skin_of({k: v for k, v in GIVEN.items() if "." in k}, "")
    work, board = Work(skin, GIVEN), Unknown(SHAPE, seed=21)
    still = [Snapshot(stamp=1.0, adc=np.full(SHAPE, 9000, np.uint16))]
    with (
        Chromium(tmp_path / "profile", 1400, 900) as browser,
        served(skin, still, controls=True, work=work) as (address, _),
        Hands(board, work) as hands,
    ):
        browser.open(address)
        yield browser, hands, work
        assert browser.errors == []


def answer(browser, text="", to=""):
    """Answer a question that holds some words."""
    question = "document.querySelector('#question p').innerText"
    browser.until(f"!document.getElementById('question').hidden && {question}.includes('{to}')")
    browser.run(CHANGE % text)


@pytest.mark.ci
def test_a_board_that_no_configuration_describes_is_detected_and_calibrated(tmp_path, fast):
    """It prints 12 x 12 numbers; the skin was launched for 16 x 16 in binary frames."""
    skin, board = skin_of({}, ""), Unknown(SHAPE, seed=21)
    work, printed = Work(skin, {}), Hands(board, None)
    with (
        Chromium(tmp_path / "profile", 1400, 900) as browser,
        PtyBoard(printed.prints, 1 / FRAME) as line,
    ):
        nodes = {"serial_driver": NodeStatus(2, "no frame", {"port": line.port})}
        work.take(Snapshot(nodes=nodes))
        with served(skin, [Snapshot(nodes=nodes)], controls=True, work=work) as (address, source):
            browser.open(address)
            browser.click("button", "detect")
            detected(browser)
            assert source.asked == ["lend"]
            answer(browser, to="Go on to calibrate")
            calibrated(browser, printed, tmp_path)
            until(lambda: work.state()["task"] == "", "the board is given back")
            assert browser.errors == []
    text = (tmp_path / "mine.yaml").read_text()
    assert "protocol: text" in text and "baud: 115200" in text


def detected(browser):
    """Answer what no byte shows; the second answer is none at first."""
    answer(browser, "12 x 12", to="rows x columns of its 144 cells")
    answer(browser, "floatin", to="wiring")
    browser.until(f"{SAID}.includes(\"wiring 'floatin': must be one of floating\")")
    answer(browser, "floating", to="wiring")
    assert not browser.found("button", "a step back")
    answer(browser, "1780", to="reference resistor")
    answer(browser, "1023", to="what an input at the supply prints")
    until(lambda: browser.found("link", f"download {DETECTED[1:]}"), "a file to download")
    browser.until(f"/12 x 12 cells at 10 bits, floating/.test({SAID})")
    assert "a second (sure)" in browser.run(SAID)


@pytest.mark.ci
def test_a_running_skin_lends_its_board_and_takes_it_back(tmp_path, fast):
    """A reload loses no step; the robot stands until the board is given back."""
    stop = "document.querySelector('#stop strong').textContent"
    cell = "document.getElementById('cell').innerText"
    with (
        Chromium(tmp_path / "profile", 1400, 900) as browser,
        PtyBoard(Hands(Unknown(SHAPE, seed=21), None).prints, 50.0) as line,
        launch(
            "skin.launch.yaml",
            port=line.port,
            monitor="false",
            view="true",
            view_port="0",
            view_controls="true",
        ) as skin,
    ):
        view = next(node for node in skin._nodes if isinstance(node, View))
        browser.open(view._page.address)
        browser.until(f"{stop}.includes('text arrives')")
        browser.click("button", "detect")
        detected(browser)
        answer_is_awaited = "document.querySelector('#question p').innerText.includes('Go on to')"
        browser.until(answer_is_awaited)
        browser.call("Page.reload")
        browser.until(f"document.getElementById('question') && {answer_is_awaited}")
        browser.until(f"{stop}.includes('is lent to another program')")
        browser.run("document.getElementById('a').focus()")
        for _ in range(20):
            browser.press("ArrowDown")
        browser.until(f"/^row 11, column 6: pressure [\\d.]+/.test({cell})")
        browser.click("button", "give up")
        browser.until(f"{stop}.includes('text arrives')")
        browser.press("ArrowUp")
        assert browser.errors == []


def calibrated(browser, hands, folder):
    """Go through the steps on the unknown board, and find its newtons right to 5 %."""
    hands.off()
    answer(browser, to="1 of 3")
    browser.until(f"{SAID}.includes('2 of 3')")
    hands.pressing = True
    browser.until("document.querySelector('#question p').innerText.includes('on to the weights')")
    hands.off()
    answer(browser)
    things = bodies(len(WEIGHTS), SHAPE, np.random.default_rng(7))
    for k, (thing, weight) in enumerate(zip(things, WEIGHTS, strict=True), 1):
        browser.until(f"document.querySelector('#question p').innerText.includes('object {k}:')")
        hands.force = thing * (weight / thing.sum())
        answer(browser, f"{weight / GRAM:.0f} g", f"object {k}:")
        if k > guide.LEAST_OBJECTS:
            browser.until("!document.getElementById('curve').hidden")  # as it forms
    answer(browser, to=f"object {len(WEIGHTS) + 1}:")
    answer(browser, to="Creep, if you like")
    until(lambda: browser.found("link", "download calibrated.yaml"), "a file to download")
    browser.until("!document.getElementById('curve').hidden")
    text = browser.run(f"fetch('{CALIBRATED}').then(answer => answer.text())")
    (folder / "mine.yaml").write_text(text)
    skin = read_skin(folder / "mine.yaml")
    assert skin.circuit.shape == SHAPE
    off, at_rest = [], 1.0 / measure_rest(_rest(hands.board), skin.circuit).conductance
    for force in bodies(12, SHAPE, np.random.default_rng(99)):
        force = force * (20.0 / force.sum())
        curve = skin.curve.resting_at(at_rest)
        found = compensate(hands.board.frames([force])[0], skin.circuit, curve, "map")
        off.append(found.force.sum() / 20.0 - 1.0)
    assert np.median(np.abs(off)) < 0.05


def _rest(board):
    return board.frames([np.zeros(SHAPE)] * 50)


@pytest.mark.ci
def test_the_doctor_is_given_up_and_asked_again(newcomer):
    browser, _, work = newcomer
    browser.click("button", "doctor")
    answer_is_awaited = "!document.getElementById('question').hidden"
    browser.until(answer_is_awaited)
    assert work.state()["left"] > 30, "the minute is counted down"
    with pytest.raises(ValueError, match="doctor is at work"):
        work.ask("calibrate", "")
    browser.click("button", "give up")
    browser.until(f"{SAID}.includes('given up')")
    browser.click("button", "doctor")
    browser.until(answer_is_awaited)
    until(lambda: len(work._frames) > 100, "readings of a skin that nobody touches")
    browser.click("button", "go on")
    browser.until("document.getElementById('leave').textContent === 'close'")
    said = browser.run(SAID)
    assert "readings: looking" in said and work.state()["task"] == ""
    assert "0 touches were seen" in said, said


@pytest.mark.ci
def test_lines_that_the_doctor_finds_are_drawn_on_the_mat(newcomer):
    browser, hands, work = newcomer
    frames = hands.board.frames

    def broken(forces):
        read = frames(forces)
        read[..., 5] = 2e-4  # an open column reads next to nothing
        return read

    hands.board.frames = broken
    browser.click("button", "doctor")
    browser.until("!document.getElementById('question').hidden")
    until(lambda: len(work._frames) > 6 * STANDS, "readings at rest, a third of all")
    hands.pressing = True
    until(lambda: len(work._frames) > 18 * STANDS, "a dozen touches")
    browser.click("button", "go on")
    browser.until("document.getElementById('leave').textContent === 'close'")
    assert any(found["cols"] == [5] for found in work.state()["findings"]), work.state()["lines"]
    pink = """(() => { const c = document.querySelector('#a .picture canvas');
    const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let n = 0;
    for (let k = 0; k < d.length; k += 4) n += d[k] === 209 && d[k + 1] === 0 && d[k + 2] === 93;
    return n; })()"""
    browser.until(f"{pink} > 200")


def test_nothing_is_answered_that_was_not_asked():
    work = Work(skin_of({}, ""), {})
    with pytest.raises(ValueError, match="nothing is asked"):
        work.ask("answer", "b")


def test_readings_that_a_sketch_has_processed_are_not_calibrated(monkeypatch):
    """As in the terminal: the mean of the untouched skin was taken off them."""
    monkeypatch.setattr(working, "GLANCE", 0.1)
    skin, board = skin_of({k: v for k, v in GIVEN.items() if "." in k}, ""), Unknown(SHAPE, seed=21)
    work, rest = Work(skin, GIVEN), board.at_rest()
    taken_off = np.rint(np.clip((rest - rest.mean(0)) * 1023.0 * 8.0, 0.0, 1023.0) * 64.0)
    work.ask("calibrate", "")
    stamps = iter(range(10**6))

    def ended():
        for adc in taken_off.astype(np.uint16):
            work.take(Snapshot(stamp=float(next(stamps)), adc=adc))
        return not work.state()["task"]

    until(ended, "the calibration ends")
    assert "these are not ADC readings" in work.state()["lines"][-1]
