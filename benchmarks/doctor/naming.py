# SPDX-License-Identifier: Apache-2.0
"""How often a noisy cell, a bad contact or an absent crossing is named by row and column.

All nodes on a driven clock, everyday touches, boards that the solver does not know: cells scatter
by 8 %, at rest by 3 %, 1 step of noise, 0.5 % lateral. Half of the faults are there from the start.
"""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
from support.chain import Chain
from support.lab.board import KNOTS, FaultBoard
from support.lab.touches import everyday

from benchmarks.faults.reliability import play
from tactile_skin import Circuit, PressureCurve
from tactile_skin.middleware.threads import one_thread

from .. import harness

CIRCUITS = (
    Circuit(8, 8),
    Circuit(8, 12, r_ref=4700.0, r_par=70.0, adc_bits=12),
    Circuit(16, 16),
)
SCATTER = 0.08  # RMS of what a load adds to a cell's conductance
RATE = 50.0  # frames a second
SECONDS, BEGINS = 14.0, 4.0  # of a stream; when half of the faults begin
_CELL = re.compile(r"row (\d+), column (\d+)")


class Board(FaultBoard):
    """Attributes:
    absent: (row, col) -> what is printed there.
    """

    def __init__(self, circuit: Circuit, rng, protocol: str):
        super().__init__(circuit, PressureCurve(), rng, 1.0, protocol, "single")
        self.matrix.fabric.gain = np.exp(SCATTER * rng.standard_normal(circuit.shape))
        self.rate = RATE
        self.absent: dict = {}

    def encode(self, sent):
        line = super().encode(sent)
        if self.absent:
            fields = line.split(b",")
            for (row, col), word in self.absent.items():
                k = row * self.circuit.cols + col
                fields[k] = word + (b"\r\n" if k == len(fields) - 1 else b"")
            line = b",".join(fields)
        return line


def _dip(share):
    def damage(board, cell):
        board.converter.dips[cell] = share, board.rng.uniform(0.3, 0.8)

    return damage


def _restless(base: float):
    def damage(board, cell):
        board.matrix.fabric.restless[cell] = 0.5
        board.matrix.fabric.added[cell] = base

    return damage


def _noise(steps: float):
    return lambda board, cell: board.converter.extra_noise.__setitem__(cell, steps)


def _cell(name: str, value: float):
    return lambda board, cell: getattr(board.matrix.fabric, name).__setitem__(cell, value)


def _lead(axis: int):
    def damage(board, cell):
        board.matrix.wiring.leads(axis)[cell[axis]] = 1000.0  # ohm

    return damage


def _flicker(axis: int):
    return lambda board, cell: setattr(board.converter, "flicker", (axis, cell[axis], 0.3))


KINDS = {  # name -> protocol, what it does to a board at a cell, which of its lines are to be named
    "sound": ("text", lambda board, cell: None, ""),
    "noisy reading, 8 steps": (
        "binary", _noise(8.0), "both"),
    "noisy reading, 15 steps": (
        "text", _noise(15.0), "both"),
    "noisy cell, pressed": ("binary", _restless(1e-3), "both"),
    "noisy cell, at rest": ("text", _restless(0.0), "both"),
    "dips in 1 of 10": ("text", _dip(0.1), "both"),
    "dips in 1 of 2": ("binary", _dip(0.5), "both"),
    "dips always": ("text", _dip(1.0), "both"),
    "loose cell": ("binary", _cell("loose", 0.3), "both"),
    "dead cell": ("text", _cell("fixed", 0.0), "both"),
    "absent, 0": ("text", lambda board, cell: board.absent.__setitem__(cell, b"0"), "both"),
    "absent, nan": ("text", lambda board, cell: board.absent.__setitem__(cell, b"nan"), "both"),
    "bad lead, row": ("text", _lead(0), "row"),
    "bad lead, column": ("binary", _lead(1), "column"),
    "loose lead, row": ("binary", _flicker(0), "row"),
    "loose lead, column": ("text", _flicker(1), "column"),
}  # fmt: skip


class Listener(Chain):
    """Attributes:
    said: every message of diagnostics and reason of the stop.
    """

    def __init__(self, *args):
        self.said: Counter[str] = Counter()
        super().__init__(*args)

    def _on_status(self, message) -> None:
        super()._on_status(message)
        if self.stop:
            self.said[self.reason] += 1

    def _on_diagnostics(self, message) -> None:
        super()._on_diagnostics(message)
        for status in message.status:
            self.said[status.message] += 1


def heard(kind: str, circuit: Circuit, seed) -> tuple[tuple[int, int], Counter]:
    """The cell that was damaged, and all that was said from then on."""
    protocol, damage, _ = KINDS[kind]
    rng = np.random.default_rng(seed)
    board = Board(circuit, rng, protocol)
    scene = everyday(circuit.populated, SECONDS, rng, board.curve.max_force, hard=False)
    cell = tuple(int(rng.integers(n)) for n in circuit.shape)
    begin = rng.random() < 0.5 and not kind.startswith("absent")
    first = round(BEGINS * KNOTS) if begin else 0
    chain = Listener(circuit, protocol)
    try:
        if first:
            play(chain, board.advance(scene.force[:first]), scene.force[:first])
            chain.said.clear()
        damage(board, cell)
        board.damaged_at = board.t
        play(chain, board.advance(scene.force[first:]), scene.force[first:], first)
    finally:
        chain.close()
    return cell, chain.said


def named(said, cell, lines: str) -> bool:
    if lines == "both":
        return any(cell == (int(r), int(c)) for r, c in _CELL.findall(" ".join(said)))
    number = cell[lines == "column"]
    return any(re.search(rf"\b{lines} {number}\b", text) for text in said)


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="+", default=list(KINDS))
    parser.add_argument("--verbose", action="store_true", help="what was said where it was missed")
    args = parser.parse_args(arguments)
    with one_thread():
        return run(args)


def run(args) -> dict:
    rows = {}
    print(f"{'':24} named %   another cell %")
    for kind in args.kind:
        right = other = 0
        for k in range(args.trials):
            circuit = CIRCUITS[k % len(CIRCUITS)]
            seed = [args.seed, list(KINDS).index(kind), k]
            cell, said = heard(kind, circuit, seed)
            cells = {(int(r), int(c)) for r, c in _CELL.findall(" ".join(said))}
            hit = kind != "sound" and named(said, cell, KINDS[kind][2])
            right += hit
            other += bool(cells - {cell})
            if args.verbose and ((not hit and kind != "sound") or cells - {cell}):
                words = [f"{n}x {text[:90]}" for text, n in said.most_common(8)]
                print("  ", "named" if hit else "MISSED", seed, circuit.shape, cell, *words,
                      sep="\n      ")  # fmt: skip
        rows[kind] = {"trials": args.trials, "named": right, "another": other}
        print(
            f"{kind:24} {100 * right / args.trials:7.1f} {100 * other / args.trials:9.1f}",
            flush=True,
        )
    return rows


if __name__ == "__main__":
    harness.run(main)
