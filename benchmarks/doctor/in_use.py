# SPDX-License-Identifier: Apache-2.0
"""What `diagnose` says of sound boards in use: all but "too little seen" is false.

Boards as in doctor.py, without a fault and configured rightly, on which something lies from the
first frame to the last: an object, a sitting person, two feet that walk, a hand that wanders;
touches come besides.

FOLDER holds recordings of boards that others made: insole_floating/*.npz (floating,
readings up to 500 dropped) and cushion_loaded/*.csv (loaded, pull-ups, 35 kohm).
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from support import insole
from support.damaged import Case
from support.lab.board import KNOTS

from tactile_skin import Circuit, diagnose
from tactile_skin.middleware.threads import one_thread

from .. import harness
from .faults import MIXED

USES = "object", "seat", "feet", "hand"
LOAD = 8.0, 60.0  # N
CUSHION = Circuit(9, 9, r_ref=35e3, r_par=30.0, readout="loaded", driven="columns")


class InUse(Case):
    """A sound board that something always lies on."""

    def __init__(self, seed: int, seconds: float):
        self.use = USES[seed % len(USES)]
        super().__init__(seed, (), seconds, readouts=MIXED)

    def _touches(self, seconds: float, rng) -> np.ndarray:
        force = super()._touches(seconds, rng)
        n, (rows, cols) = len(force), self.circuit.shape
        t = np.arange(n) / KNOTS
        load = rng.uniform(*LOAD)
        at = np.array([rng.uniform(0.2, 0.8) * rows, rng.uniform(0.2, 0.8) * cols])
        way = rng.uniform(0.2, 0.35, 2)[:, None] * [[rows], [cols]]
        phase = rng.uniform(0.0, 2.0 * np.pi, (2, 1))
        if self.use == "object":
            return force + load * _blob(force.shape, at[:, None], rng.uniform(0.7, 1.5))
        if self.use == "seat":
            sways = 1.0 + 0.1 * np.sin(t / 3.0 + phase[0])
            broad = _blob(force.shape, at[:, None] + 0.05 * way * np.sin(t / 5.0 + phase), rows / 4)
            return force + load * sways[:, None, None] * broad
        if self.use == "feet":
            step = 0.5 + 0.45 * np.sign(np.sin(2.0 * t)) * np.minimum(
                1.0, np.abs(np.sin(2.0 * t)) * 4
            )
            left, right = (
                _blob(
                    force.shape,
                    (at + np.array([0.0, side * cols / 5]))[:, None],
                    rng.uniform(1.0, 2.0),
                )
                for side in (-1.0, 1.0)
            )
            return force + load * (step[:, None, None] * left + (1.0 - step)[:, None, None] * right)
        wanders = at[:, None] + way * np.sin(t / rng.uniform(2.0, 6.0) + phase)
        return force + load * _blob(force.shape, wanders, rng.uniform(0.8, 2.0))


def _blob(shape, at, width: float) -> np.ndarray:
    """(n or 1, rows, cols) pictures of 1 N in all.

    Args:
        at: (2, n or 1) row and column of its centre.
    """
    _, rows, cols = shape
    row = np.exp(-0.5 * np.square((np.arange(rows) - at[0][:, None]) / width))
    col = np.exp(-0.5 * np.square((np.arange(cols) - at[1][:, None]) / width))
    blob = row[:, :, None] * col[:, None, :]
    return blob / blob.sum((1, 2), keepdims=True)


def recordings(folder: Path):
    """Yield (name, (n, rows, cols) ADC ratio, circuit, inverted) of what others recorded."""
    for path in sorted(folder.glob("insole_floating/*.npz")):
        data = np.load(path)
        for foot in ("left_electrical", "right_electrical"):
            counts = data[foot].astype(float)
            circuit = insole.circuit(~np.isnan(counts[0]))
            yield f"{path.stem} {foot[:-11]}", insole.ratio(counts), circuit, False
    paths = sorted(folder.glob("cushion_loaded/*.csv"))
    if paths:
        frames = [np.loadtxt(p, delimiter=",").reshape(-1, 9, 9).transpose(0, 2, 1) for p in paths]
        together = np.concatenate(frames) / CUSHION.full_scale
        yield f"cushion, {len(paths)} files", 1.0 - together, CUSHION, True


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--seed", type=int, default=71000)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--data", type=Path, help="folder of recordings that others made")
    args = parser.parse_args(arguments)
    false, kinds = 0, Counter()
    with one_thread():
        for name, frames, circuit, inverted in recordings(args.data) if args.data else ():
            print(f"{name}: {len(frames)} frames")
            for finding in diagnose(frames, circuit, inverted=inverted):
                print(f"  {finding}")
        for seed in range(args.seed, args.seed + args.boards):
            case = InUse(seed, args.seconds)
            found = diagnose(case.frames, case.circuit)
            false += any(f.kind != "too little seen" for f in found)
            kinds.update(f.kind for f in found)
            for finding in found:
                shape = "{} x {}".format(*case.circuit.shape)
                print(f"{seed} {case.circuit.readout} {shape}, {case.use}: {finding}", flush=True)
    print(f"{false} of {args.boards} boards with a false finding; said in all: {dict(kinds)}")
    return {"boards": args.boards, "false": false, "kinds": kinds}


if __name__ == "__main__":
    harness.run(main)
