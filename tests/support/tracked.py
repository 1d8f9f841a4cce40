# SPDX-License-Identifier: Apache-2.0
"""A running skin that learns the r_par of its board."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from support.damaged import frames_of
from support.lab.board import READOUTS, FaultBoard
from support.lab.touches import everyday
from tactile_skin import Circuit, PressureCurve
from tactile_skin.middleware.bus import Context, ManualClock, Node, Parameter
from tactile_skin.msg import Header, image
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.solvers.evidence import series_scale

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
