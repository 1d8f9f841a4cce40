# SPDX-License-Identifier: Apache-2.0
"""Streams of bytes through the complete chain: damaged boards, sound boards, a wrong description.

The bytes of each are made once, and played as often as mechanisms are switched off, on a driven
clock.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from support.chain import Chain
from support.lab import touches
from support.lab.board import BINARY, KNOTS, FaultBoard
from support.lab.damage import ELECTRICAL
from support.lab.touches import IDLE

from tactile_skin.health import skin
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve

from ..faults.data import DATA
from ..faults.reliability import (
    _NOISE,
    _SLACK,
    FAULTS,
    SHAPES,
    SOON,
    SOUND,
    configured,
    count,
    play,
)
from .mechanisms import changes, sweep
from .switchboard import Memo, Switchboard

SECONDS = 12.0  # of a damaged stream
LONG = 45.0  # s of a sound stream, and of some damaged ones
_BITS = 2, 5, 7, 9  # of the eight bits that may stick, those that are tried
_LONG_FAULTS = "swapped lines", "r_par +10 %", "short of neighbours", "bad lead"
FAULT, SOUND_BOARD, DESCRIPTION = "fault", "sound", "wrong description"
_DRIVEN = "-loaded-rows", "-grounded-rows"
_LATE = 0.1  # s by which a stop may begin before, and end after, the push that it is for


class Stream(NamedTuple):
    """What to draw.

    Attributes:
        kind: FAULT, SOUND_BOARD or DESCRIPTION.
        shape: of `SHAPES`, the board.
        taken_for: of `SHAPES`, what the configuration says.
        name: of a fault; or of a sound board, its number in SOUND.
        early: whether a fault is there from the start.
        noise_given: whether the configuration has the noise; as shipped it has not.
        seconds: its length.
    """

    kind: str
    shape: str
    taken_for: str
    name: str
    early: bool
    noise_given: bool
    seconds: float


def plan() -> list[Stream]:
    """Return all streams, in the order in which they are worth measuring."""

    def damaged(shape, faults, early=(True, False), noise_given=False, seconds=SECONDS):
        return [
            Stream(FAULT, shape, shape, f.name, e, noise_given, seconds)
            for f in faults
            for e in ((True,) if f.stalls else early)
        ]

    def sound(shape, numbers):
        return [
            Stream(SOUND_BOARD, shape, shape, str(k), True, given, LONG)
            for k in numbers
            for given in ((SOUND[k][3],) if k % 3 else (True, False))
        ]

    left_out = {f"bit {k} stuck at {v}" for k in range(2, 10) if k not in _BITS for v in (0, 1)}
    wires = [f for f in ELECTRICAL if f.name not in left_out]
    readouts = [f for f in wires if not f.name.startswith(("bit", "saturated", "amplifier"))]
    long = [f for f in wires if f.name in _LONG_FAULTS]
    pairs = [p for p in itertools.permutations(("8x8", *("8x8" + d for d in _DRIVEN)), 2)]
    return [
        *damaged("8x8", wires),
        *(Stream(DESCRIPTION, a, b, f"{a} as {b}", True, False, SECONDS) for a, b in pairs),
        *sound("8x8", range(0, len(SOUND), 2)),
        *damaged("8x8", DATA, early=(False,)),
        *itertools.chain(*(damaged("8x8" + d, readouts, early=(False,)) for d in _DRIVEN)),
        *damaged("16x16", readouts, early=(False,)),
        *sound("8x8-loaded-rows", (1, 9)),
        *sound("8x8-grounded-rows", (1, 9)),
        *sound("16x16", (1, 4, 9, 12)),
        *damaged("8x8", long, seconds=LONG),
        *sound("8x8", range(1, len(SOUND), 2)),
        *damaged("16x16", DATA, early=(False,)),
        *damaged("8x8", long, noise_given=True),
    ]


@dataclass(frozen=True)
class Drawn:
    """A stream's bytes, and what is true.

    Attributes:
        circuit, protocol, parameters: of the configuration.
        arriving: (t [s], bytes) in order.
        force: (n, rows, cols) [N] at the knots.
        pushes: (first, behind the last) knot of each.
        onset, begin: knots from which on frames, and stops, count.
        lag: s by which a picture may lie behind.
        dead: knots at which the robot must not be free; None: it need not be stopped.
        stalls: whether it need be stopped under pushes only.
    """

    circuit: Circuit
    protocol: str
    parameters: dict
    arriving: list
    force: np.ndarray
    pushes: list
    onset: int
    begin: int
    lag: float
    dead: slice | None = None
    stalls: bool = False


def draw(stream: Stream, seed) -> Drawn:
    """Make the bytes of a stream."""
    true, curve, rng = SHAPES[stream.shape], PressureCurve(), np.random.default_rng(seed)
    protocol, readout, noise = BINARY, "low-pass", _NOISE
    if stream.kind == SOUND_BOARD:
        protocol, readout, noise, _ = SOUND[int(stream.name)]
    fault = next((f for f in FAULTS if f.name == stream.name), None)
    scene_of = touches.long_pushes if fault and fault.stalls else touches.everyday
    hard = () if stream.kind == FAULT else (False,)  # no edge beyond the curve's end
    scene = scene_of(true.populated, stream.seconds, rng, curve.max_force, *hard)
    pushes = scene.pushes()
    parameters = configured(protocol, readout, noise)
    if not stream.noise_given:
        del parameters["compensation"]
    board = FaultBoard(true, curve, rng, noise, protocol, readout)
    board.pushes = [(a / KNOTS, b / KNOTS) for a, b in pushes]
    first = 0 if stream.early else round((IDLE + rng.uniform(1.0, 0.4 * stream.seconds)) * KNOTS)
    onset = round(IDLE * KNOTS) if fault and fault.stalls else first
    arriving = board.advance(scene.force[:onset]) if onset else []
    if fault:
        board.damaged_at = board.t
        fault.damage(board)
    arriving += board.advance(scene.force[onset:])
    begin = round(IDLE * KNOTS)
    onset = max(onset, round(board.damaged_at * KNOTS)) if fault else begin
    lag = 1.0 / board.rate + board.on_the_way + _SLACK
    drawn = Drawn(SHAPES[stream.taken_for], protocol, parameters, arriving, scene.force, pushes,
                  onset, max(onset, begin), lag)  # fmt: skip
    if not (fault and fault.must_stop):
        return drawn
    end = onset + 2 * KNOTS if fault.live_again else None
    return replace(drawn, dead=slice(onset + round(SOON * KNOTS), end), stalls=fault.stalls)


def numbers(drawn: Drawn, memo: Memo) -> dict:
    """Play a stream and count.

    Returns:
        of `count`: frames, failing, silent, pushes, missed; lost, whether a stop that must be held
        was not; stopped, ticks stopped for another reason than a push; warned, ticks with a report
        and no such stop; false_stops, times that such a stop began; needless, ticks stopped for a
        push where none is; solved, refused, frames, and those in doubt or failed.
    """
    chain = Chain(drawn.circuit, drawn.protocol, drawn.parameters)
    memo.forget_counts()  # the nodes try a frame while they start
    try:
        record = play(chain, drawn.arriving, drawn.force)
    finally:
        chain.close()
    most = PressureCurve().max_force
    found = count(record, drawn.pushes, drawn.onset, drawn.lag, most, drawn.begin)
    after, faulted = slice(drawn.begin, None), record.faulted
    begins = np.diff(faulted.astype(int), prepend=0)[after] > 0
    lost = drawn.dead is not None and bool(
        found["let_go"] if drawn.stalls else (~record.stopped[drawn.dead]).any()
    )
    return {key: found[key] for key in ("frames", "failing", "silent", "pushes", "missed")} | {
        "lost": int(lost),
        "stopped": int(faulted[after].sum()),
        "warned": int((record.doubts & ~faulted)[after].sum()),
        "false_stops": int(begins.sum()),
        "needless": int(_needless(record.stopped & ~faulted, drawn.force)[after].sum()),
        "solved": sum(memo.counts.values()),
        "refused": sum(n for status, n in memo.counts.items() if status != "ok"),
    }


def _needless(stopped: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(n,) ticks of stops for a push during which the true force never was one."""
    pushed = (force.sum((1, 2)) >= touches.PUSH) | (force.max((1, 2)) >= touches.PEAK)
    near, needless = round(_LATE * KNOTS), np.zeros(len(stopped), bool)
    for first, last in touches._runs(stopped):
        needless[first:last] = not pushed[max(first - near, 0) : last + near].any()
    return needless


def measure(board: Switchboard, stream: Stream, seed) -> dict:
    """Return a stream with its numbers by variant."""
    drawn, compensate = draw(stream, seed), skin.compensate
    skin.compensate = memo = Memo(board, compensate)
    try:
        results, spoke = sweep(board, lambda: numbers(drawn, memo), False)
    finally:
        skin.compensate = compensate
    more = {"must_stop": drawn.dead is not None, "spoke": sorted(spoke)}
    return stream._asdict() | more | {"results": changes(results)}
