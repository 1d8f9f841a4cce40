# SPDX-License-Identifier: Apache-2.0
"""`calibrate` of boards that are not read as floating matrices, from recorded text lines."""

import numpy as np
import pytest
from support.lab.board import FaultBoard
from support.marks import ci
from support.weights import bodies, objects

from tactile_skin import Circuit, PressureCurve, cli, compensate
from tactile_skin.calibration.rest import measure_rest
from tactile_skin.launch import read_skin
from tactile_skin.physics.curve import GRAM

SHAPE, FULL = (8, 8), 1023.0


class Drawer:
    """A board, and a folder with what was recorded of it: rest, touches, objects.

    Attributes:
        words: of the command line.
    """

    def __init__(self, folder, readout: str, seed: int):
        self.folder, self.rng = folder, np.random.default_rng(seed)
        drive = (
            {"r_drive": 40.0} if readout == "grounded" else {}
        )  # of which the file knows nothing
        circuit = Circuit(
            *SHAPE, r_ref=10e3, r_par=25.0, readout=readout, driven="columns", **drive
        )
        force, resistance = np.array(PressureCurve().points).T
        self.board = FaultBoard(circuit, PressureCurve(force, 1.3 * resistance), self.rng)
        self.words = ["rate:=12", self.save("rest", [np.zeros(SHAPE)] * 60)]
        pressed = [[f * 0.0] * 12 + [f] * 12 for f in bodies(10, SHAPE, self.rng)]
        self.words.append(self.save("touches", np.concatenate(pressed)))
        for force, weight in zip(*objects(6, SHAPE, self.rng), strict=True):
            self.words.append(self.save(f"{weight / GRAM:.0f}g", [force] * 20))

    def read(self, force) -> np.ndarray:
        """(n, rows, cols) ADC steps under forces (n, rows, cols) [N]."""
        steps = self.board.ratio(np.array(force)) * FULL
        steps += 0.5 * self.rng.standard_normal(steps.shape)
        return np.clip(np.rint(steps), 0.0, FULL)

    def save(self, name: str, force) -> str:
        path = self.folder / f"{name}.csv"
        np.savetxt(path, self.read(force).reshape(len(force), -1), "%d", ",")
        return f"{name}:={path}"

    def calibrate(self, readout: str, words, r_par=25.0) -> int:
        config = self.folder / "mine.yaml"
        config.write_text(
            "/**: {ros__parameters: {circuit: {rows: 8, cols: 8, r_ref: 10000.0, "
            f"r_par: {r_par}, readout: {readout}, driven: columns}}}}}}\n"
        )
        out = str(self.folder / "out.yaml")
        return cli.main(["calibrate", "--config", str(config), "--out", out, *words])


@pytest.fixture(scope="module", params=["loaded", ci("grounded")])
def drawer(request, tmp_path_factory):
    return Drawer(tmp_path_factory.mktemp(request.param), request.param, seed=41)


def test_the_file_gives_newtons(drawer, capsys):
    """New objects within 10 % in the median; what lies in series was unknown."""
    readout = drawer.board.circuit.readout
    assert drawer.calibrate(readout, drawer.words, r_par=326.0) == 0
    assert ("r_line is taken as 0" in capsys.readouterr().out) == (readout == "loaded")
    skin = read_skin(drawer.folder / "out.yaml")
    assert skin.circuit.readout == readout
    assert skin.circuit.r_drive == pytest.approx(drawer.board.circuit.r_drive, abs=5.0)
    # grounded, it is what is left of the sum with r_ref
    assert skin.circuit.r_par == pytest.approx(25.0, abs=10.0 if readout == "loaded" else 60.0)
    rest = measure_rest(drawer.read([np.zeros(SHAPE)] * 60) / FULL, skin.circuit)
    curve = skin.curve.resting_at(1.0 / rest.conductance)
    off = []
    for force, weight in zip(*objects(12, SHAPE, drawer.rng), strict=True):
        frame = drawer.read([force] * 4).mean(0) / FULL
        off.append(compensate(frame, skin.circuit, curve, "map").force.sum() / weight - 1.0)
    assert np.median(np.abs(off)) < 0.1


@pytest.mark.parametrize("touched", [True, False], ids=["touches", "objects"])
def test_a_wrong_readout_is_named_before_the_weights_are_used(drawer, capsys, touched):
    """By five touches; without any, by the first three objects."""
    words = [w for w in drawer.words if touched or not w.startswith("touches")]
    assert drawer.calibrate("floating", words) == 2
    said = capsys.readouterr()
    assert f"Set circuit.readout: {drawer.board.circuit.readout}" in said.err
    assert "felt:" not in said.out and len(said.err.splitlines()) == 1
