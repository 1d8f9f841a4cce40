# SPDX-License-Identifier: Apache-2.0
"""Makes takes of the Corpus of Social Touch, for `tactile-skin gestures evaluate`.

    python -m benchmarks.gestures.cost CoST.csv takes/

You fetch the file (doi 10.4121/uuid:5ef62345-3b3e-479c-8e1d-c922748c9b29) and keep to its licence.
It has a row a frame: gesture (1 to 14), subject, variant, frame, and 64 readings of 8 x 8 cells;
a frame number that does not follow the last one begins another gesture. The readings are no
forces: each cell's least reading of a gesture is taken for untouched, and a count for some force.
"""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np

from tactile_skin import extras
from tactile_skin.errors import FileError
from tactile_skin.touch.episode import LIMIT
from tactile_skin.touch.take import SUFFIX, Take

from .. import harness

NAMES = (  # in the order of their numbers
    *("grab", "hit", "massage", "pat", "pinch", "poke", "press"),
    *("rub", "scratch", "slap", "squeeze", "stroke", "tap", "tickle"),
)
_HEAD = ("gesture", "subject", "variant", "frame")
_SHAPE = (8, 8)
_RATE = 135.0  # frames a second
_TOGETHER = 5  # frames a picture: 27 a second
_NEWTONS = 0.01  # a count, chosen


def takes(path: Path, pitch: float):
    """Yield the takes of the corpus's file.

    Raises:
        FileError: a column is missing, or a row is no frame.
    """
    with path.open(newline="") as file:
        rows = csv.reader(file)
        head = [name.strip().lower() for name in next(rows, [])]
        missing = [name for name in _HEAD if name not in head]
        cells = [k for k, name in enumerate(head) if name and name not in _HEAD][-64:]
        if missing or len(cells) != 64:
            what = f"no column {missing[0]!r}" if missing else f"{len(cells)} readings, not 64"
            raise FileError(f"{path}: {what}: is it the corpus as CSV?")
        where = {name: head.index(name) for name in _HEAD}
        yield from _cut(_frames(path, rows, where, cells), pitch)


def _frames(path: Path, rows, where: dict[str, int], cells: list[int]):
    for number, row in enumerate(rows, 2):
        try:
            values = {name: int(float(row[k])) for name, k in where.items()}
            yield values, np.array([float(row[k]) for k in cells]).reshape(_SHAPE)
        except (ValueError, IndexError) as error:
            raise FileError(f"{path}: line {number} is no frame of the corpus") from error


def _cut(frames, pitch: float):
    started, last = 0, None

    def gesture(item) -> tuple:
        nonlocal started, last
        now = item[0]
        key = now["gesture"], now["subject"], now["variant"]
        if last is None or last[0] != key or now["frame"] != last[1] + 1:
            started += 1
        last = key, now["frame"]
        return (started, *key)

    for (_, name, subject, _), part in itertools.groupby(frames, gesture):
        counts = np.array([picture for _, picture in part])
        counts = counts - counts.min(0)
        whole = len(counts) // _TOGETHER * _TOGETHER
        if not whole:
            continue
        force = _NEWTONS * counts[:whole].reshape(-1, _TOGETHER, *_SHAPE).mean(1)
        force = np.where(force > LIMIT, force, 0.0)
        yield Take(NAMES[name - 1], f"subject{subject}", force, _TOGETHER / _RATE, pitch)


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("file", type=Path, help="the corpus, CSV")
    parser.add_argument("folder", type=Path, help="of the takes")
    parser.add_argument("--pitch", type=float, default=0.02, help="of its cells [m] (default 0.02)")
    given = parser.parse_args(arguments)
    given.folder.mkdir(parents=True, exist_ok=True)
    for k, take in enumerate(extras.tqdm()(takes(given.file, given.pitch), disable=None)):
        take.save(given.folder / f"{take.label}-{take.person}-{k}{SUFFIX}")


if __name__ == "__main__":
    harness.run(main)
