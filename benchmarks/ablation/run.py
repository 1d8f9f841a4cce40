# SPDX-License-Identifier: Apache-2.0
"""What each mechanism that doubts readings is worth: what is lost and gained where it is off.

Every frame and every stream is played with all mechanisms on and with one off at a time, so that
all differences are paired. Rows that stand in FOLDER/ablation.json already are not measured again;
it is written after each row, so that a run may be ended and continued at any time. The page
ablation.md is made of that file.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from tactile_skin.bench.measure import machine
from tactile_skin.middleware.threads import one_thread

from .. import harness
from . import page, single_frames, streams
from .mechanisms import MECHANISMS
from .switchboard import installed

PAGES = Path(__file__).parents[2] / "docs" / "lab"
FRAMES = 300  # of each row
SEEDS = {"frames": 340_834, "streams": 340_835}  # nothing was tuned on these
_QUICK_FRAMES, _QUICK_ROWS, _QUICK_STREAMS = 3, 40, ("ring of 5", "short of neighbours")
_QUICK_SECONDS = 3.0
_MOST_JOBS = 2  # times are not measured, but others use the machine as well


def tasks(quick: bool, only: str | None) -> list[tuple[str, tuple]]:
    """Return (part, row) of all that is to be measured, in its order."""
    rows, plan = single_frames.rows(), streams.plan()
    if quick:
        rows = rows[::_QUICK_ROWS]
        plan = [
            next(s for s in plan if s.name == name)._replace(seconds=_QUICK_SECONDS)
            for name in _QUICK_STREAMS
        ]
    parts = {"frames": rows, "streams": plan}
    return [(part, row) for part in parts if only in (None, part) for row in parts[part]]


def run(task: tuple[str, tuple], quick: bool) -> dict:
    """Measure one row; nothing of it depends on the rows before."""
    part, row = task
    seed = harness.seed_of(SEEDS[part], *row)
    with one_thread(), installed(MECHANISMS) as board:
        if part == "frames":
            n = _QUICK_FRAMES if quick else FRAMES
            return single_frames.measure(board, row, n, seed)
        return streams.measure(board, row, seed)


def key_of(row: tuple) -> tuple:
    """Return what tells a row from the others of its part."""
    return tuple(row._asdict().values())


def load(path: Path, quick: bool) -> dict:
    """Return what was measured before, or the beginning of it."""
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    about = {"seeds": SEEDS, "quick": quick, "machine": machine()}
    return about | {"frames": [], "streams": []}


def save(path: Path, data: dict) -> None:
    """Write the file at once, one row a line."""

    def lines(rows):
        return ",\n".join(json.dumps(row) for row in rows)

    about = {key: value for key, value in data.items() if key not in SEEDS}
    text = json.dumps(about, indent=1)[:-2]
    text += "".join(f',\n "{part}": [\n{lines(data[part])}\n ]' for part in SEEDS) + "\n}\n"
    partial = path.with_suffix(".part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)


def measure(path: Path, todo: list, quick: bool, jobs: int, track) -> dict:
    """Measure what is not in the file yet, and write it."""
    data = load(path, quick)
    fields = {"frames": single_frames.Row._fields, "streams": streams.Stream._fields}
    done = {(p, *(row[f] for f in fields[p])) for p in SEEDS for row in data[p]}
    todo = [(part, row) for part, row in todo if (part, *key_of(row)) not in done]

    def take(task, found):
        data[task[0]].append(found)
        save(path, data)

    save(path, data)
    found = harness.spread(partial(run, quick=quick), todo, jobs, track)
    for task, row in zip(todo, found, strict=True):
        take(task, row)
    return data


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--quick", action="store_true", help="a smoke test of a minute")
    parser.add_argument("--only", choices=tuple(SEEDS), help="one part")
    parser.add_argument("--jobs", type=int, default=1, choices=range(1, _MOST_JOBS + 1))
    parser.add_argument("--out", type=Path, default=PAGES, metavar="FOLDER")
    given = parser.parse_args(arguments)
    from tqdm import tqdm

    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "ablation.json"
    todo = tasks(given.quick, given.only)
    data = measure(path, todo, given.quick, given.jobs, lambda rows: tqdm(rows, disable=None))
    made = path.with_suffix(".md")
    made.write_text(page.render(data), encoding="utf-8")
    print(made)
