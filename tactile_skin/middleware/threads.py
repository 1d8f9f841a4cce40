# SPDX-License-Identifier: Apache-2.0
"""How a process with a skin shares its time among its threads."""

from __future__ import annotations

import contextlib
import gc
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

_CLOSE_WITHIN = 0.1  # s that the end of one node may keep the others waiting
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


def close_nodes(
    pairs: Iterable[tuple[Any, Any]], drain: Callable[[float], object], until: float
) -> None:
    """Close the nodes (handle, node) in the way of the data: what is on its way still arrives.

    A close that hangs, on a terminal that takes nothing say, does not keep the others.

    Args:
        drain: lets callbacks that are due run for so long [s].
        until: monotonic time at which all must be closed [s].
    """
    drained = min(until, time.monotonic() + _CLOSE_WITHIN)
    for handle, node in pairs:
        if not hasattr(node, "close"):
            continue
        closing = threading.Thread(
            target=_close, args=(handle, node), name="skin close", daemon=True
        )
        try:
            closing.start()
        except RuntimeError:  # the interpreter is ending, and starts no more threads
            _close(handle, node)
        else:
            closing.join(max(0.0, min(_CLOSE_WITHIN, until - time.monotonic())))
        drain(max(0.0, drained - time.monotonic()))


def _close(handle, node) -> None:
    begun = time.monotonic()
    try:
        node.close()
    except Exception:  # a closed stdout, say; of one that hung the handle is gone
        if time.monotonic() - begun < _CLOSE_WITHIN:
            handle.get_logger().exception("close() raised")
