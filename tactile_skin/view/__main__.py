"""The page's process of a running skin: `python -m tactile_skin.view LISTENING SKIN`, two open
sockets' numbers. It is started by process.py, and ends with the skin."""

import asyncio
import os
import socket
import sys

from .live import run

_NICE = 10  # the stop goes first

if __name__ == "__main__":
    os.nice(_NICE)
    listening, skin = (socket.socket(fileno=int(word)) for word in sys.argv[1:])
    asyncio.run(run(listening, skin))
