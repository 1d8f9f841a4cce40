# SPDX-License-Identifier: Apache-2.0
"""Boards that are richer than the solvers' model, and what is wrong with what is entered of them.

Each has a fabric of its own: cells that scatter by 5 to 8 % and by 3 % at rest, 0.5 % carried to
the neighbours, a curve of another level and shape, loads that creep, stripes that are not ideal;
frames are made of noisy scans of 10 or 12 bits, 12 to 100 times a second.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from support.lab.board import BOTH, KNOTS, READOUTS, FaultBoard, Sent
from support.lab.unknown import Unknown
from support.strangers.sim import finger

from tactile_skin import Circuit, PressureCurve
from tactile_skin.parameters.nodes import all_names
from tactile_skin.simulation.network import Wiring

from ..calibration.curve_fit import bend
from ..faults.reliability import configured

WIRED = "floating", "loaded", "grounded", "virtual_ground"
RATES = 12.0, 20.0, 25.0, 40.0, 100.0  # frames a second, the first three of 16 x 16
STRIPE = 6.0  # ohm, at most; of floating boards of 8 x 8: others take minutes to solve
R_PAR_STD = 3.0  # ohm, that calibrate writes with a proof, as a rule
CREEP = 0.1, 0.25  # share of a decade: reviews of real fabric find 0.1 to 0.4
BEGINS = 0.03  # s after which it does, by the same
SETTLED = 1.0  # s of a load to which the true curve belongs
FABRIC = 0.5, 2.0  # times which another fabric conducts
WAVE = 0.3  # of its curve's shape, as in calibration.curve_fit
CELLS = 8, 16, 8  # along each side, of four boards each
_OHM = {  # r_ref, r_par of a board whose palms are within its range [ohm]
    "floating": (1780.0, 326.0),
    "loaded": (1000.0, 25.0),
    "grounded": (300.0, 25.0),
    "virtual_ground": (200.0, 25.0),
}
_EDGE = np.linspace(-2.0, 2.0, 9)  # cells along it
_TEXTURE = 0.15  # RMS, as in support.lab.touches


@dataclass
class Case:
    """One board, and what its owner entered.

    Attributes:
        board: as it truly is; entered: its circuit as the skin is given it.
        given: node -> parameters; rng: of its scene and noise.
        late: changes the board when it is called; None: it is as it is from the start.
    """

    board: FaultBoard
    entered: Circuit
    given: dict
    rng: np.random.Generator
    creep: float = 0.0
    late: Callable[[], None] | None = field(default=None)


def draw(wired: str, k: int, seed, proof: str = "none", creep: bool = True) -> Case:
    """Return board number k of this readout, rightly entered.

    Args:
        proof: "none", or "weight": the curve was proved today, to 5 %.
    """
    rng = np.random.default_rng(seed)
    (r_ref, r_par), n = _OHM[wired], CELLS[k // len(WIRED) % len(CELLS)]
    bits = 12 if wired == "virtual_ground" else int(rng.choice((10, 12)))
    driven = "rows" if wired == "floating" else str(rng.choice(("rows", "columns")))
    circuit = Circuit(n, n, r_ref, r_par, bits, readout=wired, driven=driven)
    curve = Unknown((2, 2), int(rng.integers(2**31))).curve
    protocol, readout = str(rng.choice(BOTH)), str(rng.choice(READOUTS))
    noise = rng.uniform(0.3, 1.5)
    board = FaultBoard(circuit, curve, rng, noise, protocol, readout)
    board.rate = min(board.rate, float(rng.choice(RATES if n == min(CELLS) else RATES[:3])))
    if wired == "floating" and n == min(CELLS):
        board.matrix.wiring = Wiring.ideal(circuit, rng.uniform(0.0, STRIPE))
    given = configured(protocol, readout, noise)
    if rng.integers(2):
        del given["compensation"]  # its owner leaves `noise` as it is shipped: it is measured
    for node in ("compensation", "gesture_feature", "stop_on_push"):
        of = _curve(curve) | {
            "curve.proof": proof,
            "curve.proof_error": 0.05,
            "curve.proof_date": datetime.date.today().isoformat() if proof != "none" else "",
        }
        if proof != "none":
            of["circuit.r_par_std"] = R_PAR_STD
        known = all_names(node)  # an older checkout knows no proof
        given[node] = given.get(node, {}) | {k: v for k, v in of.items() if k in known}
    return Case(board, circuit, given, rng, rng.uniform(*CREEP) if creep else 0.0)


def _curve(curve: PressureCurve) -> dict:
    force, resistance = zip(*curve.points, strict=True)
    return {"curve.force": list(force), "curve.resistance": list(resistance)}


# --- what is wrong: each changes a case ----------------------------------------------------------


def _r_par(ohm: float):
    return lambda case: setattr(case, "entered", replace(case.entered, r_par=ohm))


def _r_ref(times: float):
    def wrong(case: Case) -> None:
        case.entered = replace(case.entered, r_ref=times * case.entered.r_ref)

    return wrong


def _supply(case: Case) -> None:
    case.board.converter.gain = lambda t: 0.6


def _full_scale(case: Case) -> None:
    for node in ("serial_driver", "compensation"):
        full = 2000.0 / 1023.0 * case.entered.full_scale
        case.given.setdefault(node, {})["circuit.adc_full_scale"] = full


def _fabric(case: Case) -> None:
    rng, board = case.rng, case.board
    skin = Unknown((2, 2), int(rng.integers(2**31)))
    bend(skin, WAVE, rng.uniform(0.0, 2.0 * np.pi))
    times = np.exp(rng.uniform(*np.log(FABRIC)))
    force, resistance = np.array(skin.curve.points).T
    board.matrix.fabric.curve = PressureCurve(force, resistance / times)
    board.matrix.fabric.rest *= times
    for node in ("compensation", "gesture_feature", "stop_on_push"):
        of = case.given.get(node, {})
        case.given[node] = {k: v for k, v in of.items() if k not in _curve(skin.curve)}


def _readout(case: Case) -> None:
    others = [each for each in WIRED if each != case.entered.readout]
    driven = case.entered.driven
    other = str(case.rng.choice(others))
    case.entered = replace(
        case.entered, readout=other, driven="rows" if other == "floating" else driven
    )


def stuck(case: Case) -> int:
    """Let a bit of a sample stick, from the start or later; return its number."""
    bits, rng = case.entered.adc_bits, case.rng
    bit, high = int(rng.integers(2, bits)), bool(rng.integers(2))

    def damage() -> None:
        if high:
            case.board.converter.or_mask |= 1 << bit
        else:
            case.board.converter.and_mask &= ~(1 << bit)

    if rng.integers(2):
        case.late = damage
    else:
        damage()
    return bit


WRONG = {  # name -> what is done to a case, the readouts on which it can be
    "r_par 0 for 326": (_r_par(0.0), WIRED[:1]),
    "r_par 163 for 326": (_r_par(163.0), WIRED[:1]),
    "r_par 220 for 326": (_r_par(220.0), WIRED[:1]),
    "supply 40 % low": (_supply, WIRED),
    "r_ref twice the true": (_r_ref(2.0), WIRED),
    "r_ref ten times the true": (_r_ref(10.0), WIRED),
    "full scale 2000 for 1023": (_full_scale, WIRED),
    "another fabric": (_fabric, WIRED),
    "another readout": (_readout, WIRED),
    "a stuck bit": (stuck, WIRED),
}
LAWS = "exponential", "linear", "steps"
# what is added to a reading [ADC steps]; None: the mean at rest, which no reading gives away
ZEROS = None, 600.0, None, 100.0, None, 0.0
OLD = 0.0, 0.05  # of a baseline: what a fabric's rest moves by in days
_SPAN = 0.3  # of the range, that a linear baseline goes in its time
_STEPS = 3  # of a baseline in its time, half of the way each


class MovingZero:
    """A `tamper` of a board whose firmware takes a baseline off that follows the reading.

    Args:
        law: one of LAWS; seconds: in which the baseline follows.
        zero: one of ZEROS.
        old: relative RMS by which the baseline is off at the start, one of an earlier day.
    """

    def __init__(
        self, board: FaultBoard, law: str, seconds: float, zero: float | None, old: float = 0.0
    ):
        self.rng, self.old = board.rng, old
        self.one = 2**board.fraction_bits  # ADC step
        self.top = self.one * board.circuit.full_scale
        self.law, self.seconds, self.zero = law, seconds, zero
        self.span = _SPAN * board.circuit.full_scale / seconds  # ADC steps a second
        self.base: np.ndarray | None = None
        self.t = self.stepped = 0.0

    def __call__(self, sent: Sent) -> Sent:
        read = sent.samples / self.one
        if self.base is None:
            self.t = sent.t
            self.base = read * np.exp(self.old * self.rng.standard_normal(read.shape))
            self.zero = read.mean() if self.zero is None else self.zero
        printed = np.rint((read - self.base + self.zero) * self.one)
        ahead, passed = read - self.base, sent.t - self.t
        self.t = sent.t
        if self.law == "exponential":
            self.base += ahead * min(1.0, passed / self.seconds)
        elif self.law == "linear":
            self.base += np.clip(ahead, -self.span * passed, self.span * passed)
        elif self.t - self.stepped >= self.seconds / _STEPS:
            self.base, self.stepped = self.base + 0.5 * ahead, self.t
        return replace(sent, samples=np.clip(printed, 0, self.top).astype(np.int64))


# --- what presses ---------------------------------------------------------------------------------


def crept(course: np.ndarray, share: float) -> np.ndarray:
    """(n,) times which a load that is there in this course conducts, over its true curve."""
    gained = 1.0 + share * np.log10(1.0 + np.arange(len(course)) / KNOTS / BEGINS)
    step = gained / (1.0 + share * np.log10(1.0 + SETTLED / BEGINS))
    return np.convolve(np.diff(course, prepend=0.0), step)[: len(course)]


def pressed(kind: str, shape: tuple[int, int], rng) -> np.ndarray:
    """(rows, cols) of 1 N by a palm, a finger or an edge, somewhere well on the skin."""
    row, col = (rng.uniform(0.25, 0.75) * (n - 1) for n in shape)
    if kind == "edge":
        turn = rng.uniform(0.0, np.pi)
        along = [(row + s * np.sin(turn), col + s * np.cos(turn)) for s in _EDGE]
        picture = np.mean([finger(shape, *at, 1.0, 0.6) for at in along], 0)
    else:
        picture = finger(shape, row, col, 1.0, rng.uniform(*_WIDTH[kind]))
    picture = picture * np.exp(_TEXTURE * rng.standard_normal(shape))
    return picture / picture.sum()


_WIDTH = {"palm": (1.3, 2.4), "finger": (0.9, 1.2)}  # standard deviation [cells]
