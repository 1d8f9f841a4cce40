# SPDX-License-Identifier: Apache-2.0
"""How a process with a skin shares its time among its threads."""

from __future__ import annotations

import contextlib
import gc
import sys
import threading

_SWITCH = 0.0005  # s; the default, 5 ms, is longer than the way of a frame to the stop


def one_thread() -> contextlib.AbstractContextManager:
    """Return a context within which the process's BLAS libraries run one thread each.

    rosdep knows no threadpoolctl: without it the programs' environment says so (__main__.py).
    """
    try:
        from threadpoolctl import threadpool_limits
    except ModuleNotFoundError:
        return contextlib.nullcontext()
    return threadpool_limits(1)


class Pace:
    """Keeps the threads of a process at the pace of its skins, until the last of them has ended."""

    def __init__(self) -> None:
        self._lock, self._skins = threading.Lock(), 0
        self._before = contextlib.ExitStack()  # closed, all is as before the first skin

    def enter(self) -> None:
        """Begin a skin, whose nodes are there."""
        with self._lock:
            self._skins += 1
            if self._skins == 1:
                # The matrices are small. More threads than one would spin beside it, and on a small
                # computer keep the other nodes waiting for a tenth of a second.
                self._before.enter_context(one_thread())
                self._before.callback(sys.setswitchinterval, sys.getswitchinterval())
                sys.setswitchinterval(_SWITCH)
                if not gc.get_freeze_count():  # else the program's own
                    self._before.callback(gc.unfreeze)
            # What is there now stays. Where a program keeps what it hears, the collector would look
            # at all of it as well, and stop every thread for 25 to 66 ms: several frames' time.
            gc.collect()
            gc.freeze()

    def leave(self) -> None:
        """End a skin that has begun."""
        with self._lock:
            self._skins -= 1
            if not self._skins:
                self._before.close()


PACE = Pace()
