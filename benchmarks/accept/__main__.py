# SPDX-License-Identifier: Apache-2.0
"""What must not get worse, in one table: frozen streams, seeds and bounds.

Next to each figure stand that of e6d30719 and the bound that is asked for, and whether it is met.
"worse" and "better" are said where the difference to e6d30719 is more than other seeds make.

examples:
  python -m benchmarks.accept --quick                       # a tenth of the streams
  python -m benchmarks.accept --only entries moving         # some lines
  python -m benchmarks.accept --list
  python -m benchmarks.accept --data FOLDER --json new.json # with recordings of others
  python -m benchmarks.accept --only faults sound --without health.bits.Bits

Times are of this machine alone: run `frame` and `stop` while nothing else does. To measure another
commit: copy this folder into a worktree of it, and run it there with --json. Two hours of sound
boards: python -m benchmarks.faults --faults --minutes 120.
"""

from __future__ import annotations

import json
import resource
import time
from pathlib import Path

import numpy as np

from tactile_skin import extras

from .. import harness
from .lines import LINES, Figure, Line, play
from .without import mechanism, playing

BEFORE = "e6d30719"
QUICK = 0.1  # share of the streams
_TIMES = 0.15  # by which a number that is no share differs from run to run
_SIGMA = 2.0  # standard errors by which a share differs between seeds


def measure(line: Line, args, share: float, track=lambda tasks: tasks) -> list[Figure]:
    """Return a line's figures; of `args`: seed, data, jobs, without, verbose."""
    tasks = line.tasks(args.seed, share, args.data)
    if not tasks:
        return []
    jobs = 1 if line.alone else args.jobs
    results = list(harness.spread(playing(play, args.without), tasks, jobs, track))
    for (function, arguments), result in zip(tasks, results, strict=True):
        if args.verbose:
            print(f"    {function.__name__}{tuple(arguments)}: {result}")
    return line.figures(results)


def next_to(figure: Figure, before: dict | None) -> tuple[str, str]:
    """Return the figure of before, and what became of it."""
    if before is None:
        return "", ""
    old = Figure(figure.name, before["value"], before["of"], figure.bound, figure.least)
    gained = figure.measured - old.measured
    if figure.of is None:
        spread = max(_TIMES * abs(old.value), 1.0 if float(old.value).is_integer() else 0.0)
    else:
        n = max(1.0, min(figure.of, old.of or 1.0))
        usual = np.clip(0.5 * (figure.measured + old.measured), 1.0 / n, 1.0)
        spread = _SIGMA * (2.0 * usual / n) ** 0.5
    alike = not abs(gained) > spread or (figure.of is None and figure.met and old.met)
    return text(old), "" if alike else "better" if (gained > 0) == figure.least else "worse"


def text(figure: Figure) -> str:
    if figure.of is None:
        return f"{figure.value:.4g}"
    if isinstance(figure.of, float) or figure.of > 2000:
        return f"{100.0 * figure.measured:.2f} %"
    return f"{figure.value:g} of {figure.of:g}"


def bound(figure: Figure) -> str:
    if figure.bound is None:
        return ""
    number = f"{figure.bound:g}" if figure.of is None else f"{100.0 * figure.bound:g} %"
    return f"at {'least' if figure.least else 'most'} {number}"


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    names = [line.name for line in LINES]
    parser.add_argument("--only", nargs="+", choices=names, metavar="LINE", default=names)
    parser.add_argument("--list", action="store_true", help="the lines, and nothing more")
    parser.add_argument("--seed", type=int, default=1, help="of all streams (default 1)")
    parser.add_argument("--quick", action="store_true", help="a tenth of the streams")
    parser.add_argument("--share", type=float, default=1.0, help="of the streams")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="recordings")
    parser.add_argument("--jobs", type=int, help="processes (default: one a core)")
    parser.add_argument("--verbose", action="store_true", help="what each stream came to")
    parser.add_argument(
        "--without",
        nargs="+",
        metavar="NAME",
        default=[],
        help="leave out a check (health.bits.Bits), or a function that may return None "
        "(solvers.suspect.by_residual): a mechanism that costs no figure goes",
    )
    args = parser.parse_args(arguments)
    try:
        for name in args.without:
            mechanism(name)
    except ValueError as error:
        parser.error(str(error))
    if args.list:
        print("\n".join(f"{line.name:12} {line.about}" for line in LINES))
        return {}
    share = QUICK if args.quick else args.share
    stored = Path(__file__).with_name(f"{BEFORE}{'-quick' * args.quick}.json")
    known = stored.exists() and (args.quick or share == 1.0) and args.seed == 1
    before = json.loads(stored.read_text())["figures"] if known else {}
    print(f"| line | figure | today | {BEFORE} | | bound | |\n|---|---|---:|---:|---|---|---|")
    found: dict = {}
    for line in (line for line in LINES if line.name in args.only):
        begun, spent = time.monotonic(), _processor()
        figures = measure(line, args, share, extras.tqdm())
        for figure in figures:
            was, change = next_to(figure, before.get(line.name, {}).get(figure.name))
            met = {None: "", True: "MET", False: "NOT MET"}[figure.met]
            cells = line.name, figure.name, text(figure), was, change, bound(figure), met
            print(f"| {' | '.join(cells)} |", flush=True)
        if not figures:
            print(f"| {line.name} | left out: no recordings in {args.data} | | | | | |")
        took = time.monotonic() - begun
        print(
            f"| {line.name} | {took:.0f} s, {_processor() - spent:.0f} s of processors | | | | | |",
            flush=True,
        )
        found[line.name] = {f.name: {"value": f.value, "of": f.of} for f in figures}
    return found


def _processor() -> float:
    of = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in of)


if __name__ == "__main__":
    harness.run(main)
