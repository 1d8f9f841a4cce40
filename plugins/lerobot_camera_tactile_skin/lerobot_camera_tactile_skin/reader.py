# SPDX-License-Identifier: Apache-2.0
"""The board, read in a process of its own: LeRobot's threads delay neither a frame nor the stop.

`python reader.py PORT CONFIG HOOK` (without LeRobot, whose import takes seconds) writes the fields
of frames to its output, pickled, until nobody reads them.
"""

from __future__ import annotations

import importlib
import os
import pickle
import signal
import sys
import time
from typing import NamedTuple

import numpy as np

import tactile_skin
from tactile_skin.launch import read_skin

PATIENCE = 0.1  # s without a frame after which the stop is asked again
# reasons of a stop with which a picture is right: its age is judged when it is read
NO_FAULT = ("push", "latched", "stale")


class Frame(NamedTuple):
    """A picture and all that belongs to its instant."""

    time: float  # when the board sent it, of `time.perf_counter` [s]
    pressure: np.ndarray  # (rows, cols) [Pa]; NaN: no picture
    force: np.ndarray  # (rows, cols) [N]
    std: np.ndarray  # (rows, cols) one standard deviation of it [N]
    stop: bool  # whether a robot must stop
    reason: str
    fault: str  # why the picture is not to be trusted; empty: it is


def frames(opened, area: np.ndarray, hook):
    """Yield each frame, after a call of hook(stop, reason) where the stop has changed."""
    stopped = None
    while True:
        try:
            force = opened.read(PATIENCE)[1]
        except TimeoutError:
            force = None
        stop, reason = opened.stop, opened.reason
        if stop != stopped:
            stopped = stop
            hook(stop, reason)
        if force is None:
            continue
        kept = [part for part in reason.split(" + ") if part and not part.startswith(NO_FAULT)]
        fault = " + ".join(kept) if np.isfinite(force).all() else opened.status
        sent = opened.stamp + time.perf_counter() - time.monotonic()
        yield Frame(sent, force / area, force, opened.std, stop, reason, fault)


def main(port: str, config: str, hook: str = "") -> None:
    """Write frames to the output, or at last the words of what went wrong."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # LeRobot ends it, by
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a hook prints is no frame
    called, why = (lambda stop, reason: None), "the skin is closed"
    if hook:
        module, _, function = hook.partition(":")
        called = getattr(importlib.import_module(module), function)
    try:
        area = read_skin(config or None)[2].cell_area
        with tactile_skin.open(port, config or None) as opened:
            for frame in frames(opened, area, called):
                out.write(pickle.dumps(tuple(frame)))
    except BrokenPipeError:
        why = "nobody reads the skin"
    except (ValueError, OSError) as error:
        why = str(error)
        out.write(pickle.dumps(why))
    finally:
        called(True, why)


if __name__ == "__main__":
    main(*sys.argv[1:])
