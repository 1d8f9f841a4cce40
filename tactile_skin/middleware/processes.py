# SPDX-License-Identifier: Apache-2.0
"""The commands of a launch file: processes of their own that end with this one."""

from __future__ import annotations

import os
import shlex
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from ..errors import LaunchError

_LAUNCHED = "TACTILE_SKIN_LAUNCHED"  # in a command's environment: its launcher holds its stdin open


def start_command(command: list[str]) -> subprocess.Popen:
    """Start a command; the tools of this Python's environment come first on its PATH."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    try:
        return subprocess.Popen(
            command,
            # ends with this process, however that ends: see `end_with_launcher`
            stdin=subprocess.PIPE,
            env=os.environ | {"PATH": path, _LAUNCHED: str(os.getpid())},
            # a session of its own: Ctrl-C ends the nodes first, and they end the command
            start_new_session=True,
        )
    except OSError as error:
        raise LaunchError(f"executable {shlex.join(command)}: {error.strerror}") from error


def end_with_launcher(end: Callable[[], object]) -> None:
    """Call `end` once the launcher that started this process as a command is gone, however it went.

    A pipe shows that at once and everywhere. Linux could send a signal instead (PR_SET_PDEATHSIG),
    but does so when the thread that started the process ends.
    """

    def wait() -> None:
        while os.read(0, 1024):
            pass
        end()

    if _LAUNCHED in os.environ and stat.S_ISFIFO(os.fstat(0).st_mode):
        threading.Thread(target=wait, daemon=True).start()


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
        if process.stdin is not None:
            process.stdin.close()
