# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin launch`: the skin of a launch file."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading

from .. import launch
from ..arguments import split

EXAMPLES = (
    "examples:\n"
    "  tactile-skin launch duration:=20\n"
    "  tactile-skin launch skin.launch.yaml port:=/dev/ttyUSB0\n"
    "  tactile-skin launch scene:=two_fingers method:=naive\n"
    "  tactile-skin launch --show-args skin.launch.yaml\n"
    "On a terminal, r and Enter reset a latched stop."
)


def register(parser) -> None:
    parser.add_argument(
        "words", nargs="*", metavar="FILE | NAME:=VALUE", help="launch file; arguments"
    )
    parser.add_argument(
        "-s", "--show-args", action="store_true", help="print its arguments and end"
    )


def run(args) -> int:
    """Start it, and wait for its end."""
    if args.show_args:
        for argument in launch.read_arguments(_file_of(args.words)[0]):
            given = "... (must be given)" if argument.default is None else argument.default
            print(f"{argument.name}:={given}\n    {argument.description}")
        return 0
    return spin(launch.Skin(plan_of(args.words)))


def plan_of(words: list[str], default: str = "", **given: str):
    """Return the plan of a launch file, or of the default one, with its arguments."""
    file, arguments = _file_of(words, default)
    return launch.read_plan(file, arguments | given)


def _file_of(words: list[str], default: str = ""):
    """Return the path of the launch file, and the arguments that it is given."""
    files, arguments = split(words)
    if len(files) > 1:
        raise ValueError(f"one launch file, not {len(files)}: {' '.join(files)}")
    return launch.find(files[0] if files else default or launch.default_file(arguments)), arguments


def spin(skin) -> int:
    """Run a skin until it ends, and return the exit status."""
    with skin, contextlib.suppress(KeyboardInterrupt):
        read_keys(skin.reset_stop)
        skin.spin()
    return 1 if skin.failed else 0


def read_keys(reset) -> None:
    """On a terminal, let r and Enter ask for the reset of a latched stop, to the process's end."""
    if os.name != "posix" or not sys.stdin.isatty():
        return
    terminal = sys.stdin.fileno()

    def read() -> None:
        # select: to read at once would stop what a shell runs in the background
        while select.select([terminal], [], [])[0] and (line := os.read(terminal, 1024)):
            try:
                if line.strip() == b"r":
                    print(f"reset: {reset()[1]}", file=sys.stderr)
            except (ValueError, RuntimeError) as error:
                print(f"reset: {error}", file=sys.stderr)

    threading.Thread(target=read, name="keys", daemon=True).start()
