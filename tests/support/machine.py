# SPDX-License-Identifier: Apache-2.0
"""A computer that is itself a guest, and whose host takes the processor away for a while."""

from __future__ import annotations

import os
import time
from pathlib import Path

TAKEN = 0.02  # share of the processors' time; a second in a test of 25 s on two of them
_CALM_WITHIN = 120.0  # s that are waited for the host to give the processors back
_LOOKS = 2.0  # s over which it is seen whether it has

_began = 0.0, 0.0  # of the test that runs: `_stolen`, time [s]


def _stolen() -> float:
    """Seconds of processor time that the host has taken since the start; 0 where it never says."""
    try:
        total = Path("/proc/stat").read_text().split("\n", 1)[0].split()
        return int(total[8]) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return 0.0


def _share(stolen: float, begin: float) -> float:
    return (_stolen() - stolen) / (max(time.monotonic() - begin, 1e-3) * (os.cpu_count() or 1))


def begin() -> None:
    """A test begins."""
    global _began
    _began = _stolen(), time.monotonic()


def stood_still() -> bool:
    """Whether it did in the test that runs; waits until that is over.

    A test of what happens within a time, in other processes, says nothing then.
    """
    if _share(*_began) < TAKEN:
        return False
    deadline = time.monotonic() + _CALM_WITHIN
    while time.monotonic() < deadline:
        now = _stolen(), time.monotonic()
        time.sleep(_LOOKS)
        if _share(*now) < TAKEN:
            break
    return True
