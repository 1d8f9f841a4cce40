# SPDX-License-Identifier: Apache-2.0
"""How soon is a gesture named, how often rightly, and what passes for one that is none?

    python -m benchmarks.gestures.decisions [--recordings FILE] [--bed FILE] [--only PART ...]

Simulated people, events and boards that the shipped recogniser has not seen; with recordings, each
real person by the shipped one, by one that was trained on the others, and by five takes of his own.
"""

from __future__ import annotations

import itertools
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tactile_skin.bench.measure import Clock
from tactile_skin.learning.gestures import Takes, fit, table_of, train
from tactile_skin.learning.hands import MATS, simulated
from tactile_skin.nodes.observers.gestures import SHIPPED
from tactile_skin.simulation.people.events import EVENTS, happen
from tactile_skin.simulation.people.hands import GESTURES, Person, perform
from tactile_skin.simulation.people.mat import Mat
from tactile_skin.touch.episode import LIMIT
from tactile_skin.touch.model import OTHER, GestureModel, load_model
from tactile_skin.touch.recogniser import ENDED, PERIOD, Recogniser
from tactile_skin.touch.take import Take

from .. import harness
from .boards import Board
from .recorded import GROUP, SIX, recorded

PEOPLE = range(500, 520)  # simulated; the shipped recogniser knows 0 to 39
_REPETITIONS = 3
_HAPPENINGS = 25  # of each kind of event
_FIRST_EVENT = 700_000  # their seeds
_AFTER = 1.0  # s without a touch after a take
_HOUR = 3600.0  # s
_GAPS = (20.0, 100.0)  # s between two events of a working robot
_WORKS = ("lean", "thing", "dropped", "wall", "cloth", "carry", "shaken")  # what happens to it
_BED_PITCH = 0.0286  # m, of a mat of 1.83 m with 64 rows
_BED_PASCAL = 133.3  # a count, which looks like mmHg
_BED_FRAME = 1.0  # s between the recorded frames, assumed; the body moves evenly between two
_BED_STEPS = 10  # pictures made of each
_BED_NOISE = 0.3  # counts: of rounding
_OWN_TAKES = 5  # of each gesture of one's own
_DRAWS = 4  # of them
_OWN = (("tap", "stroke", "squeeze"), ("pat", "tickle", "hold"), ("poke", "rub", "press"))


def named(model: GestureModel, take: Take) -> tuple[str, float, str]:
    """Return the first name of a take, after how long [s], and the one at its end; "" is none."""
    recogniser = Recogniser(model, take.pitch)
    quiet = np.zeros((round(_AFTER / take.period), *take.pictures.shape[1:]))
    first, after, last = "", np.inf, ""
    recogniser.update(0.0, quiet[0])
    for k, picture in enumerate([*take.pictures, *quiet], 1):
        for gesture in recogniser.update(k * take.period, picture):
            if gesture.decided and gesture.label != OTHER and not first:
                first, after = gesture.label, gesture.duration
            if gesture.state == ENDED and gesture.label != OTHER:
                last = gesture.label
    return first, after, last


def decisions(title: str, pairs: list[tuple[GestureModel, Take]]) -> dict:
    """Print and return how soon takes are named, and how often rightly."""
    rows = [(take.label, *named(model, take)) for model, take in pairs]
    said = [row for row in rows if row[1]]
    after = np.array([row[2] for row in said])
    found = {
        "takes": len(rows),
        "named": len(said) / len(rows),
        "first is right, of named": np.mean([row[0] == row[1] for row in said]),
        "last is right, of all": np.mean([row[0] == row[3] for row in rows]),
        "median [s]": np.median(after),
        "90 % [s]": np.quantile(after, 0.9),
    }
    return _print(title, found)


def _print(title: str, found: dict) -> dict:
    print(
        f"{title}: " + ", ".join(f"{name} {value:.3g}" for name, value in found.items()), flush=True
    )
    return found


def on_boards(given) -> dict:
    """Simulated people through the paper's board and `auto`: 12 gestures, and the six distinct."""
    model, board = load_model(SHIPPED), Board.of("A", given.seed)
    rng = np.random.default_rng([given.seed, 8])
    mat = Mat(*board.circuit.shape, MATS[0].pitch)
    pairs = []
    for number in PEOPLE:
        person = Person(number)
        for gesture in GESTURES:
            for k in range(_REPETITIONS):
                force = perform(gesture, person, mat, 1000 * given.seed + k, PERIOD)
                felt = board.pictures(force, rng, ("auto",))["auto"]
                pairs.append((model, Take(gesture, f"{number}", felt, PERIOD, mat.pitch)))
    six = [pair for pair in pairs if pair[1].label in SIX]
    return {
        "12": decisions("simulated people, 12 gestures", pairs),
        "6": decisions("simulated people, six of them", six),
    }


def _six(given) -> list[Take]:
    """Return the takes of six distinct gestures by real hands, if there are recordings."""
    if given.recordings is None:
        return []
    takes = [
        take._replace(label=GROUP[int(take.label)])
        for take in recorded(given.recordings, seed=given.seed)
        if GROUP[int(take.label)] in SIX
    ]
    return [
        take._replace(pictures=np.where(take.pictures > LIMIT, take.pictures, 0.0))
        for take in takes
    ]


def by_shipped(given) -> dict:
    """Name the takes of each real person by the shipped recogniser, which has seen none."""
    takes, model = _six(given), load_model(SHIPPED)
    return {
        who: decisions(f"shipped, {who}", [(model, take) for take in takes if take.person == who])
        for who in sorted({take.person for take in takes})
    }


def on_hands(given) -> dict:
    """Real hands, six distinct gestures: trained on all people but the one that is named."""
    takes = _six(given)
    if not takes:
        return {}
    nothing = list(simulated(range(0), events=tuple(EVENTS)))
    pairs = []
    for person in sorted({take.person for take in takes}):
        others = [take for take in takes if take.person != person]
        model = train(table_of(others + nothing), {})
        pairs += [(model, take) for take in takes if take.person == person]
    return decisions("real hands, six gestures", pairs)


def no_gestures(given) -> dict:
    """Events of the kinds that were trained on, and of each kind by a recogniser without it."""
    shipped = load_model(SHIPPED)
    found = {"known": _passed(shipped, tuple(EVENTS), "events of known kinds", given.seed)}
    table = table_of(list(simulated()))
    classes, label = np.unique(table.label, return_inverse=True)
    kind_of = np.array([person.split()[0] for person in table.person])  # "lean 12"
    passed = []
    for kind in EVENTS:
        forest, line = fit(table, label, kind_of != kind)
        model = shipped._replace(forest=forest, logistic=line, classes=tuple(map(str, classes)))
        title = f"{kind}, not trained on"
        passed.append(_passed(model, (kind,), title, given.seed)["passed"])
    found["unknown"] = _print("events of unknown kinds", {"passed": float(np.mean(passed))})
    return found


def _passed(model: GestureModel, kinds: tuple[str, ...], title: str, seed: int) -> dict:
    count: Counter = Counter()
    for kind in kinds:
        for k in range(_HAPPENINGS):
            force = happen(kind, MATS[k % 3], _FIRST_EVENT + 1000 * seed + k, PERIOD)
            felt = np.where(force > LIMIT, force, 0.0)
            count[named(model, Take(kind, "", felt, PERIOD, MATS[k % 3].pitch))[2] != ""] += 1
    return _print(title, {"passed": count[True] / count.total()})


def hour(given) -> dict:
    """False gestures an hour of a robot that rests, works and is bumped; and of a bed."""
    model, rng, mat = load_model(SHIPPED), np.random.default_rng([given.seed, 9]), MATS[0]
    quiet, events, pictures = np.zeros((mat.rows, mat.cols)), 0, []
    while len(pictures) * PERIOD < _HOUR:
        pictures += [quiet] * round(rng.uniform(*_GAPS) / PERIOD)
        kind, events = _WORKS[rng.integers(len(_WORKS))], events + 1
        pictures += list(happen(kind, mat, _FIRST_EVENT + 1000 * given.seed + events, PERIOD))
    found = {"events": events, "false gestures": _false(model, mat.pitch, pictures, PERIOD)}
    both = {"robot": _print("a robot's hour", found)}
    if given.bed is None:
        return both
    with np.load(given.bed) as data:
        frames = data["frames"].astype(float)
    share = np.arange(_BED_STEPS)[:, None, None] / _BED_STEPS
    counts = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(frames)])
    newtons, period = _BED_PASCAL * _BED_PITCH**2, _BED_FRAME / _BED_STEPS
    false = _false(model, _BED_PITCH, counts * newtons, period, _BED_NOISE * newtons)
    found = {"minutes": len(counts) * period / 60.0, "false gestures": false}
    return both | {"bed": _print("a bed", found)}


def _false(model: GestureModel, pitch: float, pictures, period: float, std: float = 0.0) -> int:
    """Return how many gestures are named at their end."""
    recogniser, count = Recogniser(model, pitch), 0
    for k, picture in enumerate(pictures):
        for gesture in recogniser.update(k * period, picture, std):
            count += gesture.state == ENDED and gesture.label != OTHER
    return count


def own(given) -> dict:
    """Five takes each of one's own gestures, three if simulated, else six: the others' names."""
    right, real = [], []
    for number in PEOPLE:
        names = _OWN[number % len(_OWN)]
        mat = MATS[number % len(MATS)]
        person = Person(number)

        def takes(first: int, n: int, names=names, mat=mat, person=person, number=number):
            for name in names:
                for k in range(n):
                    force = perform(name, person, mat, first + k, PERIOD)
                    felt = np.where(force > LIMIT, force, 0.0)
                    yield Take(name, f"{number}", felt, PERIOD, mat.pitch)

        model = train(table_of(list(takes(0, _OWN_TAKES))), {})
        right += _right(model, table_of(list(takes(5000, 10))))
    rng, hands = np.random.default_rng([given.seed, 10]), _six(given)
    table, began = table_of(hands), time.monotonic()
    for person, _ in itertools.product(sorted(set(table.person)), range(_DRAWS)):
        his = table.person == person
        takes = [np.unique(table.take[his & (table.label == name)]) for name in SIX]
        mine = np.isin(table.take, [rng.choice(some, _OWN_TAKES, replace=False) for some in takes])
        real.append(np.mean(_right(train(_rows(table, mine), {}), _rows(table, his & ~mine))))
        print(f"{person}, {_OWN_TAKES} takes of each of six gestures: {real[-1]:.3f} are right")
    found = {"simulated": float(np.mean(right))}
    if real:
        found["real, six"] = float(np.mean(real))
        found["least"] = min(real)
        found["seconds to train"] = (time.monotonic() - began) / len(real)
    return _print("own gestures, right", found)


def _rows(table: Takes, use: np.ndarray) -> Takes:
    return Takes(*(part[use] for part in table))


def _right(model: GestureModel, table: Takes) -> list[bool]:
    """Return whether each take is named rightly at its end, sure or not."""
    names = [model.classes[model.probabilities(row).argmax()] for row in table.features[table.end]]
    return list(np.array(names) == table.label[table.end])


def cost(given) -> dict:
    """Time of a frame while something touches, in y."""
    model, clock = load_model(SHIPPED), Clock()
    recogniser, t = Recogniser(model, MATS[0].pitch), 0.0
    for number in PEOPLE[:4]:
        for gesture in GESTURES:
            for picture in perform(gesture, Person(number), MATS[0], given.seed, 0.01):
                t += 0.01
                if picture.any():
                    clock(recogniser.update, t, picture)
                else:
                    recogniser.update(t, picture)
    return _print("a frame at 100 Hz", {"mean [y]": clock.mean, "p99 [y]": clock.quantile(0.99)})


PARTS = {"boards": on_boards, "shipped": by_shipped, "hands": on_hands, "other": no_gestures}
PARTS |= {"hour": hour, "own": own, "cost": cost}


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--recordings", type=Path, help="of real hands: see recorded.py")
    parser.add_argument("--bed", type=Path, help="recording of a bed: frames (n, rows, cols)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    given = parser.parse_args(arguments)
    return {part: PARTS[part](given) for part in given.only}


if __name__ == "__main__":
    harness.run(main)
