# SPDX-License-Identifier: Apache-2.0
"""Newtons and stop on simulated real fabric: calibrated by a person, days later, by one weight.

Boards of `accept.boards` of 8 x 8, of each readout in turn. Their fabric creeps by 5 to 40 % a
decade from 0.03 s on, later by 0.43 times that, scatters from cell to cell, rests lower after a
release, lags by up to 13 %, and counts the place of a press within a cell by up to 1.5 either way.
A person calibrates with ten things and a minute of presses, and waits 6 s between touches. New
things are laid on then: `found` over `stated` is their RMS error over the one that the fit states.
`hold`: times 20 N that a palm may be after 0.3, 1.3 and 59 s. Five days later all cells have 0.77
to 1.3 times their gain, and pushes rise to 60 N (`days`); after `calibrate --gain` they do so again
(`gain`). Free `once launched`: before the first push. `left`: felt 1 s after a release over the
peak; `free`: s from it until the robot is.
"""

from __future__ import annotations

import datetime
import itertools
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from support.chain import Chain
from support.lab.board import KNOTS
from support.weights import objects

from tactile_skin import Creep, PressureCurve
from tactile_skin.calibration.creep import Standing
from tactile_skin.guide.calibrated import known_of, write
from tactile_skin.guide.calibration import Guide
from tactile_skin.guide.gain import measure_gain, write_gain
from tactile_skin.middleware.bus import Context, ManualClock, Node
from tactile_skin.middleware.config import read_skin
from tactile_skin.middleware.parameter_file import ParameterFile
from tactile_skin.middleware.threads import one_thread
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.parameters.nodes import all_names
from tactile_skin.physics.curve import GRAM
from tactile_skin.physics.proof import NOTHING
from tactile_skin.simulation.living import Habits, Living

from .. import harness
from ..accept.boards import WIRED, draw, pressed
from ..accept.presses import ALLOWED, KINDS, PEAK, PUSH, RAMP, REST, course
from ..accept.weighed import NODES
from ..faults.reliability import play

RATE = 10.0  # frames a second while a person calibrates
CREEP, OFF = (0.05, 0.4), 1.3  # a decade; times which the gain of a day may be that of another
DAYS = 5  # since the curve was proved
OBJECTS, NEW = 10, 30  # that are weighed, and laid on afterwards
COMES, PAUSED, STOOD = 0.3, 6.0, (2.0, 8.0)  # s of a thing
ONE = 2000.0 * GRAM  # N of the weight of `--gain`
PRESSES = 11.0, 1.0, 5.0  # s between the minute's presses, of coming, of standing
TOUCH = 10.0, 60.0  # N of a person who presses here and there
PUSHES = 16  # on a board
PARTS = "guided", "hold", "days", "gain"
EVERY = 4  # knots at which it is looked how a fabric has changed
HELD, HOLD = 20.0, 60.0  # N, s
RATIO = 0.67, 1.5  # found over stated
NEAR = 0.1  # a decade, that creep found may be off
COSTS, STANDS = 300, 0.15  # frames that are timed, y that one may cost
FREE, AFTER = 0.5, ("left", "free")  # s from a release to be free, of which 0.3 s are `hold`


class Mat:
    """A board of a living fabric, with its clock."""

    def __init__(self, number: int, seed):
        self.case = draw(WIRED[number % len(WIRED)], number % len(WIRED), seed, creep=False)
        self.rng, self.board = self.case.rng, self.case.board
        self.shape, self.fabric = self.case.entered.shape, self.board.matrix.fabric
        rng = self.rng
        creep = float(np.exp(rng.uniform(*np.log(CREEP))))
        self.habits = replace(Habits.real(rng), creep=creep, drift=0.0)
        self.living, self.t = Living(self.habits, self.shape, rng), 0.0
        self.board.rate, self.board.ratio = min(self.board.rate, 25.0), self.ratio

    @property
    def creep(self) -> float:
        """What a load gains in the decades of the minute's presses, over what it added after 1 s:
        the mean slope of 0.5 to 5 s."""
        gained = [1.0 + self.habits.creep * self.living._law(t) for t in (0.5, 5.0)]
        return (gained[1] - gained[0]) / gained[0]

    def ratio(self, force: np.ndarray) -> np.ndarray:
        """(n, rows, cols) ADC ratio of forces [N] at the knots that come."""
        factors, touched = [], False
        for k, picture in enumerate(force):
            self.t += 1.0 / KNOTS
            if k % EVERY == 0 or touched != picture.any():
                now = self.living.factor(self.t, picture, self.fabric)
            factors.append(now)
            touched = picture.any()
        return self.board.matrix.ratio(force, np.array(factors))

    def read(self, force: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(n, rows, cols) readings under forces [N], at times from now on [s]."""
        factors = [
            self.living.factor(self.t + t, f, self.fabric)
            for t, f in zip(times, force, strict=True)
        ]
        self.t += times[-1]
        ratio = self.board.matrix.ratio(force, np.array(factors))
        return np.array([self.board.converter.frame(r, self.rng) for r in ratio])


class Person:
    """Does what a guide asks."""

    def __init__(self, mat: Mat, things: np.ndarray):
        self.mat, self.things = mat, list(things)
        self.force = np.zeros(mat.shape)
        self.touches = (
            mat.rng.uniform(*TOUCH) * pressed(KINDS[k % len(KINDS)], mat.shape, mat.rng)
            for k in itertools.count()
        )
        self.pressing, self.looks, self.minute = False, 0, False
        self.again = things[len(things) // 2]

    def lay(self, force: np.ndarray, stood: float) -> None:
        """Take off what lies there, lay it on, and wait [s]."""
        nothing, times = np.zeros((1, *self.mat.shape)), np.array([COMES / 4.0])
        self.mat.read(nothing, times)
        self.mat.read(nothing, np.array([PAUSED]))
        for share in (0.25, 0.5, 0.75, 1.0):
            self.mat.read(share * force[None], times)
        self.mat.t += stood
        self.force = force

    def ask(self, text: str) -> str:
        self.pressing = False
        self.minute = "Creep" in text
        lays = self.things and ("its weight" in text or "Lay the weight" in text)
        force = self.things.pop(0) if lays else np.zeros(self.mat.shape)
        self.lay(force, float(np.exp(self.mat.rng.uniform(*np.log(STOOD)))))
        return "p" if self.minute else f"{force.sum():.4g} N" if lays else ""

    def say(self, text: str) -> None:
        self.pressing = self.pressing or "2 of 3" in text or "more places" in text

    def frames(self, seconds: float) -> np.ndarray:
        self.looks += self.pressing
        if self.pressing and self.looks % 2:
            self.lay(next(self.touches), 1.0)
        times = np.arange(1, max(2, round(RATE * seconds)) + 1) / RATE
        force = np.broadcast_to(self.force, (len(times), *self.mat.shape))
        if self.minute:
            every, comes, stands = PRESSES
            phase = times % every
            on = np.clip(phase / comes, 0.0, 1.0) * (phase < comes + stands) * (times < 5 * every)
            force = on[:, None, None] * self.again
        return self.mat.read(force, times)


def guided(mat: Mat, path: Path) -> Guide:
    """Lead a person through a calibration, and write its file."""
    shape, circuit = mat.shape, mat.case.entered
    words = {n: v for n, v in circuit.describe().items() if n != "mask"}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": words}}}))
    person, skin = Person(mat, objects(OBJECTS, shape, mat.rng)[0]), read_skin(path)
    day, given = datetime.date.today() - datetime.timedelta(days=DAYS), known_of(skin)
    by = person.frames, person.ask, person.say
    guide = Guide(skin.circuit, *by, today=lambda: day, **given)
    guide.run()
    write(path, path, guide, skin)
    return guide


def by_one_weight(mat: Mat, path: Path) -> None:
    """Lay one weight on the skin of a file, and write its factor."""
    skin = read_skin(path)
    person = Person(mat, ONE * pressed("finger", mat.shape, mat.rng)[None])
    guide = Guide(skin.circuit, person.frames, person.ask, person.say, **known_of(skin))
    write_gain(path, path, guide, measure_gain(guide, ONE, skin), skin)


class Scene:
    """True forces in time, (n, rows, cols) [N], and the knots of each that presses."""

    def __init__(self, shape):
        self.force = np.zeros((round(2.0 * PAUSED * KNOTS), *shape))  # hands off
        self.spans: list[tuple[int, int]] = []

    def add(self, picture: np.ndarray, on: np.ndarray, wait: float) -> None:
        """Append a picture in this course (n,), and a pause [s]."""
        self.spans.append((len(self.force), len(self.force) + len(on)))
        idle = np.zeros((round(wait * KNOTS), *picture.shape))
        self.force = np.concatenate([self.force, on[:, None, None] * picture, idle])


def chain(mat: Mat, path: Path, scene: Scene):
    """What a skin of this file makes of a scene."""
    found = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    flat = {f"{of}.{n}": v for of in ("circuit", "curve") for n, v in found.get(of, {}).items()}
    given = {
        node: {n: v for n, v in mat.case.given.get(node, {}).items() if not n.startswith("curve.")}
        | {n: v for n, v in flat.items() if n in all_names(node)}
        for node in {*NODES, *mat.case.given}
    }
    board = mat.board
    board._knots = board._scans = board._frames = 0  # it is switched on
    board._last_ratio = board._filtered = None
    mat.read(np.zeros((1, *mat.shape)), np.array([PAUSED]))  # what lay there is taken off
    mat.t += 2.0 * PAUSED
    arriving = board.advance(scene.force)
    running = Chain(read_skin(path).circuit, board.protocol, given)
    try:
        return play(running, arriving, scene.force)
    finally:
        running.close()


class Running:
    """The skin of a file, on the clock of its mat."""

    def __init__(self, mat: Mat, path: Path):
        given = ParameterFile(path).overrides("/compensation")
        node = Node("compensation", context=Context(ManualClock()), parameter_overrides=given)
        self.skin, self.mat = Compensation(node).skin, mat
        self.play(np.zeros((round(REST * RATE), *mat.shape)))

    def play(self, force: np.ndarray) -> np.ndarray:
        """(n, 2) [N] felt and at most, under forces (n, rows, cols) [N] at frames that come."""
        start, found = self.mat.t, []
        times = np.arange(1, len(force) + 1) / RATE
        for t, adc in zip(times, self.mat.read(force, times), strict=True):
            felt = self.skin.frame(start + t, np.rint(adc * 65535.0).astype(np.uint16))
            bound = self.skin.bound[..., 1].sum()
            found.append((np.nan, np.nan) if felt is None else (felt.sum(), bound))
        return np.array(found)


def laid(mat: Mat, path: Path) -> np.ndarray:
    """(NEW,) relative errors of new things that stand, as a running skin feels them."""
    skin, off = Running(mat, path), []
    idle = np.zeros((round(RATE), *mat.shape))
    for thing, weight in zip(*objects(NEW, mat.shape, mat.rng), strict=True):
        stood = np.exp(mat.rng.uniform(*np.log(STOOD))) / 2.0
        on = np.concatenate([np.linspace(0.0, 1.0, 4), np.ones(round(stood * RATE))])
        off.append(skin.play(on[:, None, None] * thing)[-1, 0] / weight - 1.0)
        skin.play(idle)
    return np.array(off)


def pushes(mat: Mat, path: Path, count: int) -> dict:
    """True forces that stop pushes to 60 N, `left` of their peak, s until `free`."""
    scene = Scene(mat.shape)
    for n in range(count):
        picture = RAMP * pressed(KINDS[n % len(KINDS)], mat.shape, mat.rng)
        scene.add(picture, course(mat.rng.uniform(0.8, 2.5), 0.3, mat.rng), 1.2)
    record = chain(mat, path, scene)
    true, felt = scene.force, record.found.sum((1, 2))
    true = np.maximum(true.sum((1, 2)), true.max((1, 2)) * PUSH / PEAK)
    found: dict = {"true": [], "felt": [], "left": [], "free": [], "reasons": record.reasons}
    found["live"] = bool((~record.stopped[: scene.spans[0][0]]).any())
    for begin, end in scene.spans:
        stops = begin + np.flatnonzero(record.stopped[begin:end])
        push = stops.size and not record.faulted[stops[0]]
        found["true"].append(float(true[stops[0]]) if push else np.inf if not stops.size else 0.0)
        found["felt"].append(float(felt[stops[0]]) if push else np.nan)
        found["left"].append(float(felt[end + KNOTS] / max(felt[begin:end].max(), 1e-9)))
        free = np.flatnonzero(~record.stopped[end : end + round(1.2 * KNOTS)])
        found["free"].append(free[0] / KNOTS if free.size else np.inf)
    return found


def hold(mat: Mat, path: Path) -> list[float]:
    """Return the most that a palm may be over what it is, after 0.3, 1 and 60 s."""
    skin, picture = Running(mat, path), HELD * pressed("palm", mat.shape, mat.rng)
    on = np.minimum(np.arange(1, HOLD * RATE) / 3.0, 1.0)
    found = skin.play(on[:, None, None] * picture)[:, 1] / HELD
    skin.play(np.zeros((round(PAUSED * RATE), *mat.shape)))
    return [float(found[round(t * RATE)]) for t in (0.3, 1.3, HOLD - 1.0)]


def run(number: int, seed: int, parts) -> dict:
    """Return all of one board."""
    mat = Mat(number, harness.seed_of(seed, "living", number))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.yaml"
        guide = guided(mat, path)
        result: dict = {"creep": mat.habits.creep, "true": mat.creep, "proof": guide.proof.by}
        if guide.creep:
            result |= {"share": guide.creep.share, "time": guide.creep.time}
        if not guide.fitted:
            return result
        result["stated"] = guide.fitted.error
        if "guided" in parts:
            off = laid(mat, path)
            result |= {"found": float(np.sqrt(np.mean(off**2))), "bias": float(np.median(off))}
            result["half"] = float(np.median(np.abs(off)))
        if guide.proof.by == NOTHING:
            return result
        if "hold" in parts:
            result["hold"] = hold(mat, path)
        mat.living.gain = float(np.exp(mat.rng.uniform(-np.log(OFF), np.log(OFF))))
        result["gain off"] = mat.living.gain
        if "days" in parts:
            result["days"] = pushes(mat, path, PUSHES)
        if "gain" in parts:
            try:
                by_one_weight(mat, path)
            except ValueError as error:
                result["refused"] = str(error)
                return result
            result["gain"] = pushes(mat, path, PUSHES)
    return result


def cost() -> dict[str, float]:
    """Return what a frame of 256 cells costs in the mean of 3 s that loads stand, or rest [y]."""
    standing, resting = (Standing(Creep(0.2, 0.03), PressureCurve()) for _ in range(2))
    rng = np.random.default_rng(1)
    dense = rng.standard_normal((257, 257)) + 257.0 * np.eye(257)
    loads, nothing = rng.uniform(0.1, 1.0, (16, 16)), np.zeros((16, 16))
    works = {
        "y": lambda t: np.linalg.solve(dense, dense[0]),
        "stands": lambda t: standing.update(t, loads),
        "rests": lambda t: resting.update(t, nothing),
    }
    took = {name: np.full(COSTS, np.inf) for name in works}
    for _, k in itertools.product(range(3), range(COSTS)):  # it begins anew each time
        for name, work in works.items():
            begun = time.perf_counter()
            work(k / 100.0)
            took[name][k] = min(took[name][k], time.perf_counter() - begun)
    return {name: took[name].mean() / took["y"].mean() for name in ("stands", "rests")}


def table(boards: list[dict], costs: dict[str, float]) -> None:
    """Print each figure, what it is to be, and whether it is."""

    def say(name: str, value: str, met: bool) -> None:
        print(f"| {name} | {value} | {'MET' if met else 'NOT MET'} |")

    print(f"{len(boards)} boards, proved: {sum(b['proof'] != NOTHING for b in boards)}")
    for part in ("days", "gain"):
        found = [b[part] for b in boards if part in b]
        if not found:
            continue
        true, left, free = (np.concatenate([f[of] for f in found]) for of in ("true", *AFTER))
        inside = np.mean((true >= ALLOWED[0]) & (true <= ALLOWED[1]))
        words = f"{inside:.1%} of {true.size}, {true.min():.1f} to {true.max():.1f} N"
        say(f"{part}: stopped within 20 to 45 N", words, inside >= 0.99)
        say(f"{part}: missed", f"{np.isinf(true).sum()}", not np.isinf(true).any())
        say(f"{part}: by a fault", f"{np.count_nonzero(true == 0.0)}", not (true == 0.0).any())
        say(f"{part}: left after 1 s", f"{left.max():.2%}", left.max() <= 0.01)
        live = sum(f["live"] for f in found)
        say(f"{part}: free once launched", f"{live} of {len(found)} boards", live == len(found))
        say(f"{part}: free after", f"{free.max():.2f} s", free.max() <= FREE)
    found = [b for b in boards if "found" in b]
    if found:
        ratio = np.array([b["found"] / b["stated"] for b in found])
        good = np.count_nonzero((ratio >= RATIO[0]) & (ratio <= RATIO[1]))
        say("error found over stated", f"{good} of {ratio.size}", good >= 0.85 * ratio.size)
        off = np.array([abs(b["share"] - b["true"]) for b in boards if "share" in b])
        say("creep off", f"at most {off.max():.2f} of {off.size}", off.max() <= NEAR)
    grows = [b["hold"][2] / b["hold"][1] for b in boards if "hold" in b]
    if grows:
        say("a minute's hold grows by", f"{max(grows) - 1.0:.0%}", max(grows) <= 1.0 + NEAR)
        low = min(b["hold"][0] / b["hold"][1] for b in boards if "hold" in b)
        say("after 0.3 s, over 1 s", f"{low:.2f}", low >= 1.0 - NEAR)
    for name, most in (("stands", STANDS), ("rests", STANDS / 3.0)):
        say(f"a frame of creep, {name}", f"{costs[name]:.3f} y", costs[name] <= most)


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    args = parser.parse_args(arguments)
    boards = []
    with one_thread():
        costs = cost()
        for number in range(args.boards):
            boards.append(run(number, args.seed, args.parts))
            print(number, boards[-1], flush=True)
    table(boards, costs)
    return {"boards": boards, "cost": costs}


if __name__ == "__main__":
    harness.run(main)
