# SPDX-License-Identifier: Apache-2.0
"""The command `tactile-skin`, `python -m tactile_skin`, and the programs of ROS 2.

They load for a second. Until then Ctrl-C ends the process at once, as the system does by default:
as an exception it would come out of whatever import it interrupts, as a traceback.
"""

import functools
import importlib
import os
import signal
import sys


def main() -> int:
    """Run one command; returns the exit status."""
    return _loaded("cli").main()


def _program(name: str, words: list[str] | None = None) -> int:
    return _loaded("ros").run(name, words)


def _loaded(name: str):
    for library in ("OPENBLAS", "OMP"):  # reads it once, when NumPy is imported: threads.py
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else it is ignored: a shell's background job
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    module = importlib.import_module(f".{name}", __package__)
    signal.signal(signal.SIGINT, before)
    return module


def __getattr__(name: str):
    """Return an entry point for each program of `ros2 run tactile_skin`, by its name."""
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return functools.partial(_program, name)


if __name__ == "__main__":
    sys.exit(main())
