# SPDX-License-Identifier: Apache-2.0
"""The commands of a launch file: processes of their own that end with this one."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from ..errors import LaunchError


def start_command(command: list[str]) -> subprocess.Popen:
    """Start a command; the tools of this Python's environment come first on its PATH."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            env=os.environ | {"PATH": path},
            # a session of its own: Ctrl-C ends the nodes first, and they end the command
            start_new_session=True,
        )
    except OSError as error:
        raise LaunchError(f"executable {shlex.join(command)}: {error.strerror}") from error


def end_commands(processes: list[subprocess.Popen], deadline: Callable[[], float]):
    """Ask them to end, and kill those that have not at `deadline()`, a monotonic time [s].

    It is asked for again and again.
    """
    for process in processes:
        process.terminate()
    while any(process.poll() is None for process in processes) and time.monotonic() < deadline():
        time.sleep(0.005)
    for process in processes:
        process.kill()
        process.wait()
