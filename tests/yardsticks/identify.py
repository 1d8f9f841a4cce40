"""How well `identify` finds r_par and r_line of unknown boards:
`python tests/yardsticks/identify.py [--boards N] [--frames N] [--size 16x16] [--seed S]
[--readout floating|loaded-rows|loaded-columns|grounded-rows|grounded-columns]`.

Each board has r_par up to 20 % off, stripes of 0 to 15 ohm, a fabric whose curve is up to 30 % off
in level and shape, 8 % scatter, 3 % at rest, 0.5 % of a touch carried to the neighbours and 1 step
of noise on each of the four samples of a reading. Bodies (ellipses, boxes, rings, turned, textured,
30 to 1000 g on a cell) press anywhere. The circuit that is supposed is the paper's. Where lines are
driven the stripes are ideal, and loads scatter by 5 to 8 %.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, identify, measure_rest
from tactile_skin.bench import textile
from tactile_skin.bench.damage.board import FaultBoard
from tactile_skin.calibration.identify import names, values
from tactile_skin.calibration.rest import supposing
from tactile_skin.learning import scenes
from tactile_skin.physics.curve import GRAM

AT_REST = 60  # frames


def bodies(n: int, shape, rng) -> np.ndarray:
    """(n, rows, cols) force [N] of one to four bodies each."""
    return scenes.sample("bodies", n, *shape, rng)


class Unknown:
    """A board that nobody here made.

    Args:
        ohms: times which it has all resistances of the paper's kind of board.
        fabric: times which, besides, its cells have theirs.
        fixed: of `textile.Textile`.

    Attributes:
        r_par, r_line: the true ones [ohm].
        curve: the true one, of the usual cell.
    """

    def __init__(self, shape, seed: int, ohms: float = 1.0, fabric: float = 1.0, **fixed):
        rng = self._rng = np.random.default_rng(seed)
        paper = Circuit(*shape)
        self.supposed = replace(paper, r_ref=ohms * paper.r_ref, r_par=ohms * paper.r_par)
        self._seed = seed
        points = PressureCurve().points
        level, tilt = np.exp(rng.uniform(-0.3, 0.3)), rng.uniform(-0.3, 0.3) / len(points)
        level *= ohms * fabric
        resistance = [r * level * np.exp(tilt * k) for k, (_, r) in enumerate(points)]
        self.curve = PressureCurve([force for force, _ in points], resistance)
        factor, line = rng.uniform(0.8, 1.2), ohms * rng.uniform(0.0, 15.0)
        self.textile = textile.Textile(
            **{"noise": 1.0, "r_par": factor, "line": line, "scatter": 0.08, "rest": 0.03}
            | {"lateral": 0.005}
            | fixed
        )
        self.r_par = self.textile.r_par * self.supposed.r_par
        self.r_line = self.textile.line

    def expose(self, force, factor=1.0) -> np.ndarray:
        """(rows, cols) ADC ratio before noise and rounding of a load (rows, cols) [N].

        Args:
            factor: (rows, cols) times what a cell conducts otherwise.
        """
        cells = np.random.default_rng(self._seed)  # their scatter, the same for each frame
        return textile.expose(self.textile, self.supposed, self.curve, force, cells, factor)

    def sample(self, ratio: np.ndarray) -> np.ndarray:
        """A reading of what `expose` gives."""
        return textile.sample(self.textile, self.supposed, ratio, self._rng)

    def frames(self, force) -> np.ndarray:
        """(n, rows, cols) readings of loads (n, rows, cols) [N], all of one board's cells."""
        return np.array([self.sample(self.expose(f)) for f in force])

    def at_rest(self, n: int = AT_REST) -> np.ndarray:
        ratio = self.expose(np.zeros(self.supposed.shape))
        return np.array([self.sample(ratio) for _ in range(n)])


class UnknownDriven(Unknown):
    """The same of a loaded or grounded matrix.

    Args:
        readout: and which lines are driven: "loaded-columns", say.
        r_ref: pull-up or pull-down resistor [ohm].
    """

    def __init__(self, shape, seed: int, readout: str, r_ref: float = Circuit().r_ref, **fixed):
        super().__init__(shape, seed, **{"line": 0.0} | fixed)
        readout, driven = readout.split("-")
        self.supposed = replace(self.supposed, readout=readout, driven=driven, r_ref=r_ref)
        self.r_drive = 0.0
        if readout == "grounded":  # from ideal drivers to those of a multiplexer
            self.r_drive = np.random.default_rng([seed, 3]).uniform(0.0, 100.0)
        true = replace(self.supposed, r_par=self.r_par, r_drive=self.r_drive)
        self._board = FaultBoard(true, self.curve, np.random.default_rng(seed))

    def expose(self, force) -> np.ndarray:
        return self._board.ratio(force[None])[0]


def error(board: Unknown, circuit: Circuit, rest, frames, force) -> float:
    """Mean error [g a cell] of `map` with a circuit, and the true curve of the fabric."""
    curve = board.curve.resting_at(1.0 / supposing(rest, circuit).conductance)
    found = compensate(frames, circuit, curve, "map")
    return float(np.abs(found.force - force).mean() / GRAM)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=40)
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--size", default="16x16", metavar="ROWSxCOLS")
    parser.add_argument("--seed", type=int, default=0, help="of the first board")
    parser.add_argument("--readout", default="floating")
    parser.add_argument(
        "--errors", type=int, default=0, metavar="N", help="of N frames a board, too, by `map`"
    )
    args = parser.parse_args()
    shape = tuple(map(int, args.size.split("x")))
    off, std, told, spent, errors = [], [], [], 0.0, []
    for seed in range(args.seed, args.seed + args.boards):
        driven = args.readout != "floating"
        board = UnknownDriven(shape, seed, args.readout) if driven else Unknown(shape, seed)
        both = names(board.supposed)
        truth = tuple(getattr(board, name) for name in both)
        force = bodies(args.frames, shape, np.random.default_rng([seed, 1]))
        frames, rest = board.frames(force), measure_rest(board.at_rest(), board.supposed)
        begun = time.process_time()
        found = identify(frames, board.supposed, rest)
        spent += time.process_time() - begun
        if args.errors:
            new = bodies(args.errors, shape, np.random.default_rng([seed, 2]))
            true = replace(board.supposed, **dict(zip(both, truth, strict=True)))
            seen = board.frames(new)
            circuits = true, found.circuit, board.supposed
            errors.append([error(board, circuit, rest, seen, new) for circuit in circuits])
        off.append(np.subtract(values(found.circuit), truth))
        std.append([found.std[name] for name in both])
        told.append([found.told[name] for name in both])
        print(
            f"{seed}: r_par {truth[0]:.1f}, off by {off[-1][0]:+.2f} +- {std[-1][0]:.2f}; "
            f"{both[1]} {truth[1]:.1f}, off by {off[-1][1]:+.2f} +- {std[-1][1]:.2f}; "
            f"told {told[-1]}, {found.frames} frames",
            flush=True,
        )
    off, std, told = np.array(off), np.array(std), np.array(told)
    share = np.abs(off[:, 0]) < 0.01 * Circuit().r_par
    print(f"r_par within 1 %: {share.mean():.1%}; {both[1]} within 1 ohm: ", end="")
    print(f"{(np.abs(off[:, 1]) < 1.0).mean():.1%}; told {told.mean(0)}")
    within = [np.mean((np.abs(off) < std)[told[:, k], k]) for k in range(2) if told[:, k].any()]
    print("of those told, within one standard deviation:", *(f"{share:.0%}" for share in within))
    if errors:
        known, identified, supposed = np.mean(errors, axis=0)
        print(f"error of map [g a cell]: the circuit known {known:.2f}, identified ", end="")
        print(f"{identified:.2f} ({identified / known:.2f} times), as supposed {supposed:.2f}")
    print(f"{1e3 * spent / (args.boards * args.frames):.0f} ms a frame (processor time)")


if __name__ == "__main__":
    main()
