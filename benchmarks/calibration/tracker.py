# SPDX-License-Identifier: Apache-2.0
"""After how many touches a running skin knows its r_par.

Boards as the doctor's without other faults, r_par off by each factor from the first
frame on, through the compensation node on a driven clock at 25 or 100 frames a second. `known`: the
circuit that the node computes with has an r_par within 3 % of `series_scale` of the true one, an
r_drive within 3 ohm, and keeps them. The time is the tracker's alone, averaged over all frames.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from support.damaged import frames_of
from support.lab.board import READOUTS, FaultBoard
from support.lab.touches import everyday

from tactile_skin import Circuit, PressureCurve
from tactile_skin.middleware.bus import Context, ManualClock, Node, Parameter
from tactile_skin.middleware.threads import one_thread
from tactile_skin.msg import Header, image
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.solvers.evidence import series_scale

from .. import harness

KNOWN, DRIVE = 0.03, 3.0  # ohm of r_drive
EVERY = 4  # frames for one that the node is given, to save time: 25 a second


def run(seed: int, factor: float, seconds: float, shapes, readout="floating", r_drive=0.0, **parts):
    """Touches until r_par was known (inf: never), its last error [ohm] and std, words, cost."""
    rng = np.random.default_rng(seed)
    readout, driven = readout.split("-") if "-" in readout else (readout, "rows")
    circuit = Circuit(*shapes[rng.integers(len(shapes))], readout=readout, driven=driven, **parts)
    level = np.exp(rng.uniform(-0.3, 0.3))
    curve = PressureCurve(*np.array(PressureCurve().points).T * [[1.0], [level]])
    board = FaultBoard(circuit, curve, rng, 1.0, readout=READOUTS[rng.integers(3)])
    r_par = factor * circuit.r_par
    board.matrix.circuit = replace(circuit, r_par=r_par, r_drive=r_drive)
    every = EVERY if seed % 2 else 1
    scene = everyday(circuit.populated, seconds, rng, curve.max_force, hard=False)
    frames = frames_of(board, scene.force)[::every]
    rows, cols = circuit.shape
    given = {"circuit.rows": rows, "circuit.cols": cols, "time_limit": 10.0}
    given |= {"circuit.readout": readout, "circuit.driven": driven}
    given |= {f"circuit.{name}": value for name, value in parts.items()}
    clock = ManualClock(1000.0)
    overrides = [Parameter(name, value) for name, value in given.items()]
    node = Node("compensation", context=Context(clock), parameter_overrides=overrides)
    skin, spent = Compensation(node), [0.0, 0.0]
    learn = skin.skin._learn_circuit

    def timed(*args):
        begun = time.perf_counter()
        learn(*args)
        took = time.perf_counter() - begun
        spent[:] = spent[0] + took, max(spent[1], took)

    skin.skin._learn_circuit = timed
    scale, limit = 2 ** (16 - circuit.adc_bits) * circuit.full_scale, KNOWN * series_scale(circuit)
    begun = np.array([touch.start for touch in scene.touches])
    known = np.inf
    for k, adc in enumerate(frames, 1):
        clock.advance(every / board.rate)
        samples = np.rint(adc * scale).astype(np.uint16)
        skin.on_adc(image(samples, "16UC1", Header(clock.now().to_msg())))
        near = abs(skin.skin.circuit.r_par - r_par) < limit
        near &= abs(skin.skin.circuit.r_drive - r_drive) < DRIVE
        now = float(np.count_nonzero(begun < k * every / board.rate))
        known = min(known, now) if near else np.inf
    node.destroy_node()
    tracker = skin.skin._tracker
    off = np.array([circuit.r_par, 0.0]) + tracker._off - [r_par, r_drive]
    return (
        known,
        off,
        tracker.std,
        "; ".join(f"{f}" for f in tracker.findings() if f.form != "likely"),
        (spent[0] / len(frames), spent[1]),
        circuit.shape,
    )


def y() -> float:
    """One `numpy.linalg.solve` of 257 equations [s]."""
    rng = np.random.default_rng(0)
    a, b, times = rng.random((257, 257)), rng.random(257), []
    for _ in range(30):
        begun = time.perf_counter()
        np.linalg.solve(a, b)
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--off", type=float, nargs="+", default=[1.0, 0.8, 0.9, 1.1, 1.2])
    parser.add_argument("--readout", default="floating")
    parser.add_argument("--shapes", nargs="+", default=["8x8", "16x16"], metavar="ROWSxCOLS")
    parser.add_argument("--r-ref", type=float, default=Circuit().r_ref, metavar="OHM")
    parser.add_argument("--r-par", type=float, default=Circuit().r_par, metavar="OHM")
    parser.add_argument("--r-drive", type=float, default=0.0, metavar="OHM")
    args = parser.parse_args(arguments)
    parts = {"r_ref": args.r_ref, "r_par": args.r_par, "r_drive": args.r_drive}
    shapes = [tuple(map(int, name.split("x"))) for name in args.shapes]
    with one_thread():
        unit, rows = y(), []
        for factor in args.off:
            seeds = range(args.seed, args.seed + args.boards)
            runs = [run(s, factor, args.seconds, shapes, args.readout, **parts) for s in seeds]
            known = np.array([r[0] for r in runs])
            off = np.array([r[1] for r in runs])
            std = np.array([r[2] for r in runs])
            with np.errstate(invalid="ignore"):
                z = off / std
            rms, most = np.sqrt(np.square(off).mean(0)), np.abs(off).max(0)
            row = {"r_par": factor, "known": known, "off": off, "std": std}
            rows.append(row | {"messages": [r[3] for r in runs]})
            words, n = sum(bool(r[3]) for r in runs), len(runs)
            cost = np.array([r[4] for r in runs])
            print(
                f"r_par x {factor:g}: known after touches {np.sort(known).tolist()}; "
                f"a message on {words} of {n}; error, RMS {rms} ohm, {np.nanstd(z, axis=0)} std; "
                f"at most {most}; a frame {cost[:, 0].mean() / unit:.2f} y, "
                f"at most {1e3 * cost[:, 1].max():.0f} ms",
                flush=True,
            )
    return rows


if __name__ == "__main__":
    harness.run(main)
