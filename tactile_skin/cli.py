# SPDX-License-Identifier: Apache-2.0
"""The command `tactile-skin`.

Each command is a module of `commands` with `EXAMPLES`, which end its help, `register(parser)` and
`run(args)`; it is loaded when it is asked for.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from importlib import import_module

from . import __version__
from .arguments import CommandParser
from .files import one_line

COMMANDS = {  # name: what it does
    "launch": "start the skin that a launch file describes; without one, the demo on a simulated "
    "board",
    "view": "a recording in the browser; without one, the skin of a launch file",
    "sim": "a simulated board: the real bytes on a pseudo-terminal that any serial program can "
    "open",
    "flash": "put the firmware on an Arduino Nano or Uno (ATmega328P) that is wired as in "
    "docs/board.md",
    "calibrate": "find your board's circuit from touches and its newtons from a few weights, step "
    "by step",
    "detect": "find out what a board sends, at which baud rate, and write a parameter file that "
    "reads it",
    "doctor": "which wire or cell is bad: from recorded frames, or from the live board",
    "gestures": "record gestures of your own, train a recogniser, see how good it is",
    "record": "start the skin and record all that it publishes, with its configuration (MCAP, ROS "
    "2)",
    "replay": "recorded readings through the same nodes again, or to NumPy and CSV",
    "train": "train a network for your board: its circuit and curve from a parameter file",
    "bench": "measure every method and draw it: speed against accuracy, and where each method "
    "fails",
}


def make_parser(*loaded: str) -> argparse.ArgumentParser:
    """Return the parser of all commands.

    Args:
        loaded: names of the commands whose arguments it knows.
    """
    parser = argparse.ArgumentParser(
        prog="tactile-skin",
        description="A robot's skin from a low-cost resistive pressure matrix.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=CommandParser
    )
    for name, text in COMMANDS.items():
        sub = commands.add_parser(
            name,
            help=text,
            description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name in loaded:
            module = import_module(f".commands.{name}", __package__)
            sub.epilog = module.EXAMPLES
            module.register(sub)
            sub.set_defaults(run=module.run)
    return parser


def _open_closed_streams() -> None:
    """Open the null device for closed standard streams: a port would get their numbers."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 1 for a run that failed, 2 for a mistake."""
    words = sys.argv[1:] if argv is None else argv
    _open_closed_streams()
    try:
        if "_ARGCOMPLETE" in os.environ:  # a shell asks how a word may go on
            import argcomplete

            argcomplete.autocomplete(make_parser(*COMMANDS))
        name = next((word for word in words if word in COMMANDS), None)
        args = make_parser(*filter(None, [name])).parse_args(words)
        above = "\r\x1b[2K" if sys.stderr.isatty() else ""  # a live line, which is drawn anew
        logging.basicConfig(
            level=logging.INFO,
            format=f"{above}%(levelname)s %(name)s: %(message)s",
            stream=sys.stderr,
        )
        return args.run(args)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # "| head" has seen enough
        sys.stdout = None
        return 0
    except (ValueError, OSError, ModuleNotFoundError) as error:
        print(f"tactile-skin {name}: error: {one_line(error)}", file=sys.stderr)
        return 2
