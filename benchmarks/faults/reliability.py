# SPDX-License-Identifier: Apache-2.0
"""Faults through the whole chain, counted: silent failures, missed pushes, false stops.

Every 10 ms the last published picture and the decision of the stop are compared with the truth. A
tick *fails* when the picture is wrong, see `fails`; it is *silent* if besides no stage doubts
anything and there is no stop but for a push. A push is *missed* if the robot was free
throughout, from 0.3 s after its start on, and *let go* if it was free at any time then. A fault is
there from the start, or begins in the stream.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from support.chain import Chain
from support.lab import touches
from support.lab.board import BINARY, KNOTS, TEXT, Fault, FaultBoard
from support.lab.damage import ELECTRICAL
from support.lab.touches import IDLE

from tactile_skin.bench.measure import GHOST
from tactile_skin.bench.stability import FAILS, FAILS_SHARE
from tactile_skin.middleware.threads import one_thread
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import GRAM, PressureCurve
from tactile_skin.physics.readouts import DRIVEN, PASSIVE

from .. import harness
from . import table
from .data import DATA

FAULTS = DATA + ELECTRICAL
TOTAL, TOTAL_SHARE = 5.0, 0.3  # N and share by which a total force is wrong
SOON = 0.3  # s in which a stop must come
_SLACK = 0.02  # s that a picture may lie behind, on top of the frame's own way
_DISC = np.hypot(*(np.indices((16, 16)) - 7.5)) < 8.2
SHAPES = {
    "2x2": Circuit(2, 2),
    "1x8": Circuit(1, 8),
    "4x4": Circuit(4, 4),
    "3x20": Circuit(3, 20),
    "8x8": Circuit(8, 8),
    "8x16": Circuit(8, 16),
    "16x16": Circuit(16, 16),
    "disc": Circuit(16, 16, mask=_DISC),
    "32x32": Circuit(32, 32),
}
PUBLISHED = tuple(SHAPES)
SHAPES |= {
    f"{n}x{n}-{readout}-{driven}": Circuit(n, n, readout=readout, driven=driven)
    for n in (4, 8, 16)
    for readout in PASSIVE[1:]
    for driven in DRIVEN
}
SOUND = (  # protocol, readout, noise of a sample [ADC steps], whether its noise is configured
    (BINARY, "low-pass", 0.3, True),
    (BINARY, "low-pass", 1.0, True),
    (BINARY, "low-pass", 2.0, True),
    (BINARY, "single", 0.3, True),
    (BINARY, "single", 1.0, True),
    (BINARY, "single", 2.0, True),
    (TEXT, "single", 0.3, True),
    (TEXT, "single", 1.0, True),
    (TEXT, "mean of 4", 0.3, True),
    (TEXT, "mean of 4", 1.0, True),
    (TEXT, "mean of 4", 2.0, True),
    (TEXT, "low-pass", 1.0, True),
    # what happens to somebody who leaves `noise` as it is shipped
    (BINARY, "low-pass", 2.0, False),
    (BINARY, "single", 1.0, False),
    (TEXT, "mean of 4", 1.0, False),
)
_LEFT = {"low-pass": (3 / 13) ** 0.5, "single": 1.0, "mean of 4": 0.5}  # of a sample's noise
_NOISE = 1.0  # RMS of a sample where a fault is tried [ADC steps]
_CHUNK = 30.0  # s of a sound stream that are drawn at once
FULL = {  # arguments of `measure`
    "shapes": PUBLISHED,
    "faults": FAULTS,
    "streams": 1,
    "seconds": 16.0,
    "minutes": 60.0,
}
QUICK = FULL | {"shapes": ("4x4", "8x8"), "faults": FAULTS[::8], "seconds": 6.0, "minutes": 1.0}


@dataclass
class Record:
    """What one stream did to the chain, an entry each KNOTS-th of a second.

    Attributes:
        truth, found: (n, rows, cols) [N].
        stopped: whether the robot was; faulted: whether for another reason than a push; doubts:
            whether any stage reports more than OK.
        reasons: why, where `faulted` begins.
    """

    truth: np.ndarray
    found: np.ndarray
    stopped: np.ndarray
    faulted: np.ndarray
    doubts: np.ndarray
    reasons: list[str]


def play(chain, arriving, force: np.ndarray, start: int = 0) -> Record:
    """Let bytes arrive while the force is there.

    Args:
        chain: see `Chain`.
        arriving: (t [s], bytes), in order; those that come later than the last knot are not used.
        force: (n, rows, cols) [N] at the knots that follow number `start`.
    """
    n, arriving = len(force), iter(arriving)
    found = np.zeros(force.shape, np.float32)
    flags = np.zeros((3, n), bool)
    reasons: list[str] = []
    due = next(arriving, None)
    for k in range(n):
        t = (start + k + 1) / KNOTS
        while due is not None and due[0] <= t:
            at, data = due
            while (due := next(arriving, None)) is not None and due[0] == at:
                data += due[1]  # what arrives together is read together
            chain.feed(at, data)
        chain.until(t)
        found[k] = chain.force
        faulted = chain.stop and not chain.for_push_alone
        if faulted and not (k and flags[1, k - 1]):
            reasons.append(chain.reason)
        flags[:, k] = chain.stop, faulted, chain.doubts
    return Record(force, found, *flags, reasons)


def fails(record: Record, lag: float, end: float) -> np.ndarray:
    """(n,) whether the picture is wrong by all that was there within the last `lag` [s]: its mean
    error on the cells that are touched, or said to be, exceeds 30 g and a fifth of their load, or
    its total is off by 5 N and 30 %.

    The error of a cell is its distance from the range of the true forces: in a picture that is
    taken while a force changes, each reading has its own instant.

    Args:
        end: of the curve [N]: more on a cell cannot be measured.
    """
    truth, found = np.minimum(record.truth, end), record.found
    low, high = (_latest(truth, lag, f) for f in (np.minimum, np.maximum))
    touched = np.maximum(high, found) > GHOST * GRAM
    cells = np.maximum(touched.sum((1, 2)), 1)
    error = np.maximum(np.maximum(low - found, found - high), 0.0)
    error = (error * touched).sum((1, 2)) / cells
    load = (high * touched).sum((1, 2)) / cells
    bad = error > np.maximum(FAILS * GRAM, FAILS_SHARE * load)
    total, measured = truth.sum((1, 2)), found.sum((1, 2))
    low, high = (_latest(total, lag, f) for f in (np.minimum, np.maximum))
    off = np.maximum(low - measured, measured - high)
    return bad | (off > np.maximum(TOTAL, TOTAL_SHARE * high))


def _latest(values: np.ndarray, lag: float, pick) -> np.ndarray:
    """Smallest or largest of each knot and those within `lag` [s] before it."""
    result = values.copy()
    for back in range(1, int(np.ceil(lag * KNOTS)) + 1):
        result[back:] = pick(result[back:], values[:-back])
    return result


def count(record: Record, pushes, onset: int, lag: float, end: float, begin: int) -> dict:
    """The numbers of one stream, from the knot `onset` on.

    Args:
        pushes: (first, behind the last) knot of each.
        begin: knot from which a stop counts as the answer to the fault.
    """
    bad = fails(record, lag, end)[onset:]
    quiet = ~(record.doubts | record.faulted)[onset:]
    free = ~record.stopped
    soon = round(SOON * KNOTS)
    late = [free[a + soon : b] for a, b in pushes if a >= onset and b - a > soon]
    reports = np.flatnonzero(record.faulted[begin:])
    return {
        "frames": len(bad),
        "failing": int(bad.sum()),
        "silent": int((bad & quiet).sum()),
        "silent_free": int((bad & quiet & free[onset:]).sum()),
        "pushes": len(late),
        "missed": sum(bool(x.all()) for x in late),
        "let_go": sum(bool(x.any()) for x in late),
        "free": int(free[onset + soon :].sum()),
        "to_stop": [float(reports[0] / KNOTS) if reports.size else None],
    }


def configured(protocol: str, readout: str, noise: float) -> dict:
    """What config/skin.yaml asks its user to write down: node -> parameters.

    Args:
        noise: RMS of a sample [ADC steps].
    """
    grid = 0.0 if protocol == BINARY and readout == "low-pass" else 1.0 / 12.0  # of whole steps
    samples = (noise**2 + 1.0 / 12.0) * _LEFT[readout] ** 2
    settings = {"compensation": {"noise": float(np.sqrt(samples + grid))}}
    return settings | (
        {"stop_on_push": {"lead": 0.0, "debounce": 0.01}} if protocol == TEXT else {}
    )


# --- streams ------------------------------------------------------------------------------------


def run_fault(shape: str, name: str, protocol: str, early: bool, seconds: float, seed) -> dict:
    """One stream of a fault of this name: `count`, and `held`, [whether the robot never was free]
    from SOON after its begin on, or while a hand pressed if the link stalls."""
    fault = next(f for f in FAULTS if f.name == name)
    circuit, curve = SHAPES[shape], PressureCurve()
    rng = np.random.default_rng(seed)
    draw = touches.long_pushes if fault.stalls else touches.everyday
    scene = draw(circuit.populated, seconds, rng, curve.max_force)
    pushes = scene.pushes()
    readout = "low-pass" if protocol == BINARY else "mean of 4"
    board = FaultBoard(circuit, curve, rng, _NOISE, protocol, readout)
    board.pushes = [(a / KNOTS, b / KNOTS) for a, b in pushes]
    first = 0 if early else round((IDLE + rng.uniform(1.0, 0.4 * seconds)) * KNOTS)
    onset = round(IDLE * KNOTS) if fault.stalls else first
    arriving = board.advance(scene.force[:onset]) if onset else []
    board.damaged_at = board.t
    fault.damage(board)
    arriving += board.advance(scene.force[onset:])
    chain = Chain(circuit, protocol, configured(protocol, readout, _NOISE))
    try:
        record = play(chain, arriving, scene.force)
    finally:
        chain.close()
    onset = max(onset, round(board.damaged_at * KNOTS))
    begin = max(onset, round(IDLE * KNOTS))
    lag = 1.0 / board.rate + board.on_the_way + _SLACK
    found = count(record, pushes, onset, lag, curve.max_force, begin)
    dead = slice(onset + round(SOON * KNOTS), onset + 2 * KNOTS if fault.live_again else None)
    held = not (found["let_go"] if fault.stalls else (~record.stopped[dead]).any())
    return found | {"held": [held], "reasons": record.reasons[-1:], "errors": chain.errors}


def run_sound(
    shape: str, protocol: str, readout: str, noise: float, noise_given: bool, seconds: float, seed
) -> dict:
    """A sound board for so long: `count`, `touches`, `false_stops` and the frames in them."""
    circuit, curve = SHAPES[shape], PressureCurve()
    rng = np.random.default_rng(seed)
    board = FaultBoard(circuit, curve, rng, noise, protocol, readout)
    parameters = configured(protocol, readout, noise)
    if not noise_given:
        del parameters["compensation"]
    chain = Chain(circuit, protocol, parameters)
    total: dict = {}
    lag, n, before = 1.0 / board.rate + board.on_the_way + _SLACK, 0, False
    pending: list[tuple[float, bytes]] = []
    while n < seconds * KNOTS:
        length = min(_CHUNK, max(seconds - n / KNOTS, 2 * IDLE))
        scene = touches.everyday(circuit.populated, length, rng, curve.max_force, False)
        pending += board.advance(scene.force)
        end = (n + len(scene.force)) / KNOTS
        now = [pair for pair in pending if pair[0] <= end]
        pending = pending[len(now) :]
        record = play(chain, now, scene.force, n)
        begin = 0 if n else round(IDLE * KNOTS)
        found = count(record, scene.pushes(), begin, lag, curve.max_force, begin)
        del found["to_stop"]
        edges = np.diff(np.concatenate([[before], record.faulted[begin:]]).astype(int)) > 0
        found |= {
            "touches": len(scene.touches),
            "false_stops": int(edges.sum()),
            "stopped": int(record.faulted[begin:].sum()),
            "reasons": _later(record, begin),
        }
        total = add(total, found)
        before, n = bool(record.faulted[-1]), n + len(scene.force)
    errors = chain.errors
    chain.close()
    return total | {"errors": errors}


def _later(record: Record, begin: int) -> list[str]:
    """The reasons of stops that begin at that knot or later."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], record.faulted]).astype(int)) > 0)
    return [reason for k, reason in zip(edges, record.reasons, strict=True) if k >= begin]


def add(total: dict, found: dict) -> dict:
    """Sums of numbers, lists one behind the other."""
    return {key: total.get(key, type(value)()) + value for key, value in found.items()}


# --- everything -----------------------------------------------------------------------------------


def _task(arguments) -> dict:
    kind, *rest = arguments
    with one_thread():
        return (run_fault if kind == "fault" else run_sound)(*rest)


def named(names) -> tuple[Fault, ...]:
    """The faults of these names, or of the classes "dead" and "electrical", in their order.

    Raises:
        ValueError: there is no such fault.
    """
    classes = {"dead": DATA, "electrical": ELECTRICAL} | {f.name: (f,) for f in FAULTS}
    unknown = [name for name in names if name not in classes]
    if unknown:
        raise ValueError(f"fault {unknown[0]!r}: must be one of {', '.join(classes)}")
    wanted = {fault.name for name in names for fault in classes[name]}
    return tuple(fault for fault in FAULTS if fault.name in wanted)


def measure(
    shapes,
    faults,
    streams: int,
    seconds: float,
    minutes: float,
    seed: int,
    track=lambda items, **_: items,
    jobs: int | None = None,
) -> dict:
    """Streams of each fault on each shape, and sound streams.

    Args:
        shapes: names in SHAPES.
        faults: of FAULTS.
        streams: of each fault and protocol, each way to begin.
        seconds: of a stream.
        minutes: of sound streams, shared out among shapes and boards.
        jobs: processes; None: one a core.

    Returns:
        the figure "faults" as plain data: `faults` and `sound`, lists of rows.
    """
    rows = [(s, f, p) for s in shapes for f in faults for p in f.protocols]
    tasks = [
        ("fault", s, f.name, p, early, seconds, harness.seed_of(seed, s, f.name, p, early, k))
        for s, f, p in rows
        for early in ((True,) if f.stalls else (True, False))
        for k in range(streams)
    ]
    boards = [(s, *board) for s in shapes for board in SOUND]
    share = 60.0 * minutes / len(boards)
    sound = [("sound", *b, share, harness.seed_of(seed, *b)) for b in boards if minutes]
    results = list(harness.spread(_task, tasks + sound, jobs, track))
    found = {(s, f.name, p): {} for s, f, p in rows}
    for (_, s, name, p, *_), result in zip(tasks, results, strict=False):
        found[s, name, p] = add(found[s, name, p], result)
    return {
        "faults": {
            "streams": streams,
            "stream_s": seconds,
            "minutes": minutes,
            "faults": [
                {"shape": s, "fault": f.name, "protocol": p, "must_stop": f.must_stop}
                | found[s, f.name, p]
                for s, f, p in rows
            ],
            "sound": [
                dict(
                    zip(
                        ("shape", "protocol", "readout", "noise", "noise_given"),
                        task[1:],
                        strict=False,
                    )
                )
                | result
                for task, result in zip(sound, results[len(tasks) :], strict=True)
            ],
        }
    }


DRAW = {"faults": table.draw}
