# SPDX-License-Identifier: Apache-2.0
"""Serves the page of a running skin: `python -m tactile_skin.view LISTENING SKIN...`.

These are the numbers of open sockets. It is started by process.py, and ends with the skin.
"""

import asyncio
import contextlib
import os
import socket
import sys
from pathlib import Path

from .live import run

_NICE = 10  # the stop goes first
# Where Linux shares the processor among sessions (autogroup, sched(7)), `nice` counts within one
# only, and this process has its own.
_SESSION = Path("/proc/self/autogroup")

if __name__ == "__main__":
    os.nice(_NICE)
    with contextlib.suppress(OSError):  # another system, or one without autogroup
        _SESSION.write_text(str(_NICE))
    listening, *skins = (socket.socket(fileno=int(word)) for word in sys.argv[1:])
    asyncio.run(run(listening, skins))
