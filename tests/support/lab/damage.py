# SPDX-License-Identifier: Apache-2.0
"""Faults of wires, multiplexers and ADC: what arrives is read now, but from another circuit.

Each is a function that damages a `FaultBoard`, and stays once it is there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_skin.simulation.network import NOWHERE

from .board import BINARY, BOTH, Fault, FaultBoard

_SHORT = 1.0  # S: 1 ohm between two stripes that touch
_PRESSED = 1.0 / 150.0  # S of a cell that stays pressed, by some 5 N
_DRIFT = 3.0  # s in which a drift comes to its end


def _pick(board: FaultBoard, axis: int) -> int:
    return int(board.rng.integers(board.circuit.shape[axis]))


def _cell(board: FaultBoard) -> tuple[int, int]:
    cells = np.argwhere(board.circuit.populated)
    row, col = cells[board.rng.integers(len(cells))]
    return int(row), int(col)


def _addresses(board: FaultBoard, axis: int) -> np.ndarray:
    return board.matrix.wiring.addresses(axis)


def _axis(board: FaultBoard, least: int = 1) -> int:
    """Rows or columns, whichever has at least so many lines."""
    axes = [axis for axis in (0, 1) if board.circuit.shape[axis] >= least]
    return int(board.rng.choice(axes))


def _open(axis: int):
    return lambda board: _addresses(board, axis).__setitem__(_pick(board, axis), NOWHERE)


def _lead(board: FaultBoard) -> None:
    axis, wiring = _axis(board), board.matrix.wiring
    leads = (wiring.row_lead, wiring.col_lead)[axis]
    leads[_pick(board, axis)] = 1000.0  # ohm


def _broken(board: FaultBoard) -> None:
    """Cut a stripe: its far part becomes a stripe of its own, that no address selects."""
    axis = _axis(board, 1)
    if board.circuit.shape[1 - axis] < 2:
        axis = 1 - axis  # only the longer stripes can be cut
    line = _pick(board, axis)
    cut = int(board.rng.integers(1, board.circuit.shape[1 - axis]))
    board.matrix.wiring.cut(axis, line, cut)


def _short_neighbours(board: FaultBoard) -> None:
    axis = _axis(board, 2)
    first = int(board.rng.integers(board.circuit.shape[axis] - 1))
    board.matrix.wiring.ties.append((axis, first, axis, first + 1, _SHORT))


def _short_crossing(board: FaultBoard) -> None:
    row, col = _cell(board)
    board.matrix.wiring.ties.append((0, row, 1, col, _SHORT))


def _scaled(name: str, factor: float):
    def damage(board: FaultBoard) -> None:
        true = board.matrix.circuit
        board.matrix.circuit = replace(true, **{name: getattr(true, name) * factor})

    return damage


def _ceiling(share: float):
    return lambda board: setattr(board.converter, "ceiling", share)


def _amplifier(board: FaultBoard) -> None:
    board.converter.rail = 0.6


def _bit(k: int, high: bool):
    def damage(board: FaultBoard) -> None:
        if high:
            board.converter.or_mask |= 1 << k
        else:
            board.converter.and_mask &= ~(1 << k)

    return damage


def _address_bit(board: FaultBoard) -> None:
    axis = _axis(board, 2)
    lines = _addresses(board, axis)
    bit = 1 << int(board.rng.integers((len(lines) - 1).bit_length()))
    high = board.rng.random() < 0.5
    selected = np.arange(len(lines)) | bit if high else np.arange(len(lines)) & ~bit
    lines[:] = np.where(selected < len(lines), selected, NOWHERE)


def _address_stuck(board: FaultBoard) -> None:
    axis = _axis(board, 2)
    k, j = board.rng.choice(board.circuit.shape[axis], 2, replace=False)
    _addresses(board, axis)[k] = j


def _swapped(board: FaultBoard) -> None:
    axis = _axis(board, 2)
    pair = board.rng.choice(board.circuit.shape[axis], 2, replace=False)
    _addresses(board, axis)[pair] = pair[::-1]


def _missing(board: FaultBoard) -> None:
    """Add a clock pulse: from some line on each address reads the next line, the last the first."""
    axis = _axis(board, 2)
    lines = _addresses(board, axis)
    at = int(board.rng.integers(len(lines)))
    lines[at:] = (np.arange(at, len(lines)) + 1) % len(lines)


def _doubled(board: FaultBoard) -> None:
    """Lose a clock pulse: a line is read twice, those behind it are one late."""
    axis = _axis(board, 2)
    lines = _addresses(board, axis)
    at = int(board.rng.integers(1, len(lines)))
    lines[at:] = np.arange(at - 1, len(lines) - 1)


def _fixed(siemens: float):
    return lambda board: board.matrix.fabric.fixed.__setitem__(_cell(board), siemens)


def _restless(board: FaultBoard) -> None:
    cell, fabric = _cell(board), board.matrix.fabric
    fabric.restless[cell] = 0.5
    fabric.added[cell] = 1e-3  # S


def _noisy_line(board: FaultBoard) -> None:
    axis = _axis(board)
    np.swapaxes(board.converter.extra_noise, 0, axis)[_pick(board, axis)] = 10.0  # ADC steps


def _loose(board: FaultBoard) -> None:
    axis = _axis(board)
    board.converter.flicker = (axis, _pick(board, axis), 0.5)


def _towards(end: float, start: float = 0.0):
    """Return a drift from `start` to `end` in _DRIFT seconds."""
    return lambda t: start + (end - start) * min(t / _DRIFT, 1.0)


def _offset(board: FaultBoard) -> None:
    board.converter.offset = _towards(float(board.rng.choice((-10.0, 10.0))))  # ADC steps


def _reference(end: float):
    return lambda board: setattr(board.converter, "gain", _towards(end, 1.0))


def _settling(board: FaultBoard) -> None:
    board.converter.settling = 0.1


def _by_one(board: FaultBoard) -> None:
    board.shift = 1


ELECTRICAL = (
    Fault("open row", "the lead of a row is open", _open(0), protocols=BOTH),
    Fault("open column", "the lead of a column is open", _open(1)),
    Fault("bad lead", "1 kohm in the lead of a line", _lead),
    Fault("broken stripe", "a stripe is cut within the matrix", _broken),
    Fault("short of neighbours", "two neighbouring lines touch: 1 ohm", _short_neighbours),
    Fault("short at a crossing", "a row touches a column: 1 ohm", _short_crossing),
    *(Fault(f"r_par {p:+d} %", f"r_par is {p:+d} % off", _scaled("r_par", 1 + p / 100))
      for p in (-20, -10, 10, 20)),
    *(Fault(f"r_ref {p:+d} %", f"r_ref is {p:+d} % off", _scaled("r_ref", 1 + p / 100))
      for p in (-10, 10)),
    Fault("reference falls", "the ADC's reference falls: readings gain 15 % in 3 s",
          _reference(1.15)),
    Fault("supply falls", "the matrix' supply falls: readings lose 15 % in 3 s", _reference(0.85)),
    *(Fault(f"saturated at {p} %", f"no sample exceeds {p} % of full scale", _ceiling(p / 100),
            protocols=BOTH if p == 60 else (BINARY,))
      for p in (80, 60, 40)),
    Fault("amplifier at 60 %", "the input clips at 60 %, the ADC's noise on top", _amplifier),
    *(Fault(f"bit {k} stuck at {high:d}", f"bit {k} of each sample always reads {high:d}",
            _bit(k, high))
      for k in range(2, 10) for high in (False, True)),
    Fault("address bit stuck", "an address bit of a multiplexer is stuck", _address_bit,
          protocols=BOTH),
    Fault("address stuck", "one address selects another's line", _address_stuck),
    Fault("swapped lines", "two lines are exchanged", _swapped),
    Fault("line missed", "lines from some one on read the next one's", _missing),
    Fault("line doubled", "a line is read twice, those behind it come one late", _doubled),
    Fault("sample missed", "all samples are one place off", _by_one),
    Fault("dead cell", "one cell conducts nothing", _fixed(0.0)),
    Fault("stuck cell", "one cell stays pressed by some 5 N", _fixed(_PRESSED)),
    Fault("noisy cell", "one cell's conductance jumps about", _restless),
    Fault("noisy line", "a line's samples have 10 steps of noise", _noisy_line),
    Fault("loose lead", "a line's lead comes and goes, ten times a second", _loose),
    Fault("offset drifts", "the ADC's offset moves by 10 steps in 3 s", _offset),
    Fault("settling", "each reading keeps 10 % of the previous one", _settling),
)  # fmt: skip
