# SPDX-License-Identifier: Apache-2.0
"""Palms and pushes on boards of `boards`, through the nodes on a driven clock."""

from __future__ import annotations

import numpy as np
from support.chain import Chain
from support.lab import touches
from support.lab.board import KNOTS

from ..faults.reliability import SOON, Record, fails, play
from .boards import LAWS, OLD, WRONG, ZEROS, Case, MovingZero, crept, draw, pressed, stuck

PALM = 45.0  # N
PUSH = touches.PUSH  # N that a limit is set to
PEAK = touches.PEAK  # N on a cell that count as much
RAMP = 60.0  # N at the end of a push
PALMS = 6  # on a board
PUSHES = 8
REST = 3.0  # s untouched at the start
AHEAD = 5.0  # s of touches of a day that come first, on every other board
KINDS = "palm", "finger", "edge"
ALLOWED = 20.0, 45.0  # N true, within which a limit of 30 N stops
LEAST = 8.0  # N felt, below which nothing stops
WORD = "bit"  # in what is said of a stuck one


class Scene:
    """What presses in time: `true` force and what it `conducts`, both (n, rows, cols) [N]."""

    def __init__(self, case: Case):
        self.case, self.shape = case, case.entered.shape
        self.true = np.zeros((0, *self.shape))
        self.conducts = self.true
        self.spans: list[tuple[int, int]] = []  # first knot, and that behind the last, of each

    def add(self, picture: np.ndarray, course: np.ndarray) -> None:
        """Append a picture (rows, cols) [N] that is there in this course, (n,) from 0 up."""
        self.spans.append((len(self.true), len(self.true) + len(course)))
        for name, of in (("true", course), ("conducts", crept(course, self.case.creep))):
            setattr(self, name, np.concatenate([getattr(self, name), of[:, None, None] * picture]))

    def wait(self, seconds: float) -> None:
        idle = np.zeros((round(seconds * KNOTS), *self.shape))
        self.true, self.conducts = (np.concatenate([f, idle]) for f in (self.true, self.conducts))

    def touched(self) -> None:
        """Append a few touches of a day, none of which is a push."""
        day = touches.everyday(self.case.entered.populated, AHEAD, self.case.rng, PEAK, False)
        force = np.minimum(1.0, 15.0 / np.maximum(day.force.sum((1, 2)), 1e-9))[:, None, None]
        force = force * day.force  # at most 15 N
        self.true = np.concatenate([self.true, force])
        self.conducts = np.concatenate([self.conducts, force])

    def play(self) -> tuple[Record, list[str]]:
        """Return what it did to the chain, and all that was said; a skin that is refused stops."""
        case, board = self.case, self.case.board
        late = len(self.true) // 2 if case.late else len(self.true)
        arriving = board.advance(self.conducts[:late])
        if case.late:
            board.damaged_at = board.t
            case.late()
            arriving += board.advance(self.conducts[late:])
        try:
            chain = Chain(case.entered, board.protocol, case.given)
        except ValueError as error:
            n = len(self.true)
            yes, no = np.ones(n, bool), np.zeros(n, bool)
            return Record(self.true, np.zeros_like(self.true), yes, yes, no, [str(error)]), []
        try:
            record = play(chain, arriving, self.true)
        finally:
            chain.close()
        return record, [message for _, message in chain.levels.values()]


def course(rise: float, hold: float, rng) -> np.ndarray:
    """(n,) from 0 to 1 in `rise` s, there for `hold` s, and back within 0.05 to 0.3 s."""
    fall = rng.uniform(0.05, 0.3)
    up, stay, down = (max(2, round(s * KNOTS)) for s in (rise, hold, fall))
    return np.concatenate([np.linspace(0.0, 1.0, up), np.ones(stay), np.linspace(1.0, 0.0, down)])


def held(record: Record, scene: Scene) -> dict:
    """Of palms: `free` at any time from SOON after 30 N until let go, `missed`, let go `early`."""
    total = record.truth.sum((1, 2))
    counts = {"palms": 0, "free": 0, "missed": 0, "early": 0}
    for begin, end in scene.spans:
        stands = begin + np.flatnonzero(total[begin:end] >= PUSH)
        free = ~record.stopped[stands[0] : stands[-1] + 1]
        counts["palms"] += 1
        counts["free"] += bool(free[round(SOON * KNOTS) :].any())
        counts["missed"] += bool(free.all())
        counts["early"] += bool((~free).any() and free[np.argmin(free) :].any())
    return counts


def palms(name: str, wired: str, k: int, seed) -> dict:
    """Palms on a board of which what is entered is wrong in this way, one of WRONG."""
    case = draw(wired, k, seed)
    WRONG[name][0](case)
    scene, rng = Scene(case), case.rng
    scene.wait(REST)
    if rng.integers(2):
        scene.touched()
    for _ in range(PALMS):
        palm(scene)
    found = held(scene.play()[0], scene)
    return found | {f"{key}, {name}": found[key] for key in ("palms", "free")}


def palm(scene: Scene) -> None:
    """Append a palm of 45 N that stands for 0.8 to 2 s, and a pause."""
    rng = scene.case.rng
    picture = PALM * pressed("palm", scene.shape, rng)
    scene.add(picture, course(rng.uniform(0.1, 0.5), rng.uniform(0.8, 2.0), rng))
    scene.wait(rng.uniform(0.8, 1.5))


def moving(wired: str, k: int, seed) -> dict:
    """Two palms that stand while the board's zero follows its readings, for 1 to 60 s."""
    case = draw(wired, k, seed)
    rng = case.rng
    seconds = float(np.exp(rng.uniform(*np.log((1.0, 60.0)))))
    case.board.rate = min(case.board.rate, 25.0)  # text, as a rule; a stream is long
    law, zero = LAWS[k % len(LAWS)], ZEROS[k // len(LAWS) % len(ZEROS)]
    case.board.tamper = MovingZero(case.board, law, seconds, zero, float(rng.choice(OLD)))
    scene = Scene(case)
    scene.wait(REST)
    if rng.integers(2):
        scene.touched()
    for _ in range(2):
        hold = float(np.clip(rng.uniform(0.8, 2.0) * seconds, 4.0, 20.0))
        scene.add(PALM * pressed("palm", scene.shape, rng), course(0.2, hold, rng))
        scene.wait(3.0)
    record, _ = scene.play()
    found = held(record, scene)
    live = bool((~record.stopped[: scene.spans[0][0]]).any())
    return {"boards": 1, "held": found["free"] == 0, "live": live} | found


def pushes(proof: str, wired: str, k: int, seed) -> dict:
    """Pushes that rise to 60 N on a board that is right: the true and the felt force that stop."""
    case = draw(wired, k, seed, proof)
    scene, rng = Scene(case), case.rng
    scene.wait(REST)
    scene.touched()
    for n in range(PUSHES):
        picture = RAMP * pressed(KINDS[n % len(KINDS)], scene.shape, rng)
        scene.add(picture, course(rng.uniform(0.8, 2.5), 0.3, rng))
        scene.wait(1.5)
    record, _ = scene.play()
    true, felt = (_as_pushes(f) for f in (record.truth, record.found))
    found: dict = {"pushes": 0, "within": 0, "true": [], "felt": [], "faults": 0}
    for begin, end in scene.spans:
        stops = np.flatnonzero(record.stopped[begin:end])
        found["pushes"] += 1
        if not stops.size:
            found["true"].append(np.inf)
            continue
        at = begin + stops[0]
        found["faults"] += bool(record.faulted[at])
        found["within"] += bool(not record.faulted[at] and ALLOWED[0] <= true[at] <= ALLOWED[1])
        if not record.faulted[at]:
            found["true"].append(true[at])
            found["felt"].append(felt[at])
    return found | {"reasons": record.reasons}


def _as_pushes(force: np.ndarray) -> np.ndarray:
    """(n,) [N] against a limit of PUSH, of forces (n, rows, cols): a cell's peak counts as well."""
    return np.maximum(force.sum((1, 2)), force.max((1, 2)) * PUSH / PEAK)


def bits(wired: str, k: int, seed) -> dict:
    """A bit that sticks: `named`, or `harmless`: no palm is free, no picture wrong in silence."""
    case = draw(wired, k, seed, creep=False)
    stuck(case)
    scene, rng = Scene(case), case.rng
    scene.wait(REST)
    scene.touched()
    for _ in range(2):
        scene.add(PALM * pressed("palm", scene.shape, rng), course(0.2, 1.5, rng))
        scene.wait(1.5)
    record, said = scene.play()
    named = any(WORD in text for text in (*record.reasons, *said))
    palm = held(record, scene)
    lag = 1.0 / case.board.rate + case.board.on_the_way + 0.02
    silent = fails(record, lag, case.board.curve.max_force) & ~(record.doubts | record.faulted)
    harmless = palm["free"] == 0 and silent.mean() < 0.01
    return {"streams": 1, "good": bool(named or harmless), "named": named} | palm
