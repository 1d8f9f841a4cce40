# SPDX-License-Identifier: Apache-2.0
"""Newtons of a running skin over what `calibrate` promised, on unknown boards.

Boards of 8 x 8 to 16 x 16 cells: r_ref of 1.78 to 10 kohm, so that hard touches read near the end
of the converter; r_par of 200 to 500 ohm, configured as 326; stripes, scatter, all that a
fabric does in time (`simulation/living.py`), up to 12
noisy cells. The guide of `calibrate` is led by a script, and its file is written. The compensation
node
runs with that file on a driven clock: 3 s of rest, 30 touches, then new objects of 3 to 50 N. With
--presses light, the person's touches before tell nothing of r_par. The real command on a terminal:
`calibrate.py`.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.lab.unknown import Unknown
from support.weights import bodies, objects

from tactile_skin.commands import calibrate
from tactile_skin.guide.calibration import OBJECTS, Guide
from tactile_skin.middleware.bus import Context, ManualClock, Node
from tactile_skin.middleware.config import read_skin
from tactile_skin.middleware.parameter_file import ParameterFile
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation.living import Habits, Living

from .. import harness

SIZES = (8, 8), (12, 8), (12, 12), (16, 16)
R_REF = 1780.0, 3300.0, 4700.0, 10000.0  # ohm
R_PAR = 200.0, 500.0  # ohm
SCATTER = 0.05, 0.15
NOISY, LOUD = 12, (3.0, 12.0)  # cells, and times the usual noise that they have
SCANS = 4  # that a frame is the mean of
STOOD = 0.5, 10.0  # s that an object has stood
COMES, PAUSED = 0.2, 3.0  # s in which it comes, in steps, and between two
TOUCHES, NEW = 30, 15
LIGHT = 0.03  # times the force of a usual touch
RATE = 25.0  # frames a second
REST, HELD, PAUSE = 3.0, 0.8, 0.8  # s
LIMIT = 1.5  # times what was promised


class Board(Unknown):
    """One that nobody here made; its fabric does what real ones do, some cells are noisy."""

    def __init__(self, seed: int):
        rng = np.random.default_rng([seed, 6])
        shape = SIZES[rng.integers(len(SIZES))]
        super().__init__(shape, seed, scatter=rng.uniform(*SCATTER))
        self.supposed = replace(self.supposed, r_ref=rng.choice(R_REF))
        self.r_par = rng.uniform(*R_PAR)
        self.matrix.circuit = replace(self.supposed, r_par=self.r_par)
        self.living, self._t = Living(Habits.real(rng), shape, rng), 0.0
        most = min(NOISY, max(3, shape[0] * shape[1] // 20))
        self._loud = np.ones(shape)
        noisy = rng.choice(self._loud.size, rng.integers(most + 1), replace=False)
        self._loud.flat[noisy] = rng.uniform(*LOUD, noisy.size)
        self._stood = rng

    def load(self, force) -> None:
        """(rows, cols) [N] from now on."""
        stood = np.exp(self._stood.uniform(*np.log(STOOD)))
        self._t += PAUSED
        for share in (0.0, 0.3, 0.6, 1.0):
            self._t += COMES / 4.0
            self.living.factor(self._t, share * force, self.matrix.fabric)
        self._t += stood
        self.ratio = self.expose(force, self.living.factor(self._t, force, self.matrix.fabric))

    def read(self, n: int) -> np.ndarray:
        """(n, rows, cols) ADC ratio."""
        full = self.supposed.full_scale
        noise = self._loud * self._rng.standard_normal((n, SCANS, *self.ratio.shape))
        return np.clip(np.rint(self.ratio * full + noise), 0.0, full).mean(1) / full


def calibrated(board: Board, seed: int, path: Path, light: bool) -> Guide:
    """What a person who does as he is told finds, written to a file."""
    shape = board.supposed.shape
    touches = iter(bodies(400, shape, np.random.default_rng([seed, 2])))
    things, weights = objects(OBJECTS, shape, np.random.default_rng([seed, 3]))
    laid, pressing, looks = iter(zip(things, weights, strict=True)), False, 0

    def ask(text: str) -> str:
        nonlocal pressing
        board.load(np.zeros(shape))
        pressing = False
        if "its weight" not in text or (thing := next(laid, None)) is None:
            return ""
        board.load(thing[0])
        return f"{thing[1] / GRAM:.0f} g"

    def say(text: str) -> None:
        nonlocal pressing
        pressing = pressing or "2 of 3" in text

    def frames(seconds: float) -> np.ndarray:
        nonlocal looks
        looks += 1
        if pressing and looks % 2:
            board.load(next(touches) * (LIGHT if light else 1.0))
        return board.read(max(2, round(RATE * seconds)))

    board.load(np.zeros(shape))
    guide = Guide(board.supposed, frames, ask, say)
    guide.run()
    circuit = board.supposed
    known = path.with_name("known.yaml")
    known.write_text(
        "/**:\n  ros__parameters:\n    circuit: "
        f"{{rows: {circuit.rows}, cols: {circuit.cols}, r_ref: {circuit.r_ref}}}\n"
    )
    calibrate.write(path, known, guide, read_skin(known))
    return guide


class Running:
    """The skin of a compensation node with a file, on a driven clock."""

    def __init__(self, path: Path, board: Board):
        overrides = ParameterFile(path).overrides("/compensation")
        node = Node("compensation", context=Context(ManualClock()), parameter_overrides=overrides)
        self.skin, self._board = Compensation(node).skin, board
        self.felt, self.stopped, self.frames = 0.0, 0, 0

    def play(self, force, seconds: float) -> None:
        """Some time with (rows, cols) [N] on the skin."""
        self._board.load(force)
        scale = self._board.supposed.full_scale * 2.0 ** (16 - self._board.supposed.adc_bits)
        for adc in self._board.read(round(seconds * RATE)):
            self.frames += 1
            found = self.skin.frame(self.frames / RATE, np.rint(adc * scale).astype(np.uint16))
            self.felt = np.nan if found is None else float(found.sum())
            self.stopped += self.skin.fault


def run(seed: int, path: Path, light: bool = False):
    """Guide, (NEW,) relative errors of new objects, and the running skin, of one board."""
    board = Board(seed)
    guide = calibrated(board, seed, path, light)
    shape = board.supposed.shape
    skin, nothing = Running(path, board), np.zeros(shape)
    skin.play(nothing, REST)
    for force in bodies(TOUCHES, shape, np.random.default_rng([seed, 4])):
        skin.play(force, HELD)
        skin.play(nothing, PAUSE)
    new, truth = objects(NEW, shape, np.random.default_rng([seed, 5]))
    off = []
    for force, weight in zip(new, truth, strict=True):
        skin.play(force, HELD)
        off.append(skin.felt / weight - 1.0)
        skin.play(nothing, PAUSE)
    return board, guide, np.array(off), skin


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=20)
    parser.add_argument("--seed", type=int, default=70000, help="of the first board")
    parser.add_argument("--presses", choices=("light", "hard"), default="hard")
    args = parser.parse_args(arguments)
    ratios = []
    for seed in range(args.seed, args.seed + args.boards):
        with tempfile.TemporaryDirectory() as name:
            try:
                board, guide, off, skin = run(
                    seed, Path(name) / "mine.yaml", args.presses == "light"
                )
            except ValueError as error:
                print(f"{seed}: {error}", flush=True)
                continue
        promised = guide.fitted.error if guide.fitted else np.nan
        ratios.append(np.median(np.abs(off)) / promised)
        circuit = board.supposed
        print(
            f"{seed}: {circuit.rows} x {circuit.cols}, r_ref {circuit.r_ref:g}, r_par "
            f"{board.r_par:.0f}, found {guide.circuit.r_par:.0f}, running "
            f"{skin.skin.circuit.r_par:.0f}; promised {promised:.1%}, median "
            f"{np.median(np.abs(off)):.1%} ({np.median(off):+.1%}), {ratios[-1]:.2f} times; "
            f"fault {skin.stopped / skin.frames:.0%}",
            flush=True,
        )
    good = np.count_nonzero(np.array(ratios) <= LIMIT)
    print(f"at most {LIMIT} times what was promised: {good} of {len(ratios)} boards")
    return {"error over promised": ratios}


if __name__ == "__main__":
    harness.run(main)
