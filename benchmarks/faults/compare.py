# SPDX-License-Identifier: Apache-2.0
"""The same streams through several checkouts: silent frames, missed pushes, stops.

Streams are drawn by each checkout's own laboratory from the same seeds; they are the same bytes as
long as its boards are (those of 2e9c056 are). Named after "=": the module that has `run_fault` and
`run_sound`, where it is another one.

example:
  git worktree add /tmp/old 2e9c056 && (cd /tmp/old && python3 setup.py -q build_ext --inplace)
  python -m benchmarks.faults.compare . /tmp/old=tactile_skin.bench.damage.reliability
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

from tactile_skin import extras

from .. import harness
from . import reliability

_MODULE = "benchmarks.faults.reliability"
_SHAPES = "8x8", "16x16", "8x8-loaded-rows", "8x8-grounded-columns"
_LENGTH = 12.0  # s of a stream with a fault
_SOUND = 45.0  # s of a sound one
_COUNTED = "frames", "failing", "silent", "pushes", "missed", "held", "false_stops", "stopped"
_WORKER = """
import json, sys
from importlib import import_module
from tactile_skin.middleware.threads import one_thread
one_thread().__enter__()
module = import_module(sys.argv[1])
for kind, arguments in map(json.loads, sys.stdin):
    print(json.dumps(getattr(module, "run_" + kind)(*arguments), default=str), flush=True)
"""


def tasks(shapes, sound: int, seed: int) -> list[tuple[str, list]]:
    """(kind, arguments) of a stream of each fault and protocol, and `sound` of each sound board.

    Where a fault can begin in the stream, every other one does.
    """
    found: list[tuple[str, list]] = []
    for k, fault in enumerate(reliability.FAULTS):
        for shape in shapes:
            for n, protocol in enumerate(fault.protocols):
                key = shape, fault.name, protocol, fault.stalls or (k + n) % 2 == 0
                found.append(("fault", [*key, _LENGTH, harness.seed_of(seed, *key)]))
    for k in range(sound):
        for board in reliability.SOUND:
            for shape in shapes:
                key = shape, *board
                found.append(("sound", [*key, _SOUND, harness.seed_of(seed, *key, k)]))
    return found


def run(checkout: str, todo: list[tuple[str, list]], jobs: int) -> list[dict]:
    """Return what each stream did to a checkout, PATH or PATH=MODULE."""
    path, _, module = checkout.partition("=")
    root = Path(path).resolve()
    environment = os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{root / 'tests'}"}
    found: list[dict] = [{} for _ in todo]
    waiting = iter(range(len(todo)))  # whose turn it is; each worker takes the next

    def work() -> None:
        command = [sys.executable, "-c", _WORKER, module or _MODULE]
        with subprocess.Popen(
            command, cwd=root, env=environment, stdin=-1, stdout=-1, text=True
        ) as worker:
            assert worker.stdin and worker.stdout
            for k in waiting:
                print(json.dumps(todo[k]), file=worker.stdin, flush=True)
                found[k] = json.loads(worker.stdout.readline())
            worker.stdin.close()

    threads = [threading.Thread(target=work) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if not all(found):
        raise RuntimeError(f"{checkout}: a stream was not counted; see what its process says above")
    return found


def total(todo, found: list[dict], kind: str, shape: str = "") -> Counter:
    """Sum what the streams of a kind, and of a shape if one is given, were counted for."""
    counts: Counter = Counter()
    for (of, arguments), result in zip(todo, found, strict=True):
        if of == kind and shape in ("", arguments[0]):
            counts["streams"] += 1
            for name in _COUNTED:
                value = result.get(name, 0)
                counts[name] += sum(value) if isinstance(value, list) else value
    return counts


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("checkouts", nargs="+", metavar="PATH[=MODULE]")
    parser.add_argument("--shapes", nargs="+", choices=reliability.SHAPES, default=_SHAPES)
    parser.add_argument("--faults", nargs="*", metavar="NAME", help="of these only")
    parser.add_argument("--sound", type=int, default=1, help="streams of each (default 1)")
    parser.add_argument("--seed", type=int, default=1, help="of scenes and noise (default 1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes of a checkout")
    args = parser.parse_args(arguments)
    todo = tasks(args.shapes, args.sound, args.seed)
    if args.faults is not None:
        todo = [t for t in todo if t[0] == "sound" or t[1][1] in args.faults]
    track = extras.tqdm()
    found = {each: run(each, todo, args.jobs) for each in track(args.checkouts)}
    sums: dict = {}
    for kind in ("fault", "sound"):
        for shape in (*args.shapes, ""):
            for each, results in found.items():
                counts = total(todo, results, kind, shape)
                if counts["streams"]:
                    print(f"{kind:6} {shape or 'together':22} {each}: ", end="")
                    print(", ".join(f"{name} {n}" for name, n in counts.items()))
                    sums[f"{kind} {shape} {each}"] = counts
    return sums


if __name__ == "__main__":
    harness.run(main)
