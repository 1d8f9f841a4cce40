# SPDX-License-Identifier: Apache-2.0
"""What is typed on the terminal."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading

_KEYS_WITHIN = 0.1  # s that a reset under way may keep the end of the skin waiting


@contextlib.contextmanager
def keys(reset):
    """On a terminal, r and Enter ask for the reset of a latched stop."""
    if os.name != "posix" or not sys.stdin.isatty():
        yield
        return
    ended, end = os.pipe()

    def read():
        while ended not in select.select([sys.stdin, ended], [], [])[0]:
            line = os.read(sys.stdin.fileno(), 1024)
            if not line:
                return  # its end
            try:
                if line.strip() == b"r":
                    print(f"reset: {reset()[1]}", file=sys.stderr)
            except (ValueError, RuntimeError) as error:
                print(f"reset: {error}", file=sys.stderr)

    reader = threading.Thread(target=read, name="keys", daemon=True)
    reader.start()
    try:
        yield
    finally:
        os.write(end, b"\n")
        reader.join(_KEYS_WITHIN)
        if not reader.is_alive():  # else it still waits for an answer
            os.close(ended)
        os.close(end)
