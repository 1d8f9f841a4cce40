# SPDX-License-Identifier: Apache-2.0
"""What records a skin hands over to what reads recordings: each with each, of three boards."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.launch import find, read_plan
from tactile_skin.msg import Header, Image, Time, image
from tactile_skin.nodes.observers.page_recording import PageRecording
from tactile_skin.recording import Recording, cdr, configuration
from tactile_skin.recording.frames import read_frames
from tactile_skin.recording.writer import Writer
from tactile_skin.replay.replay import Driven, Replay
from tactile_skin.simulation.matrix import resting_curve
from tactile_skin.yaml_files import write_yaml

pytest.importorskip("mcap")
START = 1_700_000_000_000_000_000  # ns since 1970
RATE = 50
PUSHED = 40.0  # N, from the third second on
BOARDS = {
    "binary 16x16": {"rows": 16, "cols": 16},
    "8x8": {"rows": 8, "cols": 8, "r_ref": 4700.0, "r_par": 120.0},
    "virtual ground": {"rows": 10, "cols": 6, "readout": "virtual_ground", "r_ref": 300.0},
}


def by_the_page(driven: Driven) -> dict[str, dict]:
    return PageRecording(driven.observer, "").parameters()


def by_the_recorder(driven: Driven) -> dict[str, dict]:
    return driven.parameters


@pytest.fixture(params=[by_the_page, by_the_recorder], ids=lambda f: f.__name__)
def recorded(request, tmp_path, board):
    """A recording of a running skin, in a folder with a space in its name."""
    folder = tmp_path / "my skins"
    folder.mkdir()
    (folder / "mine.yaml").write_text(
        write_yaml(
            {
                "/**": {"ros__parameters": {"circuit": board}},
                "/**/stop_on_push": {"ros__parameters": {"threshold": 25.0, "debounce": 0.01}},
            }
        )
    )
    arguments = {"config": str(folder / "mine.yaml"), "port": "loop://", "monitor": "false"}
    driven = Driven(read_plan(find("skin.launch.yaml"), arguments), START)
    attached = configuration.attachments(request.param(driven))
    driven.close()
    circuit = Circuit(**board)
    fabric = resting_curve(PressureCurve(), circuit.shape, seed=4)
    writer, rng = Writer(folder / "a.mcap", attached, START), np.random.default_rng(1)
    for k in range(4 * RATE):
        push = np.zeros(circuit.shape)
        push[3:7, 1:5] = PUSHED / 16.0 if k >= 3 * RATE else 0.0
        steps = forward(circuit, fabric.resistance(push)) * 1023
        samples = np.rint(64 * np.clip(steps + rng.normal(0.0, 0.5, steps.shape), 0, 1023))
        stamp = START + k * 10**9 // RATE
        message = image(samples.astype("u2"), "16UC1", Header(Time(*divmod(stamp, 10**9)), "base"))
        writer.write("/skin/adc", Image, stamp, cdr.encode(message))
    writer.close()
    return folder / "a.mcap"


@pytest.fixture(params=BOARDS.values(), ids=BOARDS)
def board(request):
    return request.param


def test_replay_feels_the_push_and_has_the_limits(recorded):
    replay = Replay(Recording(recorded))
    steps = list(replay)
    assert replay.driven.errors == 0 and replay.notes == []
    assert steps[-1].total == pytest.approx(PUSHED, rel=0.15)
    assert steps[-1].stop.startswith("push: ") and steps[140].stop == ""
    assert replay.driven.nodes["stop_on_push"].policy.config.threshold == 25.0


def test_frames_and_skin_are_read_with_the_circuit(recorded, board):
    found = Recording(recorded)
    assert found.skin.circuit.shape == (board["rows"], board["cols"])
    assert read_frames(recorded).values.shape == (4 * RATE, *found.skin.circuit.shape)
    assert found.node_parameters("serial_driver")["port"] == "loop://"
