# SPDX-License-Identifier: Apache-2.0
"""Damaged boards for the doctor: what was done to each, and which finding names it."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from support.lab.board import READOUTS as SCANNED
from support.lab.board import Fault, FaultBoard
from support.lab.damage import ELECTRICAL
from support.lab.parts import Diode
from support.lab.touches import everyday
from tactile_skin import Circuit, PressureCurve
from tactile_skin.physics.readouts import DRIVEN

SHAPES = (8, 8), (8, 12), (12, 16), (16, 16), (24, 16), (32, 32)
KINDS = {  # of the report: names in `ELECTRICAL`
    "open": ("open row", "open column"),
    "lead": ("bad lead",),
    "broken": ("broken stripe",),
    "short of neighbours": ("short of neighbours",),
    "short at a crossing": ("short at a crossing",),
    "resistor": ("missing resistor",),  # not of floating matrices
    "dead": ("dead cell",),
    "stuck": ("stuck cell",),
    "noisy cell": ("noisy cell",),
    "noisy line": ("noisy line",),
    "contact": ("loose lead",),
    "doubled": ("address stuck", "line doubled", "line missed"),
    "swapped": ("swapped lines",),
    "circuit": ("r_par -20 %", "r_par +20 %", "r_ref -10 %", "r_ref +10 %", "supply falls"),
    "saturation": ("saturated at 60 %", "amplifier at 60 %"),
    "bits": tuple(f"bit {k} stuck at {v}" for k in (3, 5, 7) for v in (0, 1)),
    "drivers": ("weak drivers",),  # of grounded boards; only if asked for
}
MAY_HIDE = "saturation", "short of neighbours"
WHOLE = "circuit", "saturation", "bits", "drivers"  # of no line, at most one on a board


def frames_of(board: FaultBoard, force: np.ndarray) -> np.ndarray:
    """(n, rows, cols) ADC ratio that the board sends under a force (knots, rows, cols) [N]."""
    sent = []

    def keep(frame):
        sent.append(frame.samples.copy())

    board.tamper = keep
    for first in range(0, len(force), 200):
        board.advance(force[first : first + 200])
    full = board.circuit.full_scale * 2**board.fraction_bits
    return np.clip(np.array(sent) / full, 0.0, 1.0)


def _missing_resistor(board: FaultBoard) -> None:
    sense = board.circuit.shape[1 if board.circuit.driven == "rows" else 0]
    board.matrix.wiring.bare.add(int(board.rng.integers(sense)))


MISSING = Fault("missing resistor", "a sense line has no reference resistor", _missing_resistor)


def _weak_drivers(board: FaultBoard) -> None:
    ohm = board.rng.uniform(15.0, 100.0)
    board.matrix.circuit = replace(board.matrix.circuit, r_drive=ohm)


DRIVERS = Fault("weak drivers", "what holds a driven line has 15 to 100 ohm", _weak_drivers)


def readout_of(seed: int, readouts: tuple[str, ...]) -> dict:
    """Of a board: one of these, and what is driven."""
    rng = np.random.default_rng([seed, 3])
    readout = readouts[rng.integers(len(readouts))]
    driven = "rows" if readout == "floating" else DRIVEN[rng.integers(len(DRIVEN))]
    return {"readout": readout, "driven": driven}


class Case:
    """A board with faults, and what `diagnose` may say of it."""

    def __init__(
        self,
        seed: int,
        faults: tuple[str, ...],
        seconds: float,
        shape=None,
        readouts: tuple[str, ...] = ("floating",),
        diode: Diode | None = None,
        **parts,
    ):
        rng = np.random.default_rng(seed)
        shape = shape or SHAPES[rng.integers(len(SHAPES))]
        self.circuit = Circuit(*shape, **readout_of(seed, readouts), **parts)
        level = np.exp(rng.uniform(-0.3, 0.3))
        curve = PressureCurve(*np.array(PressureCurve().points).T * [[1.0], [level]])
        scanned = SCANNED[rng.integers(len(SCANNED))]
        self.board = FaultBoard(self.circuit, curve, rng, 1.0, readout=scanned)
        self.board.matrix.diode = diode
        self.board.damaged_at = -10.0  # a drift has come to its end
        self.faults = []  # kind, name, rows, cols
        self.cut = np.empty((0, 2), int)  # crossings behind the cut of a broken stripe
        by_name = {fault.name: fault for fault in (*ELECTRICAL, MISSING, DRIVERS)}
        for kind in faults:
            name = KINDS[kind][rng.integers(len(KINDS[kind]))]
            before = self._state()
            by_name[name].damage(self.board)
            self.faults.append((kind, name, *self._changed(before)))
        for k, (kind, name, rows, cols) in enumerate(self.faults):
            if kind in ("dead", "stuck", "noisy cell", "short at a crossing"):
                w = self.board.matrix.wiring
                read = [
                    {int(np.flatnonzero(lines == i)[0]) if (lines == i).any() else i for i in of}
                    for lines, of in ((w.rows, rows), (w.cols, cols))
                ]
                self.faults[k] = (kind, name, *read)
        force = self._touches(seconds, rng)
        self.hidden = {kind for kind in faults if kind in MAY_HIDE and self._hides(kind, force)}
        self.frames = frames_of(self.board, force)

    def _touches(self, seconds: float, rng) -> np.ndarray:
        cells, most = self.circuit.populated, self.board.curve.max_force
        return everyday(cells, seconds, rng, most, hard=False).force

    def _hides(self, kind: str, force: np.ndarray) -> bool:
        """Whether a fault changes no reading by a step."""
        with_it = copy.deepcopy(self.board)
        with_it.matrix.fabric.restless = {}
        without = copy.deepcopy(with_it)
        if kind == "saturation":
            without.converter.ceiling, without.converter.rail = 1.0, np.inf
        else:
            wiring = without.matrix.wiring
            wiring.ties = [tie for tie in wiring.ties if tie[0] != tie[2]]
        one, other = (
            np.minimum(board.ratio(force[::10]), min(board.converter.ceiling, board.converter.rail))
            for board in (with_it, without)
        )
        return bool(np.abs(one - other).max() * self.circuit.full_scale < 1.0)

    def _state(self):
        w, fabric = self.board.matrix.wiring, self.board.matrix.fabric
        return {
            "rows": w.rows.copy(), "cols": w.cols.copy(), "row_lead": w.row_lead.copy(),
            "col_lead": w.col_lead.copy(), "row_of": w.row_of.copy(), "col_of": w.col_of.copy(),
            "ties": len(w.ties), "fixed": set(fabric.fixed), "restless": set(fabric.restless),
            "noise": self.board.converter.extra_noise.copy(), "bare": set(w.bare),
        }  # fmt: skip

    def _changed(self, before) -> tuple[set, set]:
        """Rows and columns that a fault is about."""
        b, w, rows, cols = self.board, self.board.matrix.wiring, set(), set()
        fabric, read = b.matrix.fabric, b.converter
        for lines, now, old in ((rows, w.rows, before["rows"]), (cols, w.cols, before["cols"]),
                                (rows, w.row_lead, before["row_lead"]),
                                (cols, w.col_lead, before["col_lead"])):  # fmt: skip
            for k in np.flatnonzero(now != old):
                lines.add(int(k))
                if 0 <= now[k] < len(now) and now.dtype.kind == "i":
                    lines.add(int(now[k]))
        rows |= set(np.flatnonzero((w.row_of != before["row_of"]).any(1)).tolist())
        cols |= set(np.flatnonzero((w.col_of != before["col_of"]).any(0)).tolist())
        cut = np.argwhere((w.row_of != before["row_of"]) | (w.col_of != before["col_of"]))
        self.cut = cut if len(cut) else self.cut
        for kind_a, a, kind_b, c, _ in w.ties[before["ties"] :]:
            for kind, line in ((kind_a, a), (kind_b, c)):
                (rows, cols)[kind].add(int(line))
        # A cell is named by the addresses that read it, where one of another fault reads it late.
        fixed = set(fabric.fixed) - before["fixed"]
        for row, col in fixed | (set(fabric.restless) - before["restless"]):
            rows.add(row)
            cols.add(col)
        more = read.extra_noise != before["noise"]
        if more.any():
            (rows if more.all(1).any() else cols).add(
                int(np.flatnonzero(more.all(1) if more.all(1).any() else more.all(0))[0])
            )
        (rows if self.circuit.driven == "columns" else cols).update(w.bare - before["bare"])
        if read.flicker and not rows and not cols:
            (rows, cols)[read.flicker[0]].add(read.flicker[1])
        return rows, cols


def explains(finding, kind: str, name: str, rows: set, cols: set, cut) -> bool:
    """Whether a finding names a fault, with its line or cell."""
    at = set(finding.rows) == rows and set(finding.cols) == cols
    if kind == "drivers":
        return finding.where == "r_drive"
    if kind in WHOLE:
        return finding.kind == kind
    if kind == "doubled":
        mine, theirs = (rows, finding.rows) if rows else (cols, finding.cols)
        return finding.kind in ("doubled", "shifted", "swapped") and bool(set(theirs) & mine)
    if kind == "broken" and len(cut) == 1:  # reads like a dead cell, and is named as both
        cell = (set(finding.rows), set(finding.cols)) == ({cut[0][0]}, {cut[0][1]})
        return finding.kind == "dead" and cell
    if kind == "short at a crossing" and "shorted, or" in finding.remedy:  # readings end: as both
        return at
    kinds = {"short of neighbours": "short", "short at a crossing": "short"}
    kinds |= {"noisy cell": "noisy", "noisy line": "noisy"}
    return finding.kind == kinds.get(kind, kind) and at
