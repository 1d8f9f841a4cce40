# SPDX-License-Identifier: Apache-2.0
"""What the scripts share: arguments, seeds, processes, and results with their machine.

def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    ...
    return figures  # plain data, or nothing, or an exit status

if __name__ == "__main__":
    harness.run(main)
"""

from __future__ import annotations

import argparse
import concurrent.futures
import contextlib
import io
import json
import multiprocessing
import os
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

from tactile_skin import extras
from tactile_skin.bench.measure import machine
from tactile_skin.bench.run import figures_of


def parser(doc: str, spec) -> argparse.ArgumentParser:
    """Return a parser whose help is the script's docstring.

    Args:
        spec: the script's `__spec__`, which knows its name.
    """
    made = argparse.ArgumentParser(
        prog=f"python -m {spec.name.removesuffix('.__main__')}",
        description=doc,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("--json", type=Path, metavar="FILE", help="where results are written, too")
    return made


def picture_parser(doc: str, spec) -> argparse.ArgumentParser:
    """Return a parser for a script that draws as the parts of `tactile-skin bench` do."""
    made = parser(doc, spec)
    made.add_argument("--seed", type=int, default=1, help="of scenes and noise (default 1)")
    made.add_argument("--quick", action="store_true", help="few frames, for a look")
    made.add_argument("--out", type=Path, default=Path("bench"), help="folder of the pictures")
    return made


def draw(module, arguments: dict, given: argparse.Namespace) -> dict[str, dict]:
    """Measure a module with `measure` and DRAW, write its pictures and their JSON, return it."""
    found = figures_of(module, arguments, given.out, given.quick, given.seed, extras.tqdm())
    print("pictures:", *(given.out / f"{name}.png" for name in found))
    return found


class _Tee(io.StringIO):
    """Keeps what is printed, and prints it."""

    def write(self, text: str) -> int:
        sys.__stdout__.write(text)
        return super().write(text)

    def flush(self) -> None:
        sys.__stdout__.flush()


def run(main: Callable) -> None:
    """Call a script's main; with --json write what it printed and returned."""
    finder = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    finder.add_argument("--json", type=Path)
    path, start = finder.parse_known_args()[0].json, time.monotonic()
    if path is None:
        figures = main()
    else:
        with contextlib.redirect_stdout(_Tee()) as printed:
            figures = main()
        about = {"command": sys.orig_argv[1:], "machine": machine()}
        about["seconds"] = round(time.monotonic() - start, 1)
        found = about | {"figures": figures, "printed": printed.getvalue().splitlines()}
        path.write_text(json.dumps(found, indent=1, default=_plain) + "\n", encoding="utf-8")
    if isinstance(figures, int):
        sys.exit(figures)


def _plain(value):
    """Arrays and what NumPy counts with, as JSON has them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def command(module, *words) -> int:
    """Run a command of the package as its line would; errors are raised."""
    parser = argparse.ArgumentParser()
    module.register(parser)
    status: int = module.run(parser.parse_args([str(word) for word in words]))
    return status


def seed_of(seed: int, *names) -> list[int]:
    """Return the seed of one of many measurements: the same whatever else is measured."""
    return [seed, *(zlib.crc32(str(name).encode()) for name in names)]


def spread(function: Callable, tasks: list, jobs: int | None, track=lambda tasks: tasks):
    """Yield the results of function(task) in order, of so many processes; None: one a core."""
    if jobs == 1:
        yield from map(function, track(tasks))
        return
    spawn = multiprocessing.get_context("spawn")  # a fork would copy threads half
    with concurrent.futures.ProcessPoolExecutor(jobs or os.cpu_count(), spawn) as pool:
        for running in track([pool.submit(function, task) for task in tasks]):
            yield running.result()
