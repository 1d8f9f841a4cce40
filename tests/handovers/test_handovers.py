# SPDX-License-Identifier: Apache-2.0
"""What one part writes, every other part reads: of three boards, in a folder with a space.

A cell of the matrix is a function that reads, or the reason why there is nothing to read.
"""

import contextlib
import functools
import io
import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.strangers.pty_board import PtyBoard

import tactile_skin
from tactile_skin import Circuit, PressureCurve, cli, compensate, forward
from tactile_skin.board.protocol import encode
from tactile_skin.board.recognise.listen import Heard
from tactile_skin.commands import calibrate, detect
from tactile_skin.launch import find, read_plan, read_skin
from tactile_skin.middleware.bus import Parameter
from tactile_skin.middleware.plan import parameters_of
from tactile_skin.middleware.written import own_sections
from tactile_skin.nodes.observers.page_recording import PageRecording
from tactile_skin.nodes.observers.recorder import RecorderNode
from tactile_skin.physics.curve import GRAM
from tactile_skin.recording import Recording, configuration
from tactile_skin.recording.frames import read_frames
from tactile_skin.replay import sources
from tactile_skin.replay.replay import Driven, Replay
from tactile_skin.simulation.matrix import resting_curve
from tactile_skin.touch.take import SUFFIX, load_take
from tactile_skin.view import work
from tactile_skin.view.pictures import Pictures
from tactile_skin.view.recorded import Recorded
from tactile_skin.yaml_files import write_yaml

for library in ("mcap", "websockets"):
    pytest.importorskip(library)

RATE, STEP = 25, 10**9 // 25  # frames a second; ns
START = 1_700_000_000_000_000_000  # ns since 1970
PUSHED = 40.0  # N, for two seconds after three of rest
PORT = "board"  # relative, a link
FEW = ["--pairs", "300", "--validation", "60", "--epochs", "1", "--batch", "50", "--threads", "1"]
BOARDS = {
    "binary 16x16": Circuit(),
    "text 8x8": Circuit(8, 8, r_ref=4700.0),
    "virtual ground": Circuit(10, 6, r_ref=300.0, readout="virtual_ground", r_par=0.0),
}
CONFIG = "calibrated.yaml"
FILES = {"detect": "mine.yaml", "calibrate": CONFIG, "calibrate on the page": "page.yaml"}
RECORDINGS = {
    "record": "touches.mcap",
    "record on the page": "of the page.mcap",
    "record --last": "stop.mcap",
}
EXPORTS = {"export .npz": "export.npz", "export .csv": "export.csv"}
NETWORK, MODEL = {"train": "physics.npz"}, {"gestures": "mine.gestures.npz"}
READERS = "launch", "replay", "doctor", "calibrate", "view", "Python", "open", "ROS"


class Board:
    """What it sends, untouched and touched, and files of it."""

    def __init__(self, name: str, folder: Path):
        self.folder = folder
        folder.mkdir()
        self.circuit, self.binary = BOARDS[name], name.startswith("binary")
        self.fabric = resting_curve(PressureCurve(), self.circuit.shape, seed=4)
        self.rng = np.random.default_rng(1)

    def steps(self, newtons: float, count: int, at: int = 2) -> np.ndarray:
        """(n, rows, cols) ADC steps of a load on 4 x 4 cells."""
        force = np.zeros(self.circuit.shape)
        force[at : at + 4, 1:5] = newtons / 16.0
        steps = forward(self.circuit, self.fabric.resistance(force)) * self.circuit.full_scale
        noisy = steps + self.rng.normal(0.0, 0.5, (count, *steps.shape))
        return np.rint(np.clip(noisy, 0, self.circuit.full_scale))

    def frames(self, after: int = 0) -> list[bytes]:
        loads = (0.0, 3 * RATE), (PUSHED, 2 * RATE), (0.0, after)
        return [self.frame(*k) for k in enumerate(np.concatenate([self.steps(*x) for x in loads]))]

    def frame(self, k: int, steps: np.ndarray) -> bytes:
        if self.binary:
            return encode(k, k * STEP // 1000, steps.astype(int) * 64, 10, 6)
        return (",".join(f"{v:.0f}" for v in steps.ravel()) + "\r\n").encode()


def run(*words) -> str:
    """What a command says; 1: the doctor found something, or a calibration no curve."""
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert cli.main([*map(str, words)]) in (0, 1)
    return said.getvalue()


def detected(board: Board, patch) -> None:
    """By `detect`, which hears a second of the board."""
    circuit = board.circuit
    heard = Heard(b"".join(board.frames()[:RATE]), 1_000_000, shape=circuit.shape)
    patch.setattr(detect, "check_port", lambda port: None)
    patch.setattr(detect, "open_port", lambda *given: contextlib.nullcontext())
    patch.setattr(detect, "listen", lambda *given: heard)
    answers = {"rows": circuit.rows, "cols": circuit.cols, "full_scale": 1023}
    answers |= {name: getattr(circuit, name) for name in ("readout", "r_ref")}
    run("detect", f"port:={PORT}", *(f"{name}:={value}" for name, value in answers.items()))


def calibrated(board: Board, patch) -> None:
    """By `calibrate` with files, and from the page of the running skin, with the same guide."""
    guides, write = [], calibrate.write
    np.save("rest.npy", board.steps(0.0, 3 * RATE))
    for k, grams in enumerate((500, 1200, 3000)):
        np.save(f"{grams}g.npy", board.steps(grams * GRAM, RATE, k))
    patch.setattr(calibrate, "write", lambda *given: (guides.append(given[2]), write(*given)))
    loads = [f"{grams}g:={grams}g.npy" for grams in (500, 1200, 3000)]
    run("calibrate", "--config", "mine.yaml", "rest:=rest.npy", *loads)
    (guide,) = guides
    guide.run = lambda: None
    patch.setattr(work, "Guide", lambda *given, **more: guide)
    patch.setattr(work, "check_sent", lambda *given: None)
    with driven("mine.yaml") as running:
        parameters = parameters_of(running.observer.context)
    page = work.Work(read_skin("mine.yaml"), parameters["/compensation"])
    page._sections, page._read = own_sections(parameters), lambda seconds: None
    page._calibrate_skin()
    Path("page.yaml").write_bytes(page.files[work.CALIBRATED])


@contextlib.contextmanager
def driven(config: str, **arguments):
    """The skin of a launch file on a driven clock; its board is fed by hand."""
    plan = read_plan(find("skin.launch.yaml"), {"config": config, "monitor": "false"} | arguments)
    if "record" in arguments:
        to = [Parameter("path", "stops/"), Parameter("last", 5.0)]
        plan.add(replace(plan.nodes[-1], name="last", parameters=to))
    running = Driven(plan, START)
    driver = running.nodes["serial_driver"]
    driver._starter.cancel()
    driver._reader._found(driver._reader.port)
    try:
        yield running
    finally:
        running.close()


def feed(running: Driven, frames: list[bytes]) -> None:
    driver = running.nodes["serial_driver"]
    for k, data in enumerate(frames):
        running.until(START + k * STEP)
        for frame in driver._reader.parser.feed(data):
            driver.on_frame(frame)
        running.run()


def recorded(board: Board) -> None:
    """By the recorder, all and before a stop, and by the page."""
    with driven(CONFIG, record="touches.mcap") as running:
        recorders = [node for node in running._skin._nodes if isinstance(node, RecorderNode)]
        page = PageRecording(running.observer, "")
        assert page.ask("record")[0]
        for recorder in recorders:
            recorder.begin()
        feed(running, board.frames(after=5 * RATE // 2))
        assert page.ask("finish")[0]
        for recorder in recorders:
            recorder.close()
            recorder.finish()
        Path(page.take()).rename("of the page.mcap")
    (stop,) = Path("stops").iterdir()
    stop.rename("stop.mcap")
    run("replay", "touches.mcap", "--export", "export.npz")
    run("replay", "touches.mcap", "--export", "export.csv")
    run("gestures", "record", "press", "touches.mcap")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Name of a board -> the board, with all that is written of it in its folder."""
    with contextlib.ExitStack() as stack:

        @functools.cache
        def make(name: str) -> Board:
            board = Board(name, tmp_path_factory.mktemp("x") / "my skins")
            frames = board.frames()
            served = PtyBoard(lambda k: frames[k % len(frames)], RATE)
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(board.folder)
                Path(PORT).symlink_to(stack.enter_context(served).port)
                detected(board, patch)
                calibrated(board, patch)
                recorded(board)
            return board

        yield make


# --- who reads it ---


def launched(board: Board, name: str) -> None:
    """The nodes have what was found of the board, and take its frames."""
    with driven(name) as running:
        nodes = running.nodes
        assert nodes["compensation"].skin.circuit.shape == board.circuit.shape
        assert nodes["serial_driver"]._reader.port.endswith(f"my skins/{PORT}")
        stop = nodes["stop_on_push"]
        limits = stop.policy.config.debounce, stop.policy.config.lead
        assert limits == ((0.0, 0.01) if board.binary else (0.01, 0.0))
        feed(running, board.frames())
        assert stop._force == pytest.approx(PUSHED, rel=0.15) and running.errors == 0


def replayed(board: Board, name: str, **more) -> None:
    replay = Replay(Recording(name), end=START + 4 * 10**9, **more)
    steps = list(replay)
    assert replay.driven.errors == 0 and replay.notes == []
    assert max(step.total for step in steps) == pytest.approx(PUSHED, rel=0.15)
    assert any(step.stop.startswith("push: ") for step in steps)


def replayed_by(board: Board, name: str) -> None:
    replayed(board, "touches.mcap", config=name)


def replayed_frames(board: Board, name: str) -> None:
    said = run("replay", name, f"config:={CONFIG}")
    assert re.search(r"force +up to (3[5-9]|4\d)\.\d N in total", said) and "stops     1" in said


def doctored(board: Board, name: str) -> None:
    said = run("doctor", name, *[f"config:={CONFIG}"] * (name in EXPORTS.values()))
    assert "frames of {} x {}".format(*board.circuit.shape) in said


def doctored_live(board: Board, name: str) -> None:
    """Which reads the board as calibrate does."""
    with contextlib.closing(sources.Live(name, {})) as live:
        assert live(0.1).shape[1:] == board.circuit.shape


def calibrated_again(board: Board, name: str) -> None:
    said = run("calibrate", "--config", name, "--out", f"2 {name}", "rest:=rest.npy")
    assert f"'config:=2 {name}'" in said
    assert read_skin(f"2 {name}").circuit == read_skin(name).circuit


def calibrated_from(board: Board, name: str) -> None:
    """By the touch of a file."""
    with contextlib.redirect_stdout(None):
        frames, times = sources.Recorded(read_skin(CONFIG).adc, None).stream(name)
    assert len(frames) == len(times) and np.diff(times).mean() == pytest.approx(1.0 / RATE)
    hardest = compensate(frames.max(0), *read_skin(CONFIG)[:2]).force.sum()
    assert hardest == pytest.approx(PUSHED, rel=0.2)


def drawn(board: Board, name: str) -> None:
    assert Pictures(read_skin(name)).hello()["rows"] == board.circuit.rows


def shown(board: Board, name: str) -> None:
    found = Recorded(Recording(name))
    assert found.shape == board.circuit.shape
    assert max(found.hello()["history"]["force"]) == pytest.approx(PUSHED, rel=0.15)


def read(board: Board, name: str) -> None:
    assert read_skin(name).circuit == read_skin("mine.yaml").circuit


def read_recording(board: Board, name: str) -> None:
    assert Recording(name).skin.circuit == read_skin(CONFIG).circuit
    assert Recording(name).node_parameters("serial_driver")["port"].endswith(PORT)
    assert read_frames(name).values.shape[1:] == board.circuit.shape


def read_export(board: Board, name: str) -> None:
    found, skin = read_frames(name, board.circuit), read_skin(CONFIG)
    np.testing.assert_allclose(found.ratio(skin.adc), Recording("touches.mcap").adc / 65472, 1e-3)


def opened(board: Board, name: str) -> None:
    with tactile_skin.open(PORT, name) as skin:
        assert skin.read()[1].shape == board.circuit.shape


def of_config(section: str, **values) -> str:
    """A parameter file that names what was made."""
    text = Path(CONFIG).read_text() + write_yaml({section: {"ros__parameters": values}})
    Path("with.yaml").write_text(text)
    return "with.yaml"


def trained(name: str) -> str:
    """The parameter file of a network, which is made once."""
    if not Path(name).exists():
        run("train", "--config", CONFIG, "--network", "physics", "--out", ".", *FEW)
    return of_config("/**/compensation", weights=name, method="physics")


def launched_network(board: Board, name: str) -> None:
    with driven(trained(name)) as running:
        feed(running, board.frames())
        assert running.nodes["compensation"].skin.taken["physics"] > RATE and not running.errors
        attached = configuration.attachments(parameters_of(running.observer.context))
    assert attached[name] == Path(name).read_bytes()


def replayed_network(board: Board, name: str) -> None:
    """By a recording that brings it along."""
    replay = Replay(Recording("touches.mcap"), config=trained(name), end=START + 2 * 10**9)
    replay.record("with.mcap")
    list(replay)
    path = Path("with.mcap").absolute()
    with contextlib.chdir("/"):
        assert len(list(Replay(Recording(path)))) > RATE


def read_network(board: Board, name: str) -> None:
    skin = read_skin(trained(name))
    adc = skin.adc.ratio(board.steps(PUSHED, 1)[0])
    assert compensate(adc, skin.circuit, skin.curve, "physics", weights=name).force.sum() > 0.0


def launched_model(board: Board, name: str) -> None:
    """Trained from what was recorded, in another's name as well."""
    (path,) = Path("takes").iterdir()
    take = load_take(path)
    for label, person in itertools.product(("press", "poke"), "abc"):
        take._replace(label=label, person=person).save(f"takes/{label}{person}{SUFFIX}")
    run("gestures", "train", "takes", "--alone", "--out", name)
    with driven(of_config("/**/gestures", model=name), gestures="true") as running:
        feed(running, board.frames())
        assert running.errors == 0


BOARD = "reads a board, by a parameter file"
OF_ROS = "tests/test_ros_*.py: ROS's own reader, with rclpy"
AUTO, NONE = "solves by `auto` or `map`", "names no gestures"
PLAYS, OTHERS = "ros2 bag plays any MCAP", "is of programs that know nothing of ROS"
MADE = "replay --out makes a recording of it"
CELLS = [  # what is written; of each of READERS, how it reads that, or why there is nothing to read
    (FILES, launched, replayed_by, doctored_live, calibrated_again, drawn, read, opened, OF_ROS),
    (RECORDINGS, BOARD, replayed, doctored, calibrated_from, shown, read_recording, BOARD, PLAYS),
    (EXPORTS, BOARD, replayed_frames, doctored, calibrated_from, MADE, read_export, BOARD, OTHERS),
    (NETWORK, launched_network, replayed_network, AUTO, AUTO, AUTO, read_network, AUTO, OF_ROS),
    (MODEL, launched_model, NONE, NONE, NONE, NONE, NONE, NONE, OF_ROS),
]
CORE = "detect", "calibrate on the page", "record on the page", "export .npz"  # of one board


def cells():
    """Of networks and models a board whose size is not that of the shipped ones."""
    for written, *readers in CELLS:
        cells = itertools.product(written.items(), zip(READERS, readers, strict=True))
        for (writer, name), (reader, how) in cells:
            for board in ("text 8x8",) if written in (NETWORK, MODEL) else BOARDS:
                core = board == "text 8x8" and writer in CORE
                what, marks = f"{writer} to {reader}, {board}", () if core else pytest.mark.ci
                if callable(how):
                    yield pytest.param(board, name, how, id=what, marks=marks)


@pytest.mark.parametrize(("board", "name", "how"), [*cells()])
def test_what_one_writes_the_other_reads(made, monkeypatch, board, name, how):
    board = made(board)
    monkeypatch.chdir(board.folder)
    how(board, name)
