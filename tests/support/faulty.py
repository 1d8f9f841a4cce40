# SPDX-License-Identifier: Apache-2.0
"""A board that is damaged while it plays a press, and what arrives of it."""

import numpy as np

from support.lab.board import KNOTS, FaultBoard
from tactile_skin import Circuit, PressureCurve
from tactile_skin.board import formats

CURVE = PressureCurve()
SHAPE = (5, 4)


def board_of(shape=SHAPE, seed=0, **kinds) -> FaultBoard:
    return FaultBoard(Circuit(*shape), CURVE, np.random.default_rng(seed), **kinds)


def frames(board: FaultBoard, force):
    """What arrives and is whole: (t, frame)."""
    parser = formats.make_parser(board.protocol, *board.circuit.shape, 10)
    return [(t, frame) for t, data in board.advance(force) for frame in parser.feed(data)]


def pressed(seconds: float, shape=SHAPE, newtons=2.0):
    force = np.zeros((round(seconds * KNOTS), *shape))
    force[:, 1:3, 1:3] = newtons
    return force


def samples(fault, seconds=0.5, **kinds) -> np.ndarray:
    """(n, rows, cols) ADC steps that arrive from a board that is damaged after a second."""
    board = board_of(**kinds)
    board.advance(np.zeros((KNOTS, *SHAPE)))
    board.damaged_at = board.t
    fault.damage(board)
    return np.array([frame.samples / 64.0 for _, frame in frames(board, pressed(seconds))])


def named(faults, name: str):
    return next(fault for fault in faults if fault.name == name)
