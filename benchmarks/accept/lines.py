# SPDX-License-Identifier: Apache-2.0
"""The lines of the table: the streams that each plays, and the figures that they come to."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_skin.middleware.threads import one_thread

from .. import harness
from ..faults import reliability
from ..running.touch_to_stop import CUT_LIMIT_MS, LIMIT_MS
from . import others, presses, rests, weighed
from .boards import WIRED, WRONG

SHAPES = "8x8", "16x16", "8x8-loaded-rows", "8x8-grounded-columns", "8x8-loaded-columns"
STREAM = 8.0  # s of one with a fault
SOUND = 30.0  # s of a sound one
# streams or boards of a line, chosen so that all lines take 15 minutes of two cores
SOUNDS = 15
PLANTED = 24
IN_USE = 18
IDENTIFIED = 9
FITTED = 6
OBEYING = 18
ROUNDS = 2  # boards of each wrong entry and readout
MOVING = 24
PUSHED = 12
STUCK = 40
WEIGHED = 12
RESTS = 20  # of each kind
TOGETHER = 3  # boards of another benchmark that a process takes at once


class Figure(NamedTuple):
    """One number of the table.

    Attributes:
        of: what it is a share of; None: it is none.
        bound: at most, or with `least` at least; of a share if it is one. None: there is none.
    """

    name: str
    value: float
    of: float | None = None
    bound: float | None = None
    least: bool = False

    @property
    def measured(self) -> float:
        return self.value if self.of is None else self.value / max(self.of, 1)

    @property
    def met(self) -> bool | None:
        if self.bound is None:
            return None
        return self.measured >= self.bound if self.least else self.measured <= self.bound


class Asked(NamedTuple):
    """A figure that is asked for.

    Attributes:
        key, of: in the results of tasks; those that lack them do not count.
        take: what is made of the results' lists together; None: numbers are summed up.
        bound, least: as in Figure.
    """

    name: str
    key: str
    of: str | None = None
    bound: float | None = None
    least: bool = False
    take: Callable[[Any], float] | None = None

    def figure(self, results: list[dict]) -> Figure | None:
        """Return the figure; None: no result has it."""
        values = [result[self.key] for result in results if self.key in result]
        if not values:
            return None
        of = None if self.of is None else sum(r[self.of] for r in results if self.of in r)
        every = np.concatenate([np.atleast_1d(v) for v in values])
        value = float((self.take or np.sum)(every)) if len(every) else float("nan")
        return Figure(self.name, value, of, self.bound, self.least)


@dataclass(frozen=True)
class Line:
    """A line.

    Attributes:
        tasks: (seed, share of all streams, folder of recordings) -> list of (function, arguments).
        alone: whether it measures time, so that nothing else may run.
    """

    name: str
    about: str
    tasks: Callable[[int, float, Path], list]
    asked: tuple[Asked, ...]
    alone: bool = False

    def figures(self, results: list[dict]) -> list[Figure]:
        return [figure for asked in self.asked if (figure := asked.figure(results))]


def play(task) -> dict:
    """Return what a task comes to; nothing that it prints or logs is shown."""
    function, arguments = task
    quiet, before = io.StringIO(), logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with one_thread(), contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            return function(*arguments)
    finally:
        logging.disable(before)


def _some(n: int, share: float) -> int:
    return max(1, round(n * share))


def _faults(seed: int, share: float, data: Path) -> list:
    """A stream of every fault, on one shape after the other."""
    chosen = reliability.FAULTS[:: max(1, round(1 / share))]
    found = []
    for k, fault in enumerate(chosen):
        protocol = fault.protocols[k % len(fault.protocols)]
        key = SHAPES[k % len(SHAPES)], fault.name, protocol, fault.stalls or k % 2 == 0
        found.append((reliability.run_fault, (*key, STREAM, harness.seed_of(seed, *key))))
    return found


def _sound(seed: int, share: float, data: Path) -> list:
    """Sound boards of each kind, on one shape after the other."""
    found = []
    for k in range(_some(SOUNDS, share)):
        board = SHAPES[k % len(SHAPES)], *reliability.SOUND[k % len(reliability.SOUND)]
        found.append((reliability.run_sound, (*board, SOUND, harness.seed_of(seed, *board, k))))
    return found


def _boards(function: Callable, n: int, *first):
    """Tasks of `n` boards of every readout in turn."""

    def tasks(seed: int, share: float, data: Path) -> list:
        every = range(_some(n, share))
        seeds = [harness.seed_of(seed, function.__name__, k) for k in every]
        return [(function, (*first, WIRED[k % len(WIRED)], k, seeds[k])) for k in every]

    return tasks


def _entries(seed: int, share: float, data: Path) -> list:
    kinds = [(name, wired) for name, (_, on) in WRONG.items() for wired in on] * ROUNDS
    return [
        (presses.palms, (*kinds[k], k, harness.seed_of(seed, *kinds[k], k)))
        for k in range(0, len(kinds), max(1, round(1 / share)))
    ]


def _rests(seed: int, share: float, data: Path) -> list:
    found = []
    for k in range(_some(RESTS, share)):
        for kind in rests.KINDS:
            key = kind, WIRED[k % len(WIRED)], k
            found.append((rests.run, (*key, harness.seed_of(seed, *key))))
    return found


def _script(function: Callable, n: int, first: int):
    """Tasks of another benchmark whose boards are numbered from `first` on."""

    def tasks(seed: int, share: float, data: Path) -> list:
        boards, begin = _some(n, share), first + 100_000 * (seed - 1)
        return [
            (function, ("--boards", min(TOGETHER, boards - k), "--seed", begin + k))
            for k in range(0, boards, TOGETHER)
        ]

    return tasks


def _p99(values) -> float:
    return float(np.percentile(values, 99))


_PALMS = (
    Asked("palms ever free while they stand", "free", "palms", 0.0),
    Asked("palms missed", "missed", "palms", 0.0),
    Asked("palms let go early", "early", "palms", 0.0),
)
_PUSHES = (
    Asked("stopped by a fault", "faults", "pushes"),
    Asked("true force that stopped, median [N]", "true", take=np.median),
    Asked("true force that stopped, most [N]", "true", take=np.max),
    Asked("felt force that stopped, least [N]", "felt", None, presses.LEAST, True, np.min),
)
LINES = (
    Line(
        "frame",
        "time of a 16x16 frame of bodies, cold, and its error",
        lambda seed, share, data: [(others.frame, (seed, max(30, _some(300, share))))],
        tuple(
            Asked(f"{method}: {name}", f"{method} {key}")
            for method in others.TIMED
            for name, key in (("p50 [y]", "p50_y"), ("p99 [y]", "p99_y"), ("error [g]", "mean_g"))
        ),
        alone=True,
    ),
    Line(
        "stop",
        "from the scan that shows a push to the stop hook, in real time",
        lambda seed, share, data: [(others.stop, (_some(12, share), _some(3, share), seed))],
        (
            Asked("p50 [ms]", "ms", take=np.median),
            Asked("p99 [ms]", "ms", None, LIMIT_MS, take=_p99),
            Asked("pushes missed", "missed", "pushes", 0.0),
            Asked("cut cable, longest [ms]", "cut", None, CUT_LIMIT_MS, take=np.max),
        ),
        alone=True,
    ),
    Line(
        "faults",
        "streams with a fault, each of another kind",
        _faults,
        (
            Asked("silent frames", "silent", "frames", 0.009),
            Asked("failing frames", "failing", "frames"),
            Asked("pushes missed", "missed", "pushes", 0.0),
            Asked("pushes let go", "let_go", "pushes"),
            Asked("callbacks that raised", "errors", None, 0.0),
        ),
    ),
    Line(
        "sound",
        "sound boards in a day's touches",
        _sound,
        (
            Asked("false stops", "false_stops", None, 0.0),
            Asked("frames stopped without a push", "stopped", "frames"),
            Asked("failing frames", "failing", "frames"),
            Asked("pushes missed", "missed", "pushes", 0.0),
        ),
    ),
    Line(
        "recordings",
        "what others recorded, configured rightly or as another readout",
        lambda seed, share, data: others.recordings(data, share),
        (
            Asked("insole: s in fault", "insole fault", "insole s", 0.02),
            Asked("cushion: s in fault", "cushion fault", "cushion s", 0.02),
            Asked("cushion: recordings believed", "cushions ok", "cushions", least=True),
            Asked("as floating: the same", "cushions as floating", "cushions", 4 / 42),
            Asked("as floating: the doctor names it", "readout named", "readouts", 1.0, True),
            Asked("insole: false findings of the doctor", "false findings", None, 0.0),
            Asked("garment: named as processed", "named processed", "garments", 1.0, True),
        ),
    ),
    Line(
        "planted",
        "one or two faults that the doctor is to name",
        _script(others.planted, PLANTED, 5000),
        (
            Asked("faults named", "named", "planted", least=True),
            Asked("boards with a finding too many", "false", "boards"),
        ),
    ),
    Line(
        "in use",
        "sound boards on which something always lies, by the doctor",
        _script(others.in_use, IN_USE, 71000),
        (Asked("boards with a false finding", "false", "boards"),),
    ),
    Line(
        "identify",
        "r_par and r_line of unknown boards",
        _script(others.identify, IDENTIFIED, 0),
        (
            Asked("r_par off, median [ohm]", "r_par", take=np.median),
            Asked("r_par off by more than 1 %", "beyond", "boards"),
            Asked("r_line off, median [ohm]", "r_line", take=np.median),
        ),
    ),
    Line(
        "curve",
        "newtons by ten objects of known weight",
        _script(others.curve, FITTED, 100),
        (
            Asked("a total is off, median [%]", "off", take=np.median),
            Asked("a total is off, p95 [%]", "off", take=lambda off: np.percentile(off, 95)),
        ),
    ),
    Line(
        "obey",
        "owners of wrong entries who obey what is said",
        _script(others.obey, OBEYING, 1000),
        (
            Asked("right in the end", "right", "boards", 0.88, True),
            Asked("free under a palm in the end", "free", "boards", 0.0),
            Asked("free under a palm on the way", "on the way"),
        ),
    ),
    Line(
        "weighed",
        "boards with one wrong entry that are calibrated with known weights",
        _boards(weighed.run, WEIGHED),
        (
            Asked("proved with a wrong scale", "wrongly proved", "boards", 0.0),
            Asked("proved", "proved", "boards", least=True),
            Asked("wrong scale", "wrong", "boards"),
            *_PALMS,
        ),
    ),
    Line(
        "entries",
        "palms of 45 N on boards with one wrong entry or fault",
        _entries,
        (*_PALMS, *(Asked(f"ever free: {n}", f"free, {n}", f"palms, {n}", 0.0) for n in WRONG)),
    ),
    Line(
        "moving",
        "palms of 45 N on boards that move their zero",
        _boards(presses.moving, MOVING),
        (
            Asked("boards held until let go", "held", "boards", 1.0, True),
            Asked("boards free before the first palm", "live", "boards"),
            *_PALMS,
        ),
    ),
    Line(
        "rests",
        "sound boards that are open, uneven, signed or shaken at rest",
        _rests,
        (
            Asked("boards free at 2 s", "at once", "boards", 1.0, True),
            *(Asked(f"ever free: {k}", f"live, {k}", f"of {k}", 1.0, True) for k in rests.KINDS),
            *(Asked(f"in fault: {k}", f"fault, {k}", f"idle, {k}", 0.02) for k in rests.KINDS),
            Asked("palms felt within 5 %", "near", "palms", least=True),
            Asked("palms felt, median of the true", "ratios", take=np.median),
            *_PALMS,
        ),
    ),
    Line(
        "proved",
        "pushes to 60 N on right boards whose newtons were proved",
        _boards(presses.pushes, PUSHED, "weight"),
        (Asked("stopped within 20 to 45 N true", "within", "pushes", 0.99, True), *_PUSHES),
    ),
    Line(
        "not proved",
        "the same pushes, nothing proved the newtons",
        _boards(presses.pushes, PUSHED, "none"),
        (Asked("stopped within 20 to 45 N true", "within", "pushes", least=True), *_PUSHES),
    ),
    Line(
        "bits",
        "a bit of the converter sticks, from the start or later",
        _boards(presses.bits, STUCK),
        (
            Asked("named or harmless", "good", "streams", 1.0, True),
            Asked("named", "named", "streams", least=True),
            *_PALMS,
        ),
    ),
)
