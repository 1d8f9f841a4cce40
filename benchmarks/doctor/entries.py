# SPDX-License-Identifier: Apache-2.0
"""Boards of which one entry is wrong: what is on the bench, and what its owner entered."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from support.strangers import boards
from support.strangers.sim import counts, fabric

from tactile_skin import Circuit, PressureCurve
from tactile_skin.board.formats import make_format, make_parser
from tactile_skin.board.frame import Parser

SHAPES = (6, 6), (8, 8), (8, 10), (10, 8), (12, 10), (6, 9)
OF_CIRCUIT = [
    "rows",
    "cols",
    "r_ref",
    "r_par",
    "adc_bits",
    "readout",
    "driven",
    "inverted",
    "adc_full_scale",
    "r_drive",
]
OF_LINK = ["protocol", "format"]  # of serial_driver
R_REF = {  # ohm, by which a readout tells a palm
    "floating": (1780.0, 4700.0),
    "loaded": (1000.0, 4700.0),
    "grounded": (200.0, 500.0),
}
KINDS = "rows/cols", "size", "bits", "scale", "polarity", "readout", "r_par", "order", "format"
NUMBERED = {"line": "R{row}C{col}: {values}", "first": 1}
SKETCHES = {  # name in support.strangers.boards -> protocol, and how the docs describe it
    "frame_a_line": ("text", {}),
    "counter_in_front": ("text", {"line": "{skip},{values}"}),
    "time_and_class": ("text", {"line": "{skip},{values},{skip}"}),
    "bracketed": ("text", {}),
    "labelled": ("text", {}),
    "json_line": ("text", {"line": '{"t":{skip},"data":{values}}'}),
    "json_lines": ("text", {}),
    "row_a_line": ("text", {}),
    "rows_under_a_heading": ("text", {}),
    "rows_with_a_label": ("text", {"line": "Row {row}: {values}"}),
    "rows_with_a_number": ("text", {"line": "{row},{values}"}),
    "numpy_print": ("text", {}),
    "index_value": ("text", {"line": "{index},{values}"}),
    "row_col_value": ("text", {"line": "{row},{col},{values}"}),
    "cell_in_words": ("text", NUMBERED),
    "volts": ("text", {"full_scale": 5.0}),
    "millivolts": ("text", {"full_scale": 5000.0}),
    "carriage_returns": ("text", {"end": "\r"}),
    "angle_brackets": ("text", {"end": ">"}),
    "status_lines": ("text", {}),
    "words": ("packets", {"head": "FF FF"}),
    "words_with_a_sum": ("packets", {"head": "55 AA ?? ??", "word": "u8", "check": "sum16le"}),
    "words_with_an_end": ("packets", {"head": "A0", "word": "u16be", "tail": "C0 0D"}),
}
BYTES = {"words_with_a_sum"}  # sketches that send the upper 8 of 10 bits
SLIPS = {  # entry of a format -> what is easily entered instead
    "first": (0, 1),
    "full_scale": (0.0, 3.3, 5.0, 5000.0),
    "head": ("FF FE", "AA 55 ?? ??", "A0 A0"),
    "word": ("u8", "u16le", "u16be"),
    "check": ("", "sum8", "xor8", "crc16le"),
    "tail": ("", "0D 0A"),
}
OTHER_SKETCH = 0.5  # share of wrong formats that are those of another sketch


def parser_of(entered: dict) -> Parser:
    size = entered["rows"], entered["cols"], entered["adc_bits"]
    return make_parser(
        entered["protocol"], *size, make_format(entered["protocol"], entered["format"])
    )


def circuit_of(entered: dict) -> Circuit:
    names = set(OF_CIRCUIT) - {"inverted", "adc_full_scale"}
    return Circuit(**{k: entered[k] for k in names})


@dataclass
class Board:
    """What is on the bench, and what its owner entered.

    Attributes:
        right: the entries as they should be; entered: as they are.
        order: of the columns that the board sends.
        scale: what the supply reads, of a board that sends no ADC steps; 0: ADC steps.
        sketch: of support.strangers.boards, what prints the readings.
    """

    kind: str
    right: dict
    entered: dict
    curve: PressureCurve
    noise: float
    seed: int
    order: np.ndarray = field(default=None)
    scale: float = 0.0
    sketch: str = "frame_a_line"

    @property
    def circuit(self) -> Circuit:
        return circuit_of(self.right)

    @property
    def looked_up(self) -> dict:
        """What its maker reads off the board: a sketch's scale is no width of an ADC."""
        return self.right | ({"adc_bits": self.entered["adc_bits"]} if self.scale else {})

    @property
    def printed(self) -> float:
        """What the sketch prints of an input at the supply."""
        scale = self.right["format"].get("full_scale") or self.right["adc_full_scale"]
        return scale or float(2 ** self.right["adc_bits"] - 1)

    def bytes_of(self, samples: np.ndarray, first: int = 0) -> bytes:
        """Return what the sketch sends of samples, (n, rows, cols)."""
        steps = samples * 4 if self.sketch in BYTES else samples  # it sends a quarter
        return boards.sent({**boards.TEXT, **boards.PACKETS}[self.sketch], steps, first)

    def samples(self, force: np.ndarray, rng) -> np.ndarray:
        """Return (n, rows, cols) numbers that it sends under forces [N]."""
        sent = np.array(
            [
                counts(
                    self.circuit,
                    self.curve,
                    f,
                    rng,
                    noise=self.noise,
                    inverted=self.right["inverted"],
                )
                for f in force
            ]
        )
        if self.scale:
            sent = np.rint(sent * self.scale / self.circuit.full_scale).astype(int)
        return sent[:, :, self.order]


def draw(seed: int, kinds=KINDS) -> Board:
    """Return a board with one wrong entry."""
    rng = np.random.default_rng([33, seed])
    kind = kinds[seed % len(kinds)]
    shapes = [s for s in SHAPES if s[0] != s[1]] if kind == "rows/cols" else SHAPES
    rows, cols = shapes[rng.integers(len(shapes))]
    readout = ("floating", "loaded", "grounded")[rng.integers(3)]
    driven = "rows" if readout == "floating" else ("rows", "columns")[rng.integers(2)]
    bits = int((10, 12)[rng.integers(2)])
    right = {
        "rows": rows,
        "cols": cols,
        "r_ref": float(R_REF[readout][rng.integers(2)]),
        "r_par": float(rng.uniform(20, 350)) if readout == "floating" else 25.0,
        "adc_bits": bits,
        "readout": readout,
        "driven": driven,
        "inverted": bool(rng.integers(2)),
        "adc_full_scale": 0.0,
        "r_drive": 0.0,
        "protocol": "text",
        "format": {},
    }
    circuit = circuit_of(right)
    curve = fabric(circuit, seed=seed, scatter=rng.uniform(0.03, 0.08))
    board = Board(kind, right, dict(right), curve, rng.uniform(0.5, 1.5), seed)
    board.order = np.arange(cols)
    wrong = board.entered
    if kind == "rows/cols":
        wrong |= {"rows": cols, "cols": rows}
    elif kind == "size":
        wrong["cols"] = cols + int(rng.integers(1, 3))
    elif kind == "bits":
        wrong["adc_bits"] = 22 - bits
    elif kind == "scale":
        board.scale = float((3300, 5000)[rng.integers(2)])
        right |= {"adc_bits": 13 if board.scale > 4095 else 12, "adc_full_scale": board.scale}
    elif kind == "polarity":
        wrong["inverted"] = not right["inverted"]
    elif kind == "readout":
        others = [
            (r, d)
            for r in ("floating", "loaded", "grounded")
            for d in ("rows", "columns")
            if (r, d) != (readout, driven)
            and not (r == "floating" and (d == "columns" or readout == r))
        ]
        wrong["readout"], wrong["driven"] = others[rng.integers(len(others))]
    elif kind == "r_par":
        wrong["r_par"] = float((0.0, 2.0)[rng.integers(2)]) * right["r_par"]
        if readout != "floating":
            wrong["r_par"] = right["r_par"] + 300.0
    elif kind == "order":
        a, b = rng.permutation(cols)[:2]
        board.order[[a, b]] = b, a
    else:
        board.sketch = list(SKETCHES)[rng.integers(len(SKETCHES))]
        protocol, form = SKETCHES[board.sketch]
        of_link = {"protocol": protocol, "format": form}
        right |= of_link | {"adc_bits": 8 if board.sketch in BYTES else 10}
        wrong |= right
        while wrong == right or _reads(board, wrong):
            wrong |= of_link | _wrong_link(protocol, form, rng)
    return board


def _wrong_link(protocol: str, form: dict, rng) -> dict:
    """Return another description: of another sketch, or with one slip."""
    slips = [name for name in form if name in SLIPS]
    if not slips or rng.random() < OTHER_SKETCH:
        others = [("binary", {}), *SKETCHES.values()]
        return dict(zip(OF_LINK, others[rng.integers(len(others))], strict=True))
    name = slips[rng.integers(len(slips))]
    slip = SLIPS[name][rng.integers(len(SLIPS[name]))]
    return {"protocol": protocol, "format": form | {name: slip}}


def _reads(board: Board, entered: dict) -> bool:
    """Whether an entry reads what the right one does, as two descriptions may."""
    pictures = np.random.default_rng(board.seed).integers(1, 250, (9, *board.circuit.shape))
    data = board.bytes_of(pictures)
    read = [[f.samples for f in parser_of(e).feed(data)] for e in (entered, board.right)]
    return len(read[0]) == len(read[1]) and np.array_equal(*read)
