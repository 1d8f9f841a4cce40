# SPDX-License-Identifier: Apache-2.0
"""Does compensation help gestures? Names recorded gestures by the pictures of each method.

    python -m benchmarks.gestures.study FILE [--boards ABC] [--quick]

Trains on all people but one and names that one's gestures: alone, next to a second contact that
stands, and on a board that the recogniser was not trained on. FILE holds recordings of real hands
(benchmarks/gestures/recorded.py says which, and where they come from).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactile_skin.learning.gestures import Takes, fit, table_of
from tactile_skin.touch.episode import LIMIT
from tactile_skin.touch.features import segment
from tactile_skin.touch.model import common
from tactile_skin.touch.recogniser import TOUCHED
from tactile_skin.touch.take import Take

from .. import harness
from .boards import BOARDS, METHODS, Board
from .recorded import GROUP, SIX, recorded

_BESIDE_FORCE = (20.0, 40.0)  # N of the contact that stands
_BREATHES = 0.05  # share by which its force varies
_STANDS = 8  # pictures of it before the gesture, and half as many after
_TRIES = 60  # at places for it that the gesture does not reach
_OVERLAP = 0.03  # share of the gesture that may lie on it
_ITS_OWN = 0.5  # share of a touch's force on the standing contact that makes it its own
_TOGETHER = 1.0  # m of reach: a recording is one gesture, of both hands
_QUICK = 4  # every fourth recording
_STANDING = (0, 25, 31)  # recorded gestures that stand: a palm, an arm, a face
# of the twelve, those that leave room for a standing contact
BESIDE = ("finger", "poke", "pat", "pinch", "slap", "hit", "tickle", "finger stroke", "palm tap")


def seen(takes: list[Take], board: Board, methods, seed) -> dict[str, list[Take]]:
    """Return the takes as each method sees them on a board."""
    rng = np.random.default_rng([seed, 6])
    ends = np.cumsum([len(take.pictures) for take in takes])[:-1]
    found = board.pictures(np.concatenate([take.pictures for take in takes]), rng, methods)
    return {
        method: [
            take._replace(pictures=part)
            for take, part in zip(takes, np.split(forces, ends), strict=True)
        ]
        for method, forces in found.items()
    }


def right(train: Takes, test: Takes, seed: int = 0) -> np.ndarray:
    """Return (takes of `test`,) whether each was named right by what others than its person did."""
    classes, label = np.unique(train.label, return_inverse=True)
    ends = test.end
    named = np.zeros(np.count_nonzero(ends), classes.dtype)
    for person in np.unique(test.person):
        forest, line = fit(train, label, train.person != person, seed=seed)
        his = test.person[ends] == person
        rows = test.features[ends][his]
        shares = common(np.array([forest.shares(row) for row in rows]), line.shares(rows))
        named[his] = classes[shares.argmax(1)]
    return named == test.label[ends]


def beside(takes: list[Take], seed: int) -> tuple[list[Take], list[np.ndarray]]:
    """Return takes with a second contact that was there before and stays; and its cells.

    Takes whose gesture leaves no room for one, are left out.
    """
    rng = np.random.default_rng([seed, 7])
    stand = [take for take in takes if int(take.label) in _STANDING]
    made, cells = [], []
    for take in takes:
        if GROUP[int(take.label)] not in BESIDE:
            continue
        reach = take.pictures.max(0)
        for _ in range(_TRIES):
            other = stand[rng.integers(len(stand))].pictures
            shape = other[other.sum((1, 2)).argmax()]
            shape = _moved(shape, *rng.integers(-7, 8, 2))
            if shape.sum() > 0.0 and reach[shape > 0.0].sum() < _OVERLAP * reach.sum():
                break
        else:
            continue
        n = len(take.pictures) + _STANDS + _STANDS // 2
        t = np.arange(n) * take.period
        breath = 1.0 + _BREATHES * np.sin(2 * np.pi * rng.uniform(0.2, 0.4) * t + rng.uniform(0, 6))
        stands = rng.uniform(*_BESIDE_FORCE) * shape / shape.sum() * breath[:, None, None]
        stands[_STANDS : _STANDS + len(take.pictures)] += take.pictures
        made.append(take._replace(pictures=stands))
        cells.append(shape > 0.0)
    return made, cells


def _moved(picture: np.ndarray, down: int, right: int) -> np.ndarray:
    wide = np.pad(picture, 8)
    rows, cols = picture.shape
    return wide[8 - down : 8 - down + rows, 8 - right : 8 - right + cols]


def by_touches(take: Take, standing: np.ndarray) -> Take:
    """Return a take without the touches that are the standing contact's, as a recogniser does."""
    pictures = np.zeros_like(take.pictures)
    for picture, force in zip(pictures, take.pictures, strict=True):
        cells, owner, n = segment(force, TOUCHED)
        for touch in (cells[owner == k] for k in range(n)):
            own = force.ravel()[touch]
            if own[standing.ravel()[touch]].sum() < _ITS_OWN * own.sum():
                picture.ravel()[touch] = own
    return take._replace(pictures=pictures)


def by_change(take: Take) -> Take:
    """Return what a take has more than the pictures before the gesture."""
    more = take.pictures - take.pictures[:_STANDS].mean(0)
    return take._replace(pictures=np.where(more > LIMIT, more, 0.0))


def renamed(table: Takes, classes: str) -> Takes:
    """Return the rows of "32", "12" or "6" classes, by their names."""
    if classes == "32":
        return table
    names = np.array([GROUP[int(label)] for label in table.label])
    use = np.isin(names, SIX) if classes == "6" else np.ones(len(names), bool)
    return Takes(*(part[use] for part in table._replace(label=names)))


def share(ok: np.ndarray) -> tuple[float, float]:
    """Return the share that is right, and its standard error."""
    mean = float(ok.mean())
    return mean, (mean * (1.0 - mean) / len(ok)) ** 0.5


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("file", type=Path, help="recordings of real hands")
    parser.add_argument("--boards", default="ABC", help="of A, B and C (default ABC)")
    parser.add_argument("--seed", type=int, default=1, help="of forces, boards and noise")
    parser.add_argument("--quick", action="store_true", help="a quarter of the recordings")
    given = parser.parse_args(arguments)
    figures: dict = {}

    def note(name: str, ok: np.ndarray) -> None:
        figures[name] = share(ok)
        print(f"{name:44} {figures[name][0]:.3f} +- {figures[name][1]:.3f}", flush=True)

    tables: dict[str, dict[str, Takes]] = {}
    for name in given.boards:
        takes = _takes(given, name)
        board = Board.of(name, given.seed)
        # the paper's network is for the paper's board
        methods = [method for method in METHODS if name == "A" or method != "cnn"]
        made = seen(takes, board, methods, given.seed)
        tables[name] = {method: table_of(found, _TOGETHER) for method, found in made.items()}
    first = given.boards[0]
    for classes in ("6", "12", "32"):
        for method, table in tables[first].items():
            note(f"{classes} classes, {method}", right(*[renamed(table, classes)] * 2))
    for name in given.boards[1:]:
        for method, table in tables[name].items():
            train = renamed(tables[first][method], "12")
            note(f"{first} to {name}, {method}", right(train, renamed(table, "12")))
    scenes, standing = beside(_takes(given, first), given.seed)
    for method, found in seen(scenes, Board.of(first, given.seed), METHODS, given.seed).items():
        table = renamed(tables[first][method], "12")
        alone = Takes(*(part[np.isin(table.label, BESIDE)] for part in table))
        note(f"alone, {method}", right(alone, alone))
        changed = table_of([by_change(take) for take in found], _TOGETHER)
        note(f"next to a contact, what changed, {method}", right(alone, renamed(changed, "12")))
        touched = [by_touches(*pair) for pair in zip(found, standing, strict=True)]
        note(
            f"next to a contact, by touches, {method}",
            right(alone, renamed(table_of(touched, _TOGETHER), "12")),
        )
    return figures


def _takes(given, board: str) -> list[Take]:
    coarse = BOARDS[board][0].shape == (16, 16)
    return recorded(given.file, coarse, given.seed)[:: _QUICK if given.quick else 1]


if __name__ == "__main__":
    harness.run(main)
